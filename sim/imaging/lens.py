"""The lens and its calibration: distortion, miscalibration, and the render margin they need.

Three geometries of a camera share a centre of projection: nominal (the rendered pinhole, aligned
with the other camera), raw (on the sensor, distorted and turned by the miscalibration) and
delivered (the raw image rectified by the delivered calibration).
"""

import math
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from sim.camera_settings import CalibrationSettings, SensorSettings
from sim.imaging.resample import TAPS_PX
from sim.settings import RecordSettings
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.rig import StereoRig

NEWTON_STEPS = 30
CONVERGED = 1e-10
MARGIN_MAX = 0.5
"""Largest margin on each side, as a fraction of the image's longer side."""
BLUR_DEVIATIONS = 3.0
"""Radius of the Gaussian point spread function, in standard deviations."""


def delivered_rig(rig: StereoRig, settings: CalibrationSettings) -> StereoRig:
    """Return the delivered calibration: the true one with the configured errors.

    Raises:
        CalibrationError: If it leaves no baseline or no focal length.
    """
    f_px = rig.f_px * (1 + settings.focal_percent / 100)
    baseline_m = rig.baseline_m * (1 + settings.baseline_percent / 100)
    return replace(rig, f_px=f_px, baseline_m=baseline_m)


def miscalibration_rotation(settings: CalibrationSettings) -> Array:
    """Return R_nominal_true (3, 3): the true right camera in the axes of its calibration.

    Roll about z first, then pitch about x, then yaw about y.
    """
    angles_deg = [settings.yaw_deg, settings.pitch_deg, settings.roll_deg]
    return Rotation.from_euler("YXZ", angles_deg, degrees=True).as_matrix()


def has_distortion(settings: SensorSettings) -> bool:
    """Whether the lens distorts."""
    return any((settings.k1, settings.k2, settings.p1, settings.p2))


def distort(settings: SensorSettings, points: Array) -> Array:
    """Distort normalised (..., 2) points x/z, y/z.

    Source: OpenCV, camera calibration and 3D reconstruction: k1, k2, p1, p2.
    """
    x, y = points[..., 0], points[..., 1]
    r2 = x * x + y * y
    radial = 1 + settings.k1 * r2 + settings.k2 * r2 * r2
    u = x * radial + 2 * settings.p1 * x * y + settings.p2 * (r2 + 2 * x * x)
    v = y * radial + settings.p1 * (r2 + 2 * y * y) + 2 * settings.p2 * x * y
    return np.stack([u, v], axis=-1)


def undistort(settings: SensorSettings, distorted: Array) -> Array:
    """Invert `distort` for (..., 2) points by Newton's method.

    NaN where no ray arrives, or only one from beyond a fold of the distortion.
    """
    points = np.array(distorted, dtype=np.float64)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            error = distort(settings, points) - distorted
            (a, b), (c, d) = _jacobian(settings, points)
            determinant = a * d - b * c
            points[..., 0] -= (d * error[..., 0] - b * error[..., 1]) / determinant
            points[..., 1] -= (a * error[..., 1] - c * error[..., 0]) / determinant
            if np.abs(error).max(initial=0.0) < CONVERGED:
                break
        arrived = np.abs(distort(settings, points) - distorted).max(axis=-1) < 10 * CONVERGED
    arrived &= _inside_fold(settings, points)
    return np.where(arrived[..., None], points, np.nan)


def raw_to_nominal(
    sensor: SensorSettings, rig: StereoRig, R_nominal_true: Array, pixels: Array
) -> tuple[Array, Array]:
    """Map (..., 2) raw pixels to u_px and v_px (...) of the rendered pinhole, (0, 0) as in `rig`.

    NaN where no light arrives.
    """
    ray = undistort(sensor, rig.normalized(pixels))
    x, y, z = np.moveaxis(ray @ R_nominal_true[:, :2].T + R_nominal_true[:, 2], -1, 0)
    z = np.where(z > 0, z, np.nan)
    return rig.f_px * x / z + rig.cx_px, rig.f_px * y / z + rig.cy_px


def delivered_to_raw(
    settings: RecordSettings, rig: StereoRig, pixels: Array
) -> tuple[Array, Array]:
    """Map (..., 2) delivered pixels to u_px and v_px (...) of the raw image."""
    delivered = delivered_rig(rig, settings.calibration)
    raw = distort(settings.sensor, delivered.normalized(pixels)) * delivered.f_px
    return raw[..., 0] + rig.cx_px, raw[..., 1] + rig.cy_px


def pixel_grid(rig: StereoRig, pad_px: int = 0) -> Array:
    """Return the pixels (H + 2 pad, W + 2 pad, 2) of an image `pad_px` wider on each side."""
    u = np.arange(-pad_px, rig.width_px + pad_px, dtype=np.float64)
    v = np.arange(-pad_px, rig.height_px + pad_px, dtype=np.float64)
    return np.stack(np.meshgrid(u, v), axis=-1)


def raw_margin_px(settings: RecordSettings, rig: StereoRig) -> int:
    """Return how far the raw image must exceed the delivered one on each side to fill its corners.

    Raises:
        SettingsError: If the distortion folds inside the image, or the margin would be too large.
    """
    if not has_distortion(settings.sensor):
        return 0
    edge = _edge(rig, 0)
    delivered = delivered_rig(rig, settings.calibration)
    if not _inside_fold(settings.sensor, delivered.normalized(edge)).all():
        raise _fold_error(settings)
    return _required_margin_px(rig, *delivered_to_raw(settings, rig, edge))


def psf_radius_px(settings: SensorSettings) -> int:
    """Return the radius of the point spread function."""
    return math.ceil(BLUR_DEVIATIONS * settings.softness_px)


def margin_px(settings: RecordSettings, rig: StereoRig) -> int:
    """Return the margin to render on each side so that every pixel of both cameras has light.

    Raises:
        SettingsError: If the distortion folds inside the image, or the margin would be too large.
        CalibrationError: If the delivered calibration is invalid.
    """
    delivered_rig(rig, settings.calibration)  # raises before anything is rendered
    pad_px = raw_margin_px(settings, rig) + psf_radius_px(settings.sensor)
    R_nominal_true = miscalibration_rotation(settings.calibration)
    if np.array_equal(R_nominal_true, np.eye(3)) and not has_distortion(settings.sensor):
        return pad_px
    margin = 0
    for R in (np.eye(3), R_nominal_true):
        u_px, v_px = raw_to_nominal(settings.sensor, rig, R, _edge(rig, pad_px))
        if np.isnan(u_px).any():
            raise _fold_error(settings)
        margin = max(margin, _required_margin_px(rig, u_px, v_px))
    return margin


def _jacobian(settings: SensorSettings, points: Array) -> Array:
    """Return the (2, 2, ...) derivative of `distort`."""
    x, y = points[..., 0], points[..., 1]
    k1, k2, p1, p2 = settings.k1, settings.k2, settings.p1, settings.p2
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2 * r2
    slope = 2 * k1 + 4 * k2 * r2
    across = slope * x * y + 2 * p1 * x + 2 * p2 * y
    along_x = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
    along_y = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
    return np.array([[along_x, across], [across, along_y]])


def _inside_fold(settings: SensorSettings, points: Array) -> Array:
    """Whether each (..., 2) ray lies inside the first fold, where the distortion turns back.

    Radially, 1 + 3 k1 r^2 + 5 k2 r^4 > 0 all the way out to the ray.
    """
    r2 = (points**2).sum(axis=-1)
    roots = np.roots([5 * settings.k2, 3 * settings.k1, 1.0])
    folds = [root.real for root in roots if abs(root.imag) < 1e-12 and root.real > 0]
    (a, b), (c, d) = _jacobian(settings, points)
    return (r2 < min(folds, default=np.inf)) & (a * d - b * c > 0)


def _fold_error(settings: RecordSettings) -> SettingsError:
    """There is no fold in the radial distortion if 9 k1^2 < 20 k2."""
    sensor = settings.sensor
    return SettingsError(
        f"sensor.k1 = {sensor.k1:g}, k2 = {sensor.k2:g}, p1 = {sensor.p1:g}, p2 = {sensor.p2:g}: "
        f"this lens folds the image at rig.hfov_deg = {settings.rig.hfov_deg:g}; use less "
        f"distortion, k2 above {0.45 * sensor.k1**2:.2g}, or a smaller field of view"
    )


def _required_margin_px(rig: StereoRig, u_px: Array, v_px: Array) -> int:
    """Return by how much places exceed the image on any side, sampling included."""
    beyond = max(-u_px.min(), u_px.max() - rig.width_px + 1)
    beyond = max(beyond, -v_px.min(), v_px.max() - rig.height_px + 1)
    margin = max(0, math.ceil(beyond + TAPS_PX))
    most = int(MARGIN_MAX * max(rig.width_px, rig.height_px))
    if margin > most:
        raise SettingsError(
            f"sensor.k1 to p2 with calibration.roll_deg, pitch_deg and yaw_deg need {margin} px "
            f"around the image, at most {most} px are rendered; use smaller values"
        )
    return margin


def _edge(rig: StereoRig, pad_px: int) -> Array:
    """(N, 2) outermost pixels; those inside map to the inside of their image."""
    grid = pixel_grid(rig, pad_px)
    return np.concatenate([grid[0], grid[-1], grid[:, 0], grid[:, -1]])
