"""The sensor: exact where nothing is set, and noise, gains and fall-off as the formulas say."""

import dataclasses
import math

import cv2
import numpy as np
import pytest

from sim.camera_settings import SensorSettings
from sim.imaging.auto_exposure import EXPOSURE_MIN_MS, AutoExposure
from sim.imaging.fog import AIRLIGHT, foggy
from sim.imaging.image_sensor import WELL, ImageSensor
from sim.imaging.lens import delivered_to_raw, margin_px, pixel_grid
from sim.imaging.linear_light import (
    LINEAR,
    Encoding,
    Response,
    decode,
    levels_to_light,
    light_to_levels,
    normal_quantiles,
)
from sim.imaging.rain import Drops, draw_drops, rain_visibility_m, streaked
from sim.imaging.resample import sample_variance
from sim.imaging.rescaling import log_of_share, rescale
from sim.imaging.soiling import Soiling
from sim.settings import RecordSettings
from vo.contract.arrays import Array, Image
from vo.contract.rig import StereoRig

RIG = StereoRig(width_px=160, height_px=120, f_px=114, cx_px=79.5, cy_px=59.5, baseline_m=0.09)
LEVELS = np.arange(256, dtype=np.uint8)


def sensor_of(side: int = 0, **sensor: float | str) -> tuple[ImageSensor, StereoRig]:
    settings = RecordSettings(sensor=SensorSettings.model_validate(sensor))
    m = margin_px(settings, RIG)
    size = {"width_px": RIG.width_px + 2 * m, "height_px": RIG.height_px + 2 * m}
    rendered = dataclasses.replace(RIG, **size, cx_px=RIG.cx_px + m, cy_px=RIG.cy_px + m)
    return ImageSensor(settings, 1 if side else 0, RIG, rendered), rendered


def flat(level: int, rig: StereoRig = RIG) -> Image:
    return np.full((rig.height_px, rig.width_px), level, np.uint8)


def exposed(
    image: Image, side: int = 0, brightness: float = 1, gain: float = 1, seed: int = 0,
    **sensor: float | str,
) -> Image:  # fmt: skip
    camera, _ = sensor_of(side, **sensor)
    return camera.expose(decode(image), brightness, gain, np.random.default_rng(seed))


def noise_image(shape: tuple[int, ...] = (120, 160)) -> Image:
    return np.random.default_rng(1).integers(0, 256, shape, np.uint8)


def test_decode_agrees_with_srgb_and_round_trips():
    """sRGB 188 is half the light (IEC 61966-2-1: 0.5029)."""
    assert LINEAR[[0, 255]].tolist() == [0, 1]
    assert LINEAR[188] == pytest.approx(0.5029, abs=1e-4)
    assert LINEAR[5] == pytest.approx(5 / 255 / 12.92)
    np.testing.assert_array_equal(Encoding("srgb")(decode(LEVELS[None])), LEVELS[None])
    assert decode(noise_image((3, 4, 3))).shape == (3, 4, 3)


def test_quantiles_have_standard_normal_moments():
    quantiles = normal_quantiles().astype(float)
    below = [(quantiles < z).mean() for z in (-3.0, -1.0, 0.0, 0.5, 2.0)]
    wanted = [(1 + math.erf(z / math.sqrt(2))) / 2 for z in (-3.0, -1.0, 0.0, 0.5, 2.0)]
    np.testing.assert_allclose(below, wanted, atol=2e-5)
    moments = [(quantiles**k).mean() for k in (1, 2, 3, 4)]
    np.testing.assert_allclose(moments, [0, 1, 0, 3], atol=1e-3)


@pytest.mark.parametrize("response", ["srgb", "linear"])
def test_encoding_gives_the_nearest_level(response: Response):
    light = np.linspace(-0.1, 1.1, 200_001).astype(np.float32)
    ours = Encoding(response)(light[None])[0]
    clipped = np.clip(light.astype(np.float64), 0, 1)
    share = np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)
    exact = 255 * (share if response == "srgb" else clipped)
    clear = np.abs(exact % 1 - 0.5) > 1e-3
    np.testing.assert_array_equal(ours[clear], np.rint(exact)[clear])
    np.testing.assert_allclose(ours, exact, atol=0.501)


@pytest.mark.parametrize("shape", [(120, 160), (120, 160, 3)])
@pytest.mark.parametrize("side", [0, 1])
def test_perfect_sensor_returns_the_image(shape: tuple[int, ...], side: int):
    image = noise_image(shape)
    np.testing.assert_array_equal(exposed(image, side), image)
    np.testing.assert_array_equal(exposed(image, side, brightness=0.5, gain=2), image)
    camera, _ = sensor_of(side)
    assert camera.undistort(image) is image
    assert camera.noise_sigma(1.0).max() < 1e-6


def test_gains_multiply_light_and_clip():
    level = 100
    for kw, factor in (
        ({"brightness": 2.0}, 2.0),
        ({"gain": 1.7}, 1.7),
        ({"gain_db": 6.0}, 10**0.3),
        ({"right_gain": 1.4, "side": 1}, 1.4),
        ({"right_gain": 1.4, "side": 0}, 1.0),
    ):
        out = exposed(flat(level), **kw)  # type: ignore[arg-type]
        assert LINEAR[out[0, 0]] == pytest.approx(LINEAR[level] * factor, rel=0.01)
    assert (exposed(flat(200), brightness=4) == 255).all()


def test_linear_response_is_proportional_to_light():
    out = exposed(np.tile(LEVELS[:160], (120, 1)), response="linear")
    np.testing.assert_array_equal(out[0], np.rint(255 * LINEAR[:160]))


def test_vignetting_darkens_the_corner_by_its_share():
    out = levels_to_light("srgb", exposed(flat(200), vignetting=0.5))
    assert out[60, 80] == pytest.approx(LINEAR[200], rel=0.01)
    for corner in (out[0, 0], out[-1, -1]):
        assert corner == pytest.approx(0.5 * LINEAR[200], rel=0.01)
    r2 = (79.5**2) / (79.5**2 + 59.5**2)
    assert out[60, 0] == pytest.approx((1 - 0.5 * r2) * LINEAR[200], rel=0.01)


def test_softness_is_a_gaussian_blur_up_to_the_border():
    camera, rendered = sensor_of(softness_px=1.2)
    image = noise_image((rendered.height_px, rendered.width_px))
    out = camera.expose(decode(image), 1, 1, np.random.default_rng(0))
    m = (rendered.width_px - RIG.width_px) // 2
    wide = cv2.GaussianBlur(decode(image).astype(np.float64), (21, 21), 1.2)[m:-m, m:-m]
    error = out - Encoding("srgb")(wide.astype(np.float32)).astype(float)
    assert out.shape == (120, 160)
    assert np.abs(error)[8:-8, 8:-8].max() <= 2  # the tail beyond three deviations
    step = np.where(np.arange(rendered.width_px) < rendered.width_px // 2, 0, 255).astype(np.uint8)
    edge = camera.expose(
        decode(np.tile(step, (rendered.height_px, 1))), 1, 1, np.random.default_rng(0)
    )
    spread = np.gradient(levels_to_light("srgb", edge[60]))
    place = np.arange(160)
    mean = (spread * place).sum() / spread.sum()
    deviation = math.sqrt((spread * (place - mean) ** 2).sum() / spread.sum())
    assert deviation == pytest.approx(1.2, abs=0.25)  # the central difference adds 0.2


NOISES = [
    ({"full_well": 8000.0, "read_noise": 12.0}, 1.0, 0),
    ({"full_well": 8000.0, "read_noise": 12.0}, 8.0, 0),
    ({"read_noise": 30.0}, 2.0, 0),
    ({"read_noise": 30.0, "right_noise": 3.0}, 1.0, 1),
    ({"read_noise": 30.0, "right_noise": 3.0}, 1.0, 0),
    ({"full_well": 3000.0, "gain_db": 12.0}, 1.0, 1),
    ({"full_well": 3000.0, "response": "linear"}, 2.0, 0),
]


@pytest.mark.parametrize(("sensor", "gain", "side"), NOISES)
@pytest.mark.parametrize("level", [40, 128, 220])
def test_noise_has_the_variance_of_electrons(
    sensor: dict[str, float | str], gain: float, side: int, level: int
):
    """In light: (G/well) y + (G read/well)^2, written out anew, against 19,200 pixels."""
    response: Response = "linear" if sensor.get("response") == "linear" else "srgb"
    y = float(levels_to_light(response, np.array(level)))
    G = gain * 10 ** (float(sensor.get("gain_db", 0)) / 20)
    well = float(sensor.get("full_well", 0)) or WELL
    read = float(sensor.get("read_noise", 0)) * (float(sensor.get("right_noise", 1)) if side else 1)
    shot = y * well / G if "full_well" in sensor else 0.0
    sigma = G / well * math.sqrt(shot + read**2)
    camera, _ = sensor_of(side, **sensor)
    light = np.full((120, 160), y / G, np.float32)
    out = camera.expose(light, 1.0, gain, np.random.default_rng(2))
    measured = levels_to_light(response, out)
    assert measured.mean() == pytest.approx(y, abs=4 * sigma / math.sqrt(out.size) + 2e-3)
    rounded = math.hypot(camera.noise_sigma(gain)[level], 12**-0.5)
    assert out.std() == pytest.approx(rounded, rel=0.03, abs=0.04)
    width = float(np.diff(levels_to_light(response, np.array([level - 0.5, level + 0.5])))[0])
    if 0.5 * width < sigma < 0.2 * min(y, 1 - y):  # else rounding, bending or clipping rules
        assert measured.std() == pytest.approx(math.hypot(sigma, width / 12**0.5), rel=0.04)


def test_noise_sigma_follows_the_slope_of_the_response():
    assert sensor_of()[0].noise_sigma(1.0).max() < 1e-9
    table = sensor_of(read_noise=1.0, full_well=10_000.0)[0].noise_sigma(1.0)
    y = LINEAR[100]
    slope = 255 * 1.055 / 2.4 * y ** (1 / 2.4 - 1)
    assert table[100] == pytest.approx(slope * math.sqrt(y / 1e4 + 1e-8), rel=0.01)
    assert table[0] < table[50]
    assert table[255] < table[250]  # clipped from above


def test_noise_is_independent_and_repeats_with_its_seed():
    image = np.full((120, 160, 3), 120, np.uint8)
    noise = {"full_well": 2000.0}
    one, two = exposed(image, seed=3, **noise), exposed(image, seed=4, **noise)
    np.testing.assert_array_equal(one, exposed(image, seed=3, **noise))
    for a, b in (
        (one[..., 0], one[..., 1]), (one, two), (one[:, 1:, 0], one[:, :-1, 0])
    ):  # fmt: skip
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 0.03


def test_undistort_lowers_noise_by_sample_variance():
    camera, rendered = sensor_of(k1=-0.2, k2=0.04, full_well=3000.0)
    light = decode(flat(128, rendered))
    rng = np.random.default_rng(5)
    pictures = [camera.undistort(camera.expose(light, 1, 1, rng)) for _ in range(200)]
    measured = np.var(pictures, axis=0, dtype=np.float64) - 1 / 12
    settings = RecordSettings(sensor=SensorSettings(k1=-0.2, k2=0.04))
    u_px, v_px = (
        (a + camera.raw_margin_px).astype(np.float32)
        for a in delivered_to_raw(settings, RIG, pixel_grid(RIG))
    )
    share = sample_variance(np.ones((2, 2), np.float32), u_px, v_px)
    promised = share * (camera.noise_sigma(1.0)[128] ** 2 + 1 / 12)
    assert measured.mean() == pytest.approx(promised.mean(), rel=0.02)
    assert 0.35 < share.min() < 0.5 < 0.9 < share.max() <= 1
    dim, clear = share < np.quantile(share, 0.2), share > np.quantile(share, 0.8)
    assert measured[clear].mean() > 1.5 * measured[dim].mean()


@pytest.mark.parametrize("shape", [(120, 160), (120, 160, 3)])
@pytest.mark.parametrize("k1", [0.1, -0.2])
def test_corrected_undoes_vignetting_and_sensitivity(shape: tuple[int, ...], k1: float):
    settings = {"vignetting": 0.4, "right_gain": 0.8, "k1": k1, "k2": 0.04}
    camera, rendered = sensor_of(1, **settings)
    image = np.full((rendered.height_px, rendered.width_px, *shape[2:]), 180, np.uint8)
    picture = camera.undistort(camera.expose(decode(image), 1, 1, np.random.default_rng(0)))
    assert picture.min() < 150
    np.testing.assert_allclose(camera.corrected(picture)[0], 180, atol=1.5)
    plain, _ = sensor_of(0, right_gain=0.8)
    assert plain.corrected(picture)[0] is picture


@pytest.mark.parametrize("response", ["srgb", "linear"])
def test_rescale_divides_light(response: Response):
    image = np.arange(256, dtype=np.uint8).reshape(16, 16)
    share = np.linspace(0.5, 1.3, 256).reshape(16, 16).astype(np.float32)
    levels, factor = rescale(response, image, log_of_share(share))
    exact = light_to_levels(response, levels_to_light(response, image) / share)
    np.testing.assert_allclose(levels, exact, atol=0.03)
    more = light_to_levels(response, levels_to_light(response, image + 0.5) / share)
    less = light_to_levels(response, levels_to_light(response, image - 0.5) / share)
    inner = (exact > 3) & (exact < 252)
    np.testing.assert_allclose(factor[inner], (more - less)[inner], rtol=0.02)


def test_rescale_clips_shares_beyond_its_table():
    image, share = np.full((1, 4), 100, np.uint8), np.array([[0.0, 1e-9, 1e9, np.nan]], np.float32)
    levels, factor = rescale("srgb", image, log_of_share(share))
    np.testing.assert_allclose(levels[0, [0, 1, 3]], [255, 255, 100], atol=1e-3)
    assert 0 <= levels[0, 2] < 5
    assert np.isfinite(factor).all()


def test_encode_applies_fixed_gain_and_sensitivity():
    camera, _ = sensor_of(1, gain_db=6.0, right_gain=0.9)
    light = np.full((2, 3), 0.2, np.float32)
    expected = levels_to_light("srgb", camera.encode(light))
    np.testing.assert_allclose(expected, 0.2 * 0.9 * 10**0.3, rtol=0.01)


def test_expose_light_of_wrong_size_is_refused():
    camera, _ = sensor_of()
    with pytest.raises(ValueError, match="light of"):
        camera.expose(np.zeros((5, 5), np.float32), 1, 1, np.random.default_rng(0))


def automatic(**sensor: float) -> SensorSettings:
    return SensorSettings.model_validate({"auto_exposure": True, **sensor})


def run(settings: SensorSettings, radiance: Array, painted_ms: float = 5.0) -> Array:
    """Meter uniform scenes of the given (N,) radiance; return (N, 3) ms, gain and mean grey."""
    meter, encode = AutoExposure(settings, painted_ms), Encoding(settings.response)
    rows: list[tuple[float, float, float]] = []
    for level in radiance:
        exposure = meter.next()
        light = np.full((1, 1), level * exposure.brightness * exposure.gain, np.float32)
        grey = float(encode(light).mean())
        meter.update(grey)
        rows.append((exposure.time_ms, exposure.gain, grey))
    return np.array(rows)


@pytest.mark.parametrize("response", ["srgb", "linear"])
@pytest.mark.parametrize("radiance", [0.003, 0.05, 0.5, 20.0])
def test_auto_exposure_reaches_its_target(response: Response, radiance: float):
    settings = automatic(response=response, delay_frames=2)  # type: ignore[arg-type]
    history = run(settings, np.full(40, radiance))
    assert history[-1, 2] == pytest.approx(110, abs=2)
    steps = np.sign(np.diff(np.abs(history[:, 2] - 110)))
    assert (steps <= 0).mean() > 0.9  # it settles, and does not swing


def test_auto_exposure_uses_time_before_gain_within_limits():
    time_ms, gain, grey = run(automatic(exposure_max_ms=12, gain_max_db=20), np.full(40, 0.03))[-1]
    assert time_ms == pytest.approx(12)
    assert 1 < gain < 10
    assert grey == pytest.approx(110, abs=2)
    time_ms, gain, grey = run(automatic(exposure_max_ms=12, gain_max_db=20), np.full(40, 1e-4))[-1]
    assert (time_ms, gain) == pytest.approx((12, 10))
    assert grey < 60
    time_ms, gain, _ = run(automatic(), np.full(60, 1e5))[-1]
    assert (time_ms, gain) == pytest.approx((EXPOSURE_MIN_MS, 1))


@pytest.mark.parametrize("delay", [1, 2, 5])
def test_auto_exposure_responds_after_the_delay(delay: int):
    radiance = np.where(np.arange(60) < 30, 0.15, 0.6)
    history = run(automatic(delay_frames=delay), radiance)
    settled, answered = history[29, 0], np.flatnonzero(history[:, 0] < 0.95 * history[29, 0])
    assert settled == pytest.approx(history[28, 0], rel=0.02)
    assert answered[answered >= 30][0] == 30 + delay
    assert history[-1, 2] == pytest.approx(110, abs=2)


def test_auto_exposure_ahead_of_updates_is_limited():
    meter = AutoExposure(automatic(delay_frames=2), 5.0)
    meter.next()
    meter.next()
    with pytest.raises(IndexError):
        meter.next()


def test_expose_with_more_bits_is_a_finer_image():
    (camera, rendered), (plain, _) = sensor_of(bits=12), sensor_of()
    light = np.linspace(0, 1.2, RIG.height_px * RIG.width_px, dtype=np.float32)
    light = light.reshape(rendered.height_px, rendered.width_px)
    rng = np.random.default_rng(0)
    raw = camera.expose(light, 1, 1, rng)
    exact = light_to_levels("srgb", light) / 255 * 4095
    assert (raw.dtype, raw.max()) == (np.uint16, 4095)
    assert np.abs(raw - exact).max() <= 0.501
    difference = camera.undistort(raw).astype(int) - plain.expose(light, 1, 1, rng)
    assert np.abs(difference).max() <= 1
    assert (difference != 0).mean() < 0.05


def test_expose_noise_of_more_bits_has_the_same_variance():
    camera, rendered = sensor_of(bits=10, full_well=2000.0, read_noise=20.0)
    light = decode(flat(128, rendered))
    raw = camera.expose(light, 1, 1, np.random.default_rng(0))
    sigma = raw.std() / 1023 * 255
    assert sigma == pytest.approx(float(camera.noise_sigma(1.0)[128]), rel=0.03)


@pytest.mark.parametrize("channels", [(), (3,)])
def test_expose_jpeg_is_that_of_opencv_in_blocks(channels: tuple[int, ...]):
    camera, rendered = sensor_of(jpeg_quality=30)
    u = np.arange(rendered.width_px) * np.ones((rendered.height_px, 1))
    image = np.rint(127 + 90 * np.sin(u * u / 700)).astype(np.uint8)
    image = np.stack([image, image // 2, 255 - image], axis=-1) if channels else image
    raw = camera.expose(decode(image), 1, 1, np.random.default_rng(0))
    error = raw.astype(int) - image
    assert raw.shape == image.shape
    assert 1 < np.abs(error).mean() < 8
    inside, across = (np.abs(np.diff(error, axis=1))[:, k::8].mean() for k in (3, 7))
    assert across > 1.2 * inside


def test_jpeg_with_more_than_8_bits_is_refused():
    with pytest.raises(ValueError, match="JPEG has 8 bits"):
        SensorSettings(jpeg_quality=80, bits=12)


def test_two_compressions_are_refused():
    with pytest.raises(ValueError, match="compresses once; set one of both to 0"):
        SensorSettings(jpeg_quality=80, h264_crf=30)
    with pytest.raises(ValueError, match=r"H\.264 has 8 bits"):
        SensorSettings(h264_crf=30, bits=10)


def test_foggy_follows_koschmieder():
    light = np.full((2, 2, 3), 0.5, np.float32)
    range_m = np.array([[0, 10], [20, np.nan]], np.float32)
    found = foggy(light, range_m, 20.0)[..., 0]
    passed = np.array([[1, 0.05**0.5], [0.05, 0]])
    np.testing.assert_allclose(found, 0.5 * passed + AIRLIGHT * (1 - passed), rtol=1e-5)


@pytest.mark.parametrize("channels", [(), (3,)])
def test_chromatic_shift_is_that_of_the_setting_in_the_corner(channels: tuple[int, ...]):
    """Of a radial ramp, red is darker and blue brighter by slope times shift."""
    camera, rendered = sensor_of(chromatic_px=2.0, response="linear", softness_px=0.0)
    u, v = np.meshgrid(np.arange(rendered.width_px), np.arange(rendered.height_px))
    radius = np.hypot(u - rendered.cx_px, v - rendered.cy_px)
    corner = float(np.hypot(rendered.cx_px, rendered.cy_px))
    ramp = (radius / corner).astype(np.float32)
    light = np.repeat(ramp[..., None], 3, axis=2) if channels else ramp
    raw = camera.expose(light, 0.8, 1, np.random.default_rng(0)).astype(float)
    shift = (raw - 255 * 0.8 * (ramp[..., None] if channels else ramp))[20:-20, 20:-20]
    expected = 255 * 0.8 * 2 / corner * ramp[20:-20, 20:-20]
    if channels:
        assert np.abs(shift[..., 1]).max() <= 0.51
        np.testing.assert_allclose(shift[..., 0], -expected, atol=0.7)
        np.testing.assert_allclose(shift[..., 2], expected, atol=0.7)
    else:
        np.testing.assert_allclose(shift, expected * (0.114 - 0.299), atol=0.7)


def test_soiling_is_that_of_its_generator_and_adds_no_light():
    first, again, other = (
        Soiling(0.5, (120, 160), np.random.default_rng(seed))(np.ones((120, 160), np.float32))
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    assert first.max() <= 1.0 + 1e-6
    assert 0.01 < (first < 0.99).mean() < 0.6
    clean = Soiling(0.0, (120, 160), np.random.default_rng(1))
    light = np.random.default_rng(3).random((120, 160, 3), np.float32)
    np.testing.assert_array_equal(clean(light), light)


RAIN_RIG = StereoRig(160, 120, 120.0, 79.5, 59.5, 0.09)
DOWN = np.array([0.0, 1.0, 0.0])


def test_drops_have_the_sizes_and_number_of_their_rain():
    rng = np.random.default_rng(1)
    few, many = (draw_drops(x, RAIN_RIG, 0.01, DOWN, rng) for x in (2.0, 50.0))
    assert len(few.sizes_m) < len(many.sizes_m)
    assert few.sizes_m.mean() < many.sizes_m.mean()
    assert few.sizes_m.min() >= 0.5e-3
    small = many.sizes_m < 0.6e-3  # 2.0 to 2.8 m/s by Atlas, in 10 ms
    assert (many.falls_cam[small, 1] > 0.019).all()
    assert (many.falls_cam[small, 1] < 0.029).all()
    assert 1500 < rain_visibility_m(10.0) < 2500  # 0.312 R^0.67 per km says 2.05 km


def test_streak_is_one_drop_in_both_eyes_and_hidden_by_nearer():
    drops = Drops(np.array([[0.0, 0.0, 1.0]]), np.array([0.004]), np.array([[0.0, 0.1, 0.0]]))
    far, dark = np.full((120, 160), 5.0, np.float32), np.zeros((120, 160), np.uint8)
    left, right = (streaked(dark, far, RAIN_RIG, drops, x) for x in (0.0, 0.09))
    v, u = np.mgrid[:120, :160]
    for image, at in ((left, 79.5), (right, 79.5 - 120 * 0.09)):
        assert (image * u).sum() / image.sum() == pytest.approx(at, abs=0.05)
        assert (image * v).sum() / image.sum() == pytest.approx(59.5, abs=0.05)
        assert np.ptp(np.flatnonzero(image.any(axis=1))) == pytest.approx(12.5, abs=1.5)
        covered = -np.log(1 - image / AIRLIGHT).sum()  # its area, the mean over the exposure
        assert covered == pytest.approx(np.pi / 4 * 0.48**2, rel=0.01)
    near = np.full((120, 160), 0.5, np.float32)
    assert not streaked(dark, near, RAIN_RIG, drops, 0.0).any()
