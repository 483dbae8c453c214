"""Lens, margin and calibration errors against OpenCV and against hand-turned cameras."""

import dataclasses
import math

import cv2
import numpy as np
import pytest

from sim.camera_settings import CalibrationSettings, SensorSettings
from sim.imaging.distortion import coefficients as listed
from sim.imaging.distortion import distort, undistort
from sim.imaging.image_sensor import ImageSensor
from sim.imaging.lens import (
    delivered_rig,
    delivered_to_raw,
    margin_px,
    miscalibration_rotation,
    pixel_grid,
    raw_focal_px,
    raw_margin_px,
    raw_pixels,
    raw_rays,
    raw_to_nominal,
)
from sim.imaging.linear_light import decode
from sim.settings import RecordSettings, RigSettings
from vo.contract.arrays import Array, Image
from vo.contract.errors import CalibrationError, SettingsError
from vo.contract.rig import StereoRig

RIG = StereoRig(width_px=160, height_px=120, f_px=114, cx_px=79.5, cy_px=59.5, baseline_m=0.09)
UNTURNED: Array = np.eye(3)
SMALL = RigSettings(width_px=160, height_px=120)
LENSES = {
    "barrel": SensorSettings(k1=-0.28, k2=0.07),
    "pincushion": SensorSettings(k1=0.12, k2=-0.02),
    "decentred": SensorSettings(k1=-0.1, k2=0.02, p1=0.004, p2=-0.003),
    "five": SensorSettings(k1=-0.3, k2=0.15, k3=-0.01, p1=0.001),
    "rational": SensorSettings(k1=0.5, k2=-2.7, k3=1.6, k4=0.39, k5=-2.5, k6=1.5, p1=0.0005),
}


def widened(rig: StereoRig, margin: int) -> StereoRig:
    return dataclasses.replace(
        rig,
        width_px=rig.width_px + 2 * margin,
        height_px=rig.height_px + 2 * margin,
        cx_px=rig.cx_px + margin,
        cy_px=rig.cy_px + margin,
    )


def coefficients(lens: SensorSettings) -> Array:
    return np.array(listed(lens))


def recording(lens: SensorSettings, **calibration: float) -> RecordSettings:
    return RecordSettings(rig=SMALL, sensor=lens, calibration=CalibrationSettings(**calibration))


def pixels() -> Array:
    v, u = np.mgrid[:120:7, :160:7].astype(float)
    return np.stack([u, v], axis=-1)


@pytest.mark.parametrize("name", LENSES)
def test_distort_agrees_with_opencv(name: str):
    lens, points = LENSES[name], RIG.normalized(pixels())
    rays = np.dstack([points, np.ones(points.shape[:2])]).reshape(-1, 3)
    theirs, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), RIG.K, coefficients(lens))
    ours = distort(lens, points).reshape(-1, 2) * RIG.f_px + (RIG.cx_px, RIG.cy_px)
    np.testing.assert_allclose(ours, theirs[:, 0], atol=1e-9)


@pytest.mark.parametrize("name", LENSES)
def test_raw_to_nominal_agrees_with_opencv(name: str):
    lens = LENSES[name]
    u, v = raw_to_nominal(lens, RIG, np.eye(3), pixel_grid(RIG))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    rays = cv2.undistortPoints(
        pixels().reshape(-1, 1, 2), RIG.K, coefficients(lens), None, None, None, criteria
    )
    theirs = rays.reshape(*pixels().shape) * RIG.f_px + (RIG.cx_px, RIG.cy_px)
    np.testing.assert_allclose(np.dstack([u, v])[::7, ::7], theirs, atol=0.02)
    np.testing.assert_allclose(distort(lens, undistort(lens, rays)), rays, atol=1e-9)


def test_undistort_beyond_the_fold_is_nan():
    lens = SensorSettings(k1=-0.3)
    furthest = 2 / 3 * math.sqrt(1 / 0.9)  # r - 0.3 r^3 at its maximum
    inside, outside = undistort(lens, np.array([[furthest - 0.01, 0], [furthest + 0.01, 0]]))
    assert 0.9 < inside[0] < math.sqrt(1 / 0.9)
    assert np.isnan(outside).all()


def texture(rig: StereoRig, R_nominal_eye: Array = UNTURNED) -> Image:
    """A smooth pattern on the sphere of directions, so that any camera can look at it."""
    v, u = np.indices((rig.height_px, rig.width_px))
    ray = np.stack([*np.moveaxis(rig.normalized(np.dstack([u, v])), -1, 0), np.ones(u.shape)], -1)
    x, y, z = np.moveaxis(ray @ R_nominal_eye.T, -1, 0)
    grey = 128 + 60 * np.sin(12 * x / z) * np.cos(9 * y / z) + 30 * np.sin(15 * (x + y) / z)
    return np.rint(grey).astype(np.uint8)


def taken(settings: RecordSettings, side: int) -> tuple[ImageSensor, Image]:
    """A rectified picture of the pattern."""
    rendered = widened(RIG, margin_px(settings, RIG))
    sensor = ImageSensor(settings, 1 if side else 0, RIG, rendered)
    chip = sensor.expose(decode(texture(rendered)), 1.0, 1.0, np.random.default_rng(0))
    return sensor, sensor.undistort(chip)


@pytest.mark.parametrize("name", LENSES)
def test_rectified_distorted_image_is_the_pinhole_image(name: str):
    sensor, picture = taken(recording(LENSES[name]), 0)
    error = picture.astype(float) - texture(RIG)
    assert picture.shape == (120, 160)
    assert np.abs(error).max() < 4
    assert 0 < np.sqrt((error**2).mean()) < 0.8  # rounding thrice leaves 0.5
    assert (sensor.raw_margin_px > 2) == (name in ("pincushion", "rational"))


@pytest.mark.parametrize("angle", ["roll_deg", "pitch_deg", "yaw_deg"])
def test_miscalibration_turns_only_the_right_image(angle: str):
    settings = recording(SensorSettings(), **{angle: 2.0})
    np.testing.assert_array_equal(taken(settings, 0)[1], texture(RIG))
    turned = texture(RIG, miscalibration_rotation(settings.calibration))
    error = taken(settings, 1)[1].astype(float) - turned
    assert np.abs(error).max() <= 2
    assert np.abs(turned.astype(float) - texture(RIG)).mean() > 2


def test_miscalibration_angles_have_the_stated_signs():
    """Upwards: -y. To the right: +x. Clockwise as seen: the camera's right side goes down."""
    forward, right = np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
    assert (miscalibration_rotation(CalibrationSettings(pitch_deg=5)) @ forward)[1] < -0.08
    assert (miscalibration_rotation(CalibrationSettings(yaw_deg=5)) @ forward)[0] > 0.08
    assert (miscalibration_rotation(CalibrationSettings(roll_deg=5)) @ right)[1] > 0.08


def test_wrong_focal_length_still_fills_the_image():
    settings = recording(LENSES["barrel"], focal_percent=5)
    u, v = delivered_to_raw(settings, RIG, pixel_grid(RIG))
    delivered = delivered_rig(RIG, settings.calibration)
    theirs = cv2.initUndistortRectifyMap(
        delivered.K, coefficients(LENSES["barrel"]), None, delivered.K, (160, 120), cv2.CV_32FC1
    )
    np.testing.assert_allclose([u, v], theirs, atol=1e-3)


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("yaw_deg", [0.0, 3.0])
def test_margin_is_the_smallest_that_lights_all_pixels(name: str, yaw_deg: float):
    settings = recording(LENSES[name], yaw_deg=yaw_deg, pitch_deg=-1.0)
    margin, pad = margin_px(settings, RIG), raw_margin_px(settings, RIG)
    u, v = delivered_to_raw(settings, RIG, pixel_grid(RIG))
    assert min(u.min(), v.min()) + pad >= 1
    assert max(u.max() - 159, v.max() - 119) - pad <= -1
    needed = -math.inf
    for R in (np.eye(3), miscalibration_rotation(settings.calibration)):
        u, v = raw_to_nominal(settings.sensor, RIG, R, pixel_grid(RIG, pad))
        needed = max(needed, -u.min(), -v.min(), u.max() - 159, v.max() - 119)
    assert needed + 1 < margin < needed + 4


def test_margin_of_softness_is_the_psf_radius():
    assert margin_px(recording(SensorSettings(softness_px=1.5)), RIG) == 5
    assert margin_px(recording(SensorSettings()), RIG) == 0


@pytest.mark.parametrize(
    ("lens", "calibration", "message"),
    [
        ({"k1": -0.5}, {}, "sensor.k1 = -0.5.*folds.*rig.hfov_deg"),
        ({}, {"yaw_deg": 40}, "calibration.roll_deg, pitch_deg and yaw_deg need"),
        ({"k1": -0.2, "k2": -0.2}, {}, "folds"),
    ],
)
def test_lens_that_folds_is_refused(
    lens: dict[str, float], calibration: dict[str, float], message: str
):
    with pytest.raises(SettingsError, match=message) as refusal:
        margin_px(recording(SensorSettings(**lens), **calibration), RIG)
    assert "\n" not in str(refusal.value)


def test_calibration_errors_scale_the_delivered_rig():
    rig = delivered_rig(RIG, CalibrationSettings(baseline_percent=2, focal_percent=-1))
    assert rig.baseline_m == pytest.approx(0.0918)
    assert rig.f_px == pytest.approx(112.86)
    assert (rig.cx_px, rig.width_px) == (79.5, 160)
    for name in ("baseline_percent", "focal_percent"):
        with pytest.raises(CalibrationError, match="must be positive"):
            margin_px(recording(SensorSettings(), **{name: -100.0}), RIG)


FISHEYE = SensorSettings(lens="equidistant", k1=0.02, k2=-0.01, k3=0.004, k4=-0.001)


def directions(widest_deg: float) -> Array:
    """Unit rays up to an angle from the axis, (N, 3)."""
    angle, around = np.meshgrid(
        np.radians(np.linspace(0, widest_deg, 30)), np.linspace(0, 2 * math.pi, 17)
    )
    rays = [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)]
    return np.stack(rays, axis=-1).reshape(-1, 3)


def test_fisheye_agrees_with_opencv():
    rays = directions(85)
    K = RIG.K.copy()
    K[0, 0] = K[1, 1] = raw_focal_px(FISHEYE, RIG)
    theirs = cv2.fisheye.projectPoints(
        rays[:, None], np.zeros(3), np.zeros(3), K, coefficients(FISHEYE)
    )[0][:, 0]
    np.testing.assert_allclose(raw_pixels(FISHEYE, RIG, rays), theirs, atol=1e-6)


@pytest.mark.parametrize("lens", [FISHEYE, *LENSES.values()])
def test_raw_rays_invert_raw_pixels(lens: SensorSettings):
    rays = directions(95 if lens is FISHEYE else 38)
    pixels = raw_pixels(lens, RIG, rays)
    np.testing.assert_allclose(raw_rays(lens, RIG, pixels), rays, atol=1e-8)


def test_fisheye_field_of_view_is_that_of_the_setting():
    """Also behind the image plane, and dark beyond 95 degrees."""
    lens = FISHEYE.model_copy(update={"fov_deg": 190.0})
    edge = raw_rays(lens, RIG, np.array([159.5, RIG.cy_px]))
    assert math.degrees(math.atan2(edge[0], edge[2])) == pytest.approx(95, abs=1e-6)
    outside = np.array([[161.0, RIG.cy_px], [159, 119]])
    assert np.isnan(raw_rays(lens, RIG, outside)).all()
    assert np.isnan(raw_pixels(lens, RIG, np.array([1.0, 0, math.tan(math.radians(-6))]))).all()


@pytest.mark.parametrize(
    ("lens", "message"),
    [
        ({"lens": "equidistant", "k1": -0.2}, "sensor.k1 = -0.2.*folds the image.* 87 px from"),
        (
            {"lens": "equidistant", "k4": -0.9},
            "folds the image 44 degrees from its axis at sensor.fov",
        ),
        ({"k1": -0.2, "k2": 0.02, "k3": -0.6}, "folds the image.* px from its centre at rig.hfov"),
        ({"k4": -2.0}, "folds"),
    ],
)
def test_fold_is_refused_with_its_radius(lens: dict[str, float | str], message: str):
    with pytest.raises(SettingsError, match=message):
        margin_px(recording(SensorSettings.model_validate(lens)), RIG)


def test_equidistant_lens_is_refused_with_filament():
    with pytest.raises(ValueError, match=r"by render\.engine = classic only"):
        RecordSettings.model_validate({"render": {"engine": "filament"}, "sensor": FISHEYE})


def test_equidistant_lens_refuses_other_coefficients():
    with pytest.raises(ValueError, match=r"sensor\.p1 = 0\.01: an equidistant lens has k1, k2"):
        SensorSettings(lens="equidistant", p1=0.01)
