"""The lens and its calibration: raw pixels and rays, miscalibration, and the margins they need.

Three geometries of a camera share a centre of projection: nominal (the rendered pinhole, aligned
with the other camera), raw (on the sensor, distorted and turned by the miscalibration) and
delivered (the raw image rectified by the delivered calibration). Raw and delivered images of a
radial-tangential lens have one focal length; that of an equidistant lens follows from its angle.
"""

import math
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from sim.camera_settings import CalibrationSettings, SensorSettings
from sim.imaging.distortion import (
    coefficients,
    fold_angle_rad,
    fold_radius,
    has_distortion,
    image_radius,
    is_equidistant,
    is_inside_fold,
    project,
    rays_of,
)
from sim.imaging.resample import TAPS_PX
from sim.settings import RecordSettings
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.rig import StereoRig

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


def raw_focal_px(settings: SensorSettings, rig: StereoRig) -> float:
    """Return the focal length of the raw images of a rig, true or delivered."""
    if not is_equidistant(settings):
        return rig.f_px
    radius = image_radius(settings, math.radians(settings.fov_deg) / 2)
    return rig.width_px / 2 / radius if radius > 0 else math.inf


def miscalibration_rotation(settings: CalibrationSettings) -> Array:
    """Return R_nominal_true (3, 3): the true right camera in the axes of its calibration.

    Roll about z first, then pitch about x, then yaw about y.
    """
    angles_deg = [settings.yaw_deg, settings.pitch_deg, settings.roll_deg]
    return Rotation.from_euler("YXZ", angles_deg, degrees=True).as_matrix()


def raw_pixels(sensor: SensorSettings, rig: StereoRig, rays: Array) -> Array:
    """Map rays (..., 3) of the true camera to raw pixels (..., 2); NaN where it has no light."""
    return project(sensor, rays) * raw_focal_px(sensor, rig) + (rig.cx_px, rig.cy_px)


def raw_rays(sensor: SensorSettings, rig: StereoRig, pixels: Array) -> Array:
    """Map raw pixels (..., 2) to unit rays (..., 3) of the true camera; NaN without light."""
    points = (pixels - np.array([rig.cx_px, rig.cy_px])) / raw_focal_px(sensor, rig)
    rays = rays_of(sensor, points)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def raw_to_nominal(
    sensor: SensorSettings, rig: StereoRig, R_nominal_true: Array, pixels: Array
) -> tuple[Array, Array]:
    """Map (..., 2) raw pixels to u_px and v_px (...) of the rendered pinhole, (0, 0) as in `rig`.

    NaN where no light arrives. The lens is radial-tangential.
    """
    ray = rays_of(sensor, rig.normalized(pixels))[..., :2]
    x, y, z = np.moveaxis(ray @ R_nominal_true[:, :2].T + R_nominal_true[:, 2], -1, 0)
    z = np.where(z > 0, z, np.nan)
    return rig.f_px * x / z + rig.cx_px, rig.f_px * y / z + rig.cy_px


def delivered_to_raw(
    settings: RecordSettings, rig: StereoRig, pixels: Array
) -> tuple[Array, Array]:
    """Map (..., 2) delivered pixels to u_px and v_px (...) of the raw image."""
    delivered = delivered_rig(rig, settings.calibration)
    flat = delivered.normalized(pixels)
    rays = np.concatenate([flat, np.ones_like(flat[..., :1])], axis=-1)
    f_px = raw_focal_px(settings.sensor, rig) * delivered.f_px / rig.f_px
    raw = project(settings.sensor, rays) * f_px
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
    flat = delivered_rig(rig, settings.calibration).normalized(edge)
    rays = np.concatenate([flat, np.ones_like(flat[:, :1])], axis=-1)
    inside = is_inside_fold(settings.sensor, rays).all()
    if not inside or _folds_in_raw_image(settings.sensor, rig):
        raise _fold_error(settings, rig)
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
    is_straight = np.array_equal(R_nominal_true, np.eye(3)) and not has_distortion(settings.sensor)
    if is_straight or is_equidistant(settings.sensor):
        return pad_px
    margin = 0
    for R in (np.eye(3), R_nominal_true):
        u_px, v_px = raw_to_nominal(settings.sensor, rig, R, _edge(rig, pad_px))
        if np.isnan(u_px).any():
            raise _fold_error(settings, rig)
        margin = max(margin, _required_margin_px(rig, u_px, v_px))
    return margin


def _folds_in_raw_image(sensor: SensorSettings, rig: StereoRig) -> bool:
    """Whether an equidistant lens, which may leave corners dark, folds inside its field of view."""
    if not is_equidistant(sensor):
        return False
    f_px = raw_focal_px(sensor, rig)
    corner_px = math.hypot(rig.width_px, rig.height_px) / 2
    return not 0 < f_px < math.inf or f_px * fold_radius(sensor) < corner_px


def _fold_error(settings: RecordSettings, rig: StereoRig) -> SettingsError:
    """There is no fold of two coefficients in the radial distortion if 9 k1^2 < 20 k2."""
    sensor = settings.sensor
    names = "k1 k2 k3 k4" if is_equidistant(sensor) else "k1 k2 p1 p2 k3 k4 k5 k6"
    known = zip(names.split(), coefficients(sensor), strict=False)
    said = ", ".join(f"{name} = {value:g}" for name, value in known)
    radius_px = fold_radius(sensor) * raw_focal_px(sensor, rig)
    where = f" {radius_px:.0f} px from its centre" if 0 < radius_px < math.inf else ""
    if is_equidistant(sensor):
        where += f" {math.degrees(fold_angle_rad(sensor)):.0f} degrees from its axis"
    angle = f"rig.hfov_deg = {settings.rig.hfov_deg:g}"
    hint = f", k2 above {0.45 * sensor.k1**2:.2g}," if not any((sensor.k3, sensor.k4)) else ""
    if is_equidistant(sensor):
        angle, hint = f"sensor.fov_deg = {sensor.fov_deg:g}", ""
    return SettingsError(
        f"sensor.{said}: this lens folds the image{where} at {angle}; use less distortion{hint} "
        "or a smaller field of view"
    )


def _required_margin_px(rig: StereoRig, u_px: Array, v_px: Array) -> int:
    """Return by how much places exceed the image on any side, sampling included."""
    beyond = max(-u_px.min(), u_px.max() - rig.width_px + 1)
    beyond = max(beyond, -v_px.min(), v_px.max() - rig.height_px + 1)
    margin = max(0, math.ceil(beyond + TAPS_PX))
    most = int(MARGIN_MAX * max(rig.width_px, rig.height_px))
    if margin > most:
        raise SettingsError(
            f"sensor.k1 to k6 with calibration.roll_deg, pitch_deg and yaw_deg need {margin} px "
            f"around the image, at most {most} px are rendered; use smaller values"
        )
    return margin


def _edge(rig: StereoRig, pad_px: int) -> Array:
    """(N, 2) outermost pixels; those inside map to the inside of their image."""
    grid = pixel_grid(rig, pad_px)
    return np.concatenate([grid[0], grid[-1], grid[:, 0], grid[:, -1]])
