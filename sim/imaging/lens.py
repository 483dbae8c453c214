"""The lens and what calibration knows of it: distortion, an unknown turn, the margin they need.

Three geometries of one eye, all with the same centre of projection:
- nominal: the pinhole that the renderer draws, aligned with its twin;
- chip: what falls on the sensor, distorted, and turned by what calibration does not know;
- delivered: the chip's picture made a pinhole again by the delivered calibration.
"""

import math

import numpy as np
from scipy.spatial.transform import Rotation

from sim.imaging.resample import TAPS_PX
from sim.settings import CalibrationSettings, RecordSettings, SensorSettings
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.rig import StereoRig

NEWTON_STEPS = 30
CONVERGED = 1e-10
MARGIN_MAX = 0.5
"""Largest margin on each side, as a share of the picture's longer side."""
BLUR_DEVIATIONS = 3.0
"""A Gaussian point spread ends here."""


def delivered_rig(rig: StereoRig, settings: CalibrationSettings) -> StereoRig:
    """Return the calibration that is handed out with the pictures: the true one, a bit wrong.

    Raises:
        CalibrationError: If it leaves no baseline or no focal length.
    """
    return StereoRig(
        width_px=rig.width_px,
        height_px=rig.height_px,
        f_px=rig.f_px * (1 + settings.focal_percent / 100),
        cx_px=rig.cx_px,
        cy_px=rig.cy_px,
        baseline_m=rig.baseline_m * (1 + settings.baseline_percent / 100),
        T_body_cam=rig.T_body_cam,
    )


def unknown_rotation(settings: CalibrationSettings) -> Array:
    """R_nominal_true (3, 3): the right camera as it is, in the axes that calibration believes.

    Rolled about its own z first, then pitched about x, then yawed about y.
    """
    angles_deg = [settings.yaw_deg, settings.pitch_deg, settings.roll_deg]
    return Rotation.from_euler("YXZ", angles_deg, degrees=True).as_matrix()


def is_distorting(settings: SensorSettings) -> bool:
    """Whether the lens bends straight lines."""
    return any((settings.k1, settings.k2, settings.p1, settings.p2))


def distort(settings: SensorSettings, points: Array) -> Array:
    """Where the lens throws rays: normalised (..., 2) x/z, y/z to normalised, as OpenCV's model.

    Source:
        OpenCV, camera calibration and 3D reconstruction: k1, k2, p1, p2.
    """
    x, y = points[..., 0], points[..., 1]
    r2 = x * x + y * y
    radial = 1 + settings.k1 * r2 + settings.k2 * r2 * r2
    return np.stack(
        [
            x * radial + 2 * settings.p1 * x * y + settings.p2 * (r2 + 2 * x * x),
            y * radial + settings.p1 * (r2 + 2 * y * y) + 2 * settings.p2 * x * y,
        ],
        axis=-1,
    )


def undistort(settings: SensorSettings, distorted: Array) -> Array:
    """Invert `distort` by Newton's method.

    Args:
        settings: Of the sensor.
        distorted: (..., 2) normalised places on the chip.

    Returns:
        (..., 2) normalised rays; NaN where no ray arrives, or only one from beyond a fold.
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
    arrived &= _before_fold(settings, points)
    return np.where(arrived[..., None], points, np.nan)


def chip_map(
    settings: RecordSettings, rig: StereoRig, R_nominal_true: Array, pad_px: int
) -> tuple[Array, Array]:
    """Where each pixel of the chip takes its light from.

    Args:
        settings: Of the recording.
        rig: True geometry; the chip's pixel (0, 0) is the picture's.
        R_nominal_true: (3, 3) turn of this eye.
        pad_px: How far the chip goes beyond the picture on each side.

    Returns:
        u_px, v_px (H + 2 pad, W + 2 pad) float64 in the nominal pinhole, (0, 0) as in `rig`;
        NaN where no light arrives.
    """
    return _nominal_places(settings.sensor, rig, R_nominal_true, _grid(rig, pad_px))


def picture_map(settings: RecordSettings, rig: StereoRig) -> tuple[Array, Array]:
    """Where each pixel of the delivered picture is on the chip, by the delivered calibration.

    Args:
        settings: Of the recording.
        rig: True geometry.

    Returns:
        u_px, v_px (H, W) float64, (0, 0) as in `rig`.
    """
    return _chip_places(settings, rig, _grid(rig, 0))


def chip_margin_px(settings: RecordSettings, rig: StereoRig) -> int:
    """How far the chip must go beyond the picture on each side to fill its corners.

    Raises:
        SettingsError: If the lens folds inside the picture, or the margin would be too large.
    """
    if not is_distorting(settings.sensor):
        return 0
    edge = _edge(rig, 0)
    delivered = delivered_rig(rig, settings.calibration)
    if not _before_fold(settings.sensor, delivered.normalized(edge)).all():
        raise _folds(settings)
    return _overflow_px(rig, *_chip_places(settings, rig, edge))


def blur_px(settings: SensorSettings) -> int:
    """Reach of the point spread."""
    return math.ceil(BLUR_DEVIATIONS * settings.softness_px)


def margin_px(settings: RecordSettings, rig: StereoRig) -> int:
    """How much more to render on each side so that every pixel of both eyes has light.

    Args:
        settings: Of the recording.
        rig: True geometry in the delivered size.

    Raises:
        SettingsError: If the lens folds inside the picture, or the margin would be too large.
        CalibrationError: If the delivered calibration is none.
    """
    delivered_rig(rig, settings.calibration)  # raises before anything is rendered
    pad_px = chip_margin_px(settings, rig) + blur_px(settings.sensor)
    R_nominal_true = unknown_rotation(settings.calibration)
    turned = not np.array_equal(R_nominal_true, np.eye(3))
    if not turned and not is_distorting(settings.sensor):
        return pad_px
    margin = 0
    for R in (np.eye(3), R_nominal_true) if turned else (np.eye(3),):
        u_px, v_px = _nominal_places(settings.sensor, rig, R, _edge(rig, pad_px))
        if np.isnan(u_px).any():
            raise _folds(settings)
        margin = max(margin, _overflow_px(rig, u_px, v_px))
    return margin


def _nominal_places(
    sensor: SensorSettings, rig: StereoRig, R_nominal_true: Array, pixels: Array
) -> tuple[Array, Array]:
    """Map (..., 2) pixels of the chip to the nominal pinhole."""
    ray = undistort(sensor, rig.normalized(pixels))
    x, y, z = np.moveaxis(ray @ R_nominal_true[:, :2].T + R_nominal_true[:, 2], -1, 0)
    z = np.where(z > 0, z, np.nan)
    return rig.f_px * x / z + rig.cx_px, rig.f_px * y / z + rig.cy_px


def _chip_places(settings: RecordSettings, rig: StereoRig, pixels: Array) -> tuple[Array, Array]:
    """Map (..., 2) pixels of the delivered picture to the chip."""
    delivered = delivered_rig(rig, settings.calibration)
    on_chip = distort(settings.sensor, delivered.normalized(pixels)) * delivered.f_px
    return on_chip[..., 0] + rig.cx_px, on_chip[..., 1] + rig.cy_px


def _jacobian(settings: SensorSettings, points: Array) -> Array:
    """(2, 2, ...) derivative of `distort`."""
    x, y = points[..., 0], points[..., 1]
    k1, k2, p1, p2 = settings.k1, settings.k2, settings.p1, settings.p2
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2 * r2
    slope = 2 * k1 + 4 * k2 * r2
    across = slope * x * y + 2 * p1 * x + 2 * p2 * y
    return np.array(
        [
            [radial + slope * x * x + 2 * p1 * y + 6 * p2 * x, across],
            [across, radial + slope * y * y + 6 * p1 * y + 2 * p2 * x],
        ]
    )


def _before_fold(settings: SensorSettings, points: Array) -> Array:
    """Whether each (..., 2) ray lies where rays further out still land further out.

    Radially this is 1 + 3 k1 r^2 + 5 k2 r^4 > 0 all the way out to the ray.
    """
    r2 = (points**2).sum(axis=-1)
    roots = np.roots([5 * settings.k2, 3 * settings.k1, 1.0])
    folds = [root.real for root in roots if abs(root.imag) < 1e-12 and root.real > 0]
    (a, b), (c, d) = _jacobian(settings, points)
    return (r2 < min(folds, default=np.inf)) & (a * d - b * c > 0)


def _folds(settings: RecordSettings) -> SettingsError:
    """Radially nothing ever folds if 9 k1^2 < 20 k2: then 1 + 3 k1 r^2 + 5 k2 r^4 has no root."""
    sensor = settings.sensor
    return SettingsError(
        f"sensor.k1 = {sensor.k1:g}, k2 = {sensor.k2:g}, p1 = {sensor.p1:g}, p2 = {sensor.p2:g}: "
        f"this lens folds the picture at rig.hfov_deg = {settings.rig.hfov_deg:g}; use less "
        f"distortion, k2 above {0.45 * sensor.k1**2:.2g}, or a smaller field of view"
    )


def _overflow_px(rig: StereoRig, u_px: Array, v_px: Array) -> int:
    """By how much places need more than the picture on any side, with what sampling needs."""
    beyond = max(-u_px.min(), u_px.max() - rig.width_px + 1)
    beyond = max(beyond, -v_px.min(), v_px.max() - rig.height_px + 1)
    margin = max(0, math.ceil(beyond + TAPS_PX))
    most = int(MARGIN_MAX * max(rig.width_px, rig.height_px))
    if margin > most:
        raise SettingsError(
            f"sensor.k1 to p2 with calibration.roll_deg, pitch_deg and yaw_deg need {margin} px "
            f"around the picture, at most {most} px are rendered; use smaller values"
        )
    return margin


def _grid(rig: StereoRig, pad_px: int) -> Array:
    """(H + 2 pad, W + 2 pad, 2) pixels."""
    u = np.arange(-pad_px, rig.width_px + pad_px, dtype=np.float64)
    v = np.arange(-pad_px, rig.height_px + pad_px, dtype=np.float64)
    return np.stack(np.meshgrid(u, v), axis=-1)


def _edge(rig: StereoRig, pad_px: int) -> Array:
    """(N, 2) outermost pixels; what is inside them maps inside their image."""
    grid = _grid(rig, pad_px)
    return np.concatenate([grid[0], grid[-1], grid[:, 0], grid[:, -1]])
