"""What each sensor folder says of itself: the content of its sensor.yaml."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sim.settings import EncoderSettings, ImuSettings, RecordSettings, SensorSettings
from sim.world.rover import TRACK_M, WHEEL_RADIUS_M
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

SIDES = "left", "right"
EXPOSURES = "mav0/cam0/exposure.csv"
"""Table of how each frame was exposed."""
FLOAT, CODES, FLOAT_3 = (
    "32-bit float TIFF, lossless",
    "PNG",
    "3-channel 32-bit float TIFF, lossless",
)


@dataclass(frozen=True)
class LabelFormat:
    """How one dense label is kept.

    Attributes:
        folder: Under mav0; the digit is the camera whose pixels it has.
        about: What a pixel says.
        unit: Of its values.
        encoding: File format.
        invalid: What a pixel holds that has no value.
    """

    folder: str
    about: str
    unit: str
    encoding: str
    invalid: str

    @property
    def suffix(self) -> str:
        """Of its files."""
        return ".png" if self.encoding == CODES else ".tiff"

    @property
    def eye(self) -> int:
        """0 or 1: the camera whose pixels it has."""
        return int(self.folder[-1])


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
    """Where a dataset folder keeps one of LABELS."""
    form = LABELS[label]
    return folder / "mav0" / form.folder / "data" / f"{time_ns}{form.suffix}"


def camera_sheet(rig: StereoRig, rate_hz: float, eye: int, comment: str) -> dict[str, Any]:
    """Describe rectified camera 0 (left) or 1 (right), in EuRoC's keys."""
    T_left_eye = se3.pose(np.eye(3), np.array([rig.baseline_m * eye, 0.0, 0.0]))
    return {
        "sensor_type": "camera",
        "comment": comment,
        "T_BS": _matrix(rig.T_body_cam @ T_left_eye),
        "rate_hz": rate_hz,
        "resolution": [rig.width_px, rig.height_px],
        "camera_model": "pinhole",
        "intrinsics": [rig.f_px, rig.f_px, rig.cx_px, rig.cy_px],
        "distortion_model": "radial-tangential",
        "distortion_coefficients": [0.0, 0.0, 0.0, 0.0],
    }


def raw_camera_sheet(
    rig: StereoRig, rate_hz: float, eye: int, sensor: SensorSettings
) -> dict[str, Any]:
    """Describe the camera before rectification: the same pinhole behind a lens that distorts."""
    sheet = camera_sheet(rig, rate_hz, eye, f"{SIDES[eye]} eye as it leaves the sensor, distorted")
    coefficients = [sensor.k1, sensor.k2, sensor.p1, sensor.p2]
    return {**sheet, "distortion_coefficients": coefficients}


def label_sheet(rig: StereoRig, rate_hz: float, label: LabelFormat) -> dict[str, Any]:
    """Describe a label; its pixels are those of its camera."""
    T_left_eye = se3.pose(np.eye(3), np.array([rig.baseline_m * label.eye, 0.0, 0.0]))
    return {
        "sensor_type": label.folder[:-1],
        "comment": label.about,
        "T_BS": _matrix(rig.T_body_cam @ T_left_eye),
        "rate_hz": rate_hz,
        "resolution": [rig.width_px, rig.height_px],
        "unit": label.unit,
        "encoding": label.encoding,
        "invalid_value": label.invalid,
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
    """Describe the loads on the wheels, which are truth: no rover measures them."""
    return {
        "sensor_type": "wheel_loads",
        "comment": "normal force between ground and wheel at an instant",
        "rate_hz": rate_hz,
        "unit": "N",
    }


def truth_sheet(settings: RecordSettings) -> dict[str, Any]:
    """Describe the true state."""
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
