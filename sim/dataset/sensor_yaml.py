"""Content of the sensor.yaml files."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from sim.settings import EncoderSettings, ImuSettings, RecordSettings, SensorSettings
from sim.world.rover import TRACK_M, WHEEL_RADIUS_M
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

SIDES = "left", "right"
EXPOSURES = "mav0/cam0/exposure.csv"
"""Table with the exposure of each frame."""
FLOAT, CODES = "32-bit float TIFF, lossless", "PNG"
FLOAT_3 = "3-channel 32-bit float TIFF, lossless"


class LabelFormat(NamedTuple):
    """File format of a dense label.

    Attributes:
        folder: Folder under mav0; its last digit is the camera whose pixels it labels.
        about: Meaning of a pixel.
        unit: Unit of the values.
        encoding: File format.
        invalid: Value of a pixel without a label.
    """

    folder: str
    about: str
    unit: str
    encoding: str
    invalid: str

    @property
    def suffix(self) -> str:
        """File name suffix."""
        return ".png" if self.encoding == CODES else ".tiff"


SEEN = "0 visible, 1 hidden behind something, 2 out of the picture, 3 no surface here"
LABELS = {
    "depth": LabelFormat(
        "depth0", "distance along the optical axis, at pixel centres", "m", FLOAT, "nan"
    ),
    "disparity": LabelFormat(
        "disparity0", "u_left - u_right of left pixels: f * baseline / depth", "px", FLOAT, "nan"
    ),
    "disparity_right": LabelFormat(
        "disparity1", "u_left - u_right of right pixels", "px", FLOAT, "nan"
    ),
    "occlusion": LabelFormat(
        "occlusion0", f"whether the right camera sees a left pixel: {SEEN}", "code", CODES, "3"
    ),
    "flow": LabelFormat(
        "flow0",
        "where a pixel's point is in the next left image: du, dv in pixels, then its depth there "
        "in metres; absent for the last frame",
        "px, px, m",
        FLOAT_3,
        "nan; the depth of the sky is nan, its motion is not",
    ),
    "covisibility": LabelFormat(
        "covisibility0",
        f"whether the next left image shows a pixel's point: {SEEN}; absent for the last frame",
        "code",
        CODES,
        "3",
    ),
    "segmentation": LabelFormat(
        "segmentation0", "object; the manifest's `things` has the names", "id", CODES, "0"
    ),
    "classes": LabelFormat(
        "classes0", "0 sky, 1 ground, 2 static, 3 moving", "code", CODES, "none"
    ),
    "normals": LabelFormat(
        "normals0",
        "unit normal of the surface towards the camera, in camera axes; nan where neighbouring "
        "pixels share no plane",
        "1",
        FLOAT_3,
        "nan",
    ),
}


def label_file(folder: Path, label: str, time_ns: int) -> Path:
    """Return the path of one of LABELS in a dataset folder."""
    form = LABELS[label]
    return folder / "mav0" / form.folder / "data" / f"{time_ns}{form.suffix}"


def camera_sheet(
    rig: StereoRig, rate_hz: float, camera: int, lens: SensorSettings | None = None
) -> dict[str, Any]:
    """Describe camera 0 (left) or 1 (right), in EuRoC's keys; raw behind a lens, or rectified."""
    comment = f"{SIDES[camera]} eye of a rectified pair, pixel centres on integers"
    coefficients = [0.0, 0.0, 0.0, 0.0]
    if lens:
        comment = f"{SIDES[camera]} eye as it leaves the sensor, distorted"
        coefficients = [lens.k1, lens.k2, lens.p1, lens.p2]
    return {
        "sensor_type": "camera",
        "comment": comment,
        **_pixels(rig, rate_hz, camera),
        "camera_model": "pinhole",
        "intrinsics": [rig.f_px, rig.f_px, rig.cx_px, rig.cy_px],
        "distortion_model": "radial-tangential",
        "distortion_coefficients": coefficients,
    }


def label_sheet(rig: StereoRig, rate_hz: float, label: LabelFormat) -> dict[str, Any]:
    """Describe a label; its pixels are those of its camera."""
    return {
        "sensor_type": label.folder[:-1],
        "comment": label.about,
        **_pixels(rig, rate_hz, int(label.folder[-1])),
        "unit": label.unit,
        "encoding": label.encoding,
        "invalid_value": label.invalid,
    }


def _pixels(rig: StereoRig, rate_hz: float, camera: int) -> dict[str, Any]:
    T_left_camera = se3.pose(np.eye(3), np.array([rig.baseline_m * camera, 0.0, 0.0]))
    return {
        "T_BS": _matrix(rig.T_body_cam @ T_left_camera),
        "rate_hz": rate_hz,
        "resolution": [rig.width_px, rig.height_px],
    }


def imu_sheet(settings: ImuSettings) -> dict[str, Any]:
    """Describe the inertial unit, in EuRoC's keys."""
    return {
        "sensor_type": "imu",
        "comment": "angular rate and specific force, each the mean since the reading before",
        "T_BS": _matrix(T_body_imu(settings)),
        "rate_hz": settings.rate_hz,
        "gyroscope_noise_density": settings.noise * settings.gyroscope_noise_density,
        "gyroscope_random_walk": settings.noise * settings.gyroscope_random_walk,
        "accelerometer_noise_density": settings.noise * settings.accelerometer_noise_density,
        "accelerometer_random_walk": settings.noise * settings.accelerometer_random_walk,
    }


def T_body_imu(settings: ImuSettings) -> Array:
    """(4, 4) pose of the inertial unit in the body frame."""
    R = Rotation.from_euler("xyz", settings.rpy_deg, degrees=True).as_matrix()
    return se3.pose(R, np.array(settings.position_m))


def wheels_sheet(settings: EncoderSettings) -> dict[str, Any]:
    """Describe the wheel encoders."""
    return {
        "sensor_type": "wheel_encoders",
        "comment": "ticks since the start, forward positive; stamps are exact, their spacing is "
        "the sampling period to one physics step",
        "rate_hz": settings.rate_hz,
        "ticks_per_turn": settings.ticks_per_turn,
        "wheel_radius_m": WHEEL_RADIUS_M,
        "track_m": TRACK_M,
    }


def contact_sheet(rate_hz: float) -> dict[str, Any]:
    """Describe the wheel loads, which are ground truth."""
    return {
        "sensor_type": "wheel_loads",
        "comment": "normal force between ground and wheel at an instant",
        "rate_hz": rate_hz,
        "unit": "N",
    }


def truth_sheet(settings: RecordSettings) -> dict[str, Any]:
    """Describe the true states."""
    return {
        "sensor_type": "truth",
        "comment": "T_world_body at mid-exposure; body: origin midway between the driven wheels, "
        "x forward, y left, z up, rigid with cameras and inertial unit; biases are the "
        "inertial unit's",
        "T_BS": _matrix(np.eye(4)),
        "rate_hz": settings.rig.rate_hz,
    }


def _matrix(T: Array) -> dict[str, Any]:
    return {"cols": 4, "rows": 4, "data": [float(x) for x in T.ravel()]}
