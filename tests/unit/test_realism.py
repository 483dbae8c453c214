"""Statistics without truth: known noise, blur, vignetting, shift and gain are found again."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from folders import BASELINE_M, DISPARITY_PX, HEIGHT, WIDTH, wall, write_euroc
from scipy.special import erf
from terminal import driftyard

import driftyard as dy
from sim.cameras import camera_values
from sim.imaging.image_sensor import ImageSensor
from sim.imaging.lens import margin_px
from sim.imaging.linear_light import Curve, Encoding, decode, levels_to_light, light_to_levels
from sim.settings import RecordSettings
from trials.evaluation.runs import Tracks
from trials.realism.camera_estimates import (
    RENDERED_PX,
    CameraSetting,
    estimate_drops,
    estimate_light,
    estimate_noise,
    estimate_response,
    estimate_softness,
)
from trials.realism.camera_match import CameraMatch
from trials.realism.comparison import block_draws, compare_measured, distances, summary
from trials.realism.geometry_estimates import FASTEST_MPS, estimate_ground, estimate_motion
from trials.realism.landmarks import cut_patches, histogram, patch_statistics
from trials.realism.match_figure import write_match_figure
from trials.realism.matching import _rig, _with_values
from trials.realism.measure import _histogram, _noise, gradients, measure, power_spectrum
from trials.realism.noise import GREY, measure_blocks
from trials.realism.quantities import QUANTITIES, Measured, Statistic
from trials.realism.saved_measures import saved_measure
from trials.realism.sharpness import edge_profiles, edge_width, edge_widths
from trials.realism.twin_corrections import corrected, fit_curve, with_speed
from trials.realism.twins import Place
from trials.realism.vignetting import LightPairs, vignetting_by_frame
from vo.contract.remarks import Remark
from vo.contract.rig import StereoRig

RIG = StereoRig(320, 240, 200.0, 159.5, 119.5, 0.1)
rng = np.random.default_rng(7)


def texture(shape=(240, 320), cell=8):
    coarse = rng.integers(40, 200, (shape[0] // cell + 2, shape[1] // cell + 2))
    size = (coarse.shape[1] * cell, coarse.shape[0] * cell)
    return cv2.resize(coarse.astype(np.float32), size, interpolation=cv2.INTER_CUBIC)


def rounded(values):
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def test_noise_is_found_at_each_grey_level_despite_texture():
    """Variance 2 + g / 50 on a ramp, half of which is textured."""
    ramp = np.linspace(30, 220, 320) * np.ones((240, 1))
    ramp[:120] += texture()[:120, :320] - 120
    images = [
        ramp + rng.normal(size=ramp.shape) * np.sqrt(2 + ramp.clip(0) / 50) for _ in range(15)
    ]
    found = _noise([measure_blocks(rounded(x)) for x in images])["noise"]
    variance = found.pooled(np.ones((1, 15)))[0]
    known = np.isfinite(variance)
    assert known.sum() >= 9
    expected = 2 + GREY[known] / 50 + 1 / 12
    assert variance[known] == pytest.approx(expected, rel=0.08)


def edge_image(sigma_px, noise=0.004):
    u, v = np.meshgrid(np.arange(320), np.arange(240))
    distance = (u - 160) * np.cos(0.3) + (v - 120) * np.sin(0.3)
    light = 0.25 + 0.2 * erf(distance / sigma_px / np.sqrt(2)) + rng.normal(0, noise, u.shape)
    return rounded(light_to_levels("srgb", light))


@pytest.mark.parametrize("sigma_px", [0.6, 1.3, 2.5])
def test_width_of_a_blurred_edge_is_its_sigma(sigma_px):
    images = [edge_image(sigma_px) for _ in range(2)]
    widths = np.concatenate(edge_widths([edge_profiles(x, decode(x)) for x in images]))
    assert edge_width(widths) == pytest.approx(sigma_px, rel=0.05, abs=0.08)  # 0.6 is undersampled


def test_texture_and_blank_images_have_no_edges():
    blank = np.full((60, 80), 90, np.uint8)
    assert np.isnan(edge_width(edge_widths([edge_profiles(blank, decode(blank))])[0]))
    noise = rng.integers(0, 255, (120, 160), dtype=np.uint8)
    assert len(edge_widths([edge_profiles(noise, decode(noise))])[0]) < 5


@pytest.mark.parametrize("vignetting", [0.0, 0.4])
def test_vignetting_is_found_despite_gain_and_outliers(vignetting):
    r2 = rng.uniform(0, 0.9, (4000, 2))
    shares = 1 - vignetting * r2
    log_ratio = np.log(0.8 * shares[:, 1] / shares[:, 0]) + rng.normal(0, 0.02, 4000)
    log_ratio[::10] += rng.normal(0, 2, 400)
    pairs = LightPairs(r2, log_ratio, np.zeros(4000, int), np.arange(4000) // 100)
    weights, weighted = vignetting_by_frame(pairs, 40)
    assert weighted.sum() / weights.sum() == pytest.approx(vignetting, abs=0.004)
    assert not vignetting_by_frame(LightPairs(*(x[:50] for x in vars(pairs).values())), 1)[0].any()


def test_patches_have_the_known_residual_gain_and_fall_off():
    """Noise of 3 grey levels in both eyes, 10 % less light in the right one, vignetting 0.3."""
    scene = decode(rounded(texture((240, 380))[:240, :380]))
    v, u = np.mgrid[:240, :320]
    r2 = ((u - 159.5) ** 2 + (v - 119.5) ** 2) / (159.5**2 + 119.5**2)
    pixels = np.stack(np.meshgrid(np.arange(60, 310, 9), np.arange(10, 230, 9)), -1).reshape(-1, 2)
    patches, sigma = [], 3.0
    for i in range(2):
        light = scene[:, :320] * (1 - 0.3 * r2), 0.9 * scene[:, 40:360] * (1 - 0.3 * r2)
        images = tuple(
            rounded(light_to_levels("srgb", x) + rng.normal(0, sigma, r2.shape)) for x in light
        )
        ids = np.arange(len(pixels))
        full = np.full(len(ids), 40.0), np.ones(len(ids), bool)
        tracks = Tracks(ids, np.full(len(ids), i), pixels.astype(float), *full)
        patches.append(cut_patches(images, tracks, i, decode))
    found = patch_statistics(patches, RIG)
    pooled = {name: x.pooled(np.ones((1, 2)))[0] for name, x in found.items()}
    assert pooled["vignetting"][0] == pytest.approx(0.3, abs=0.03)
    assert pooled["right_gain"][0] == pytest.approx(0.9, abs=0.01)
    residual = pooled["residual"] @ QUANTITIES["residual"].x
    assert residual == pytest.approx(sigma * 2**0.5, rel=0.05)


def test_power_spectrum_of_white_noise_is_its_variance():
    spectrum = power_spectrum(rounded(rng.normal(128, 5, (256, 256))))
    assert spectrum[1:] == pytest.approx(np.full(15, 25 + 1 / 12), rel=0.15)
    wave = 128 + 50 * np.sin(2 * np.pi * 0.25 * np.arange(64)) * np.ones((64, 1))
    assert np.argmax(power_spectrum(rounded(wave))) == 7  # of 8/32
    assert len(power_spectrum(np.zeros((20, 40), np.uint8))) == 0


def test_distances_are_those_of_their_kinds():
    grey = QUANTITIES["grey"]
    real, shifted = np.zeros((1, 256)), np.zeros((1, 256))
    real[0, [100, 120]] = 0.5  # a standard deviation of 10
    shifted[0, [130, 150]] = 0.5
    assert distances(grey, real, shifted) == pytest.approx(3)
    noise = QUANTITIES["noise"]
    assert distances(noise, np.ones((1, 16)), np.full((1, 16), 2.0)) == pytest.approx(np.log(2))
    half = np.where(np.arange(16) < 8, 2.0, np.nan)[None]
    assert distances(noise, np.ones((1, 16)), half) == pytest.approx(np.log(2))
    one = np.array([[0.3]])
    assert distances(QUANTITIES["vignetting"], one, one - 0.4) == pytest.approx(0.4)


def test_bootstrap_gives_the_standard_error_of_a_mean():
    values = np.random.default_rng(1).normal(10, 2, 2000)
    statistic = Statistic(values[:, None], np.ones((2000, 1)))
    means = statistic.pooled(block_draws(2000, np.random.default_rng(0)))[:, 0]
    assert means.std() == pytest.approx(2 / 2000**0.5, rel=0.25)


CAMERA = {"full_well": 6000.0, "read_noise": 20.0, "softness_px": 1.3, "vignetting": 0.35}


def patches_and_images(frames, sensor):
    """Pictures of stripes by the simulated camera, the right eye's shifted by 40 px."""
    settings = RecordSettings.model_validate({"sensor": sensor})
    m = margin_px(settings, RIG)
    size = {"width_px": RIG.width_px + 2 * m, "height_px": RIG.height_px + 2 * m}
    wide = replace(RIG, **size, cx_px=RIG.cx_px + m, cy_px=RIG.cy_px + m)
    v, u = np.mgrid[: wide.height_px, : wide.width_px + 40]
    levels = np.array([0.05, 0.3, 0.12, 0.6, 0.2, 0.45, 0.08, 0.5])
    light = levels[((u + 0.3 * v) // 55).astype(int) % 8].astype(np.float32)
    light = cv2.GaussianBlur(light, (0, 0), RENDERED_PX)
    eyes = light[:, : wide.width_px], light[:, 40:]
    cameras = [ImageSensor(settings, k, RIG, wide) for k in (0, 1)]
    pixels = np.stack(np.meshgrid(np.arange(60, 310, 9), np.arange(10, 230, 9)), -1).reshape(-1, 2)
    ids, images, patches = np.arange(len(pixels)), [], []
    for i in range(frames):
        pair = tuple(x.expose(y, 1, 1, rng) for x, y in zip(cameras, eyes, strict=True))
        full = np.full(len(ids), 40.0), np.ones(len(ids), bool)
        tracks = Tracks(ids, np.full(len(ids), i), pixels.astype(float), *full)
        patches.append(cut_patches(pair, tracks, i, decode))
        images.append(pair[0])
    return patches, images


def measured_pictures(sensor):
    patches, images = patches_and_images(20, sensor)
    widths = edge_widths([edge_profiles(x, decode(x)) for x in images[:5]])
    widths += [np.zeros(0)] * 15
    statistics = {
        "grey": Statistic(np.array([np.bincount(x.ravel(), minlength=256) for x in images], float)),
        "gradient": Statistic(np.array([gradients(x) for x in images])),
        "power": Statistic(np.array([power_spectrum(x) for x in images]), np.ones((20, 1))),
        **_noise([measure_blocks(x) for x in images]),
        "edge_width": _histogram("edge_width", widths),
        **patch_statistics(patches, RIG),
    }
    return Measured("twin", 20, statistics, tuple(images[:3]))


@pytest.fixture(scope="module")
def pictures():
    return measured_pictures(CAMERA)


def test_camera_is_found_again_from_its_pictures(pictures):
    measured = pictures
    assert estimate_response(measured) == "srgb"
    found = [*estimate_noise(measured, "srgb"), estimate_softness(measured)]
    found += estimate_light(measured)
    for setting in found[:4]:
        true = CAMERA[setting.key.removeprefix("sensor.")]
        assert setting.value == pytest.approx(true, rel=0.1), setting
        assert setting.low < true < setting.high, setting
    assert found[4].key == "sensor.right_gain"
    assert found[4].value == pytest.approx(1, abs=0.01)


def test_twin_with_another_camera_corrects_it(pictures):
    wrong = {"full_well": 4000.0, "read_noise": 30.0, "softness_px": 0.9, "vignetting": 0.1}
    wrong["right_gain"] = 0.9
    values = {f"sensor.{key}": x for key, x in wrong.items()}
    found = corrected(values, pictures, measured_pictures(wrong))
    for key, true in CAMERA.items():
        near = 0.3 if key == "read_noise" else 0.1
        assert found[f"sensor.{key}"] == pytest.approx(true, rel=near), key
    assert found["sensor.right_gain"] == pytest.approx(1, abs=0.015)


def test_twin_that_is_too_slow_corrects_speed_or_rate(pictures):
    values = {"drive.speed_mps": 0.3, "rig.rate_hz": 10.0}
    real, twin = (
        replace(
            pictures,
            statistics={
                **pictures.statistics,
                "motion": histogram("motion", np.full(99, px), np.zeros(99, int), pictures.frames),
            },
        )
        for px in (4.0, 3.0)
    )
    found = with_speed(values, real, twin)
    assert (found["drive.speed_mps"], found["rig.rate_hz"]) == pytest.approx((0.4, 10), rel=0.05)
    found = with_speed(values | {"drive.speed_mps": FASTEST_MPS}, real, twin)
    expected = FASTEST_MPS, 7.5
    assert (found["drive.speed_mps"], found["rig.rate_hz"]) == pytest.approx(expected, rel=0.05)
    assert "drive.speed_mps" not in with_speed(values, pictures, twin)


def test_curve_of_a_camera_is_fitted_to_its_pictures(pictures):
    table = light_to_levels(
        Curve("srgb", 1.5, 15.0, 230.0), levels_to_light("srgb", np.arange(256))
    )
    images = [np.rint(table)[x].astype(np.uint8) for x in pictures.pictures]
    statistics = {
        "grey": Statistic(np.array([np.bincount(x.ravel(), minlength=256) for x in images], float)),
        "gradient": Statistic(np.array([gradients(x) for x in images])),
        "power": Statistic(np.array([power_spectrum(x) for x in images]), np.ones((3, 1))),
    }
    real = Measured("real", 3, statistics, tuple(images))
    far = {"grey": 0.5, "gradient": 0.5, "power": 0.5}
    curve = fit_curve(real, pictures, Curve(), far)
    assert 1.2 < curve.gamma < 1.7
    levels = light_to_levels(curve, levels_to_light("srgb", np.arange(256)))
    mean = levels @ pictures.estimate("grey")
    assert mean == pytest.approx(summary(real, "grey"), abs=3)


def test_levels_of_a_curve_convert_to_light_and_back():
    curve, levels = Curve("srgb", 0.7, 20.0, 230.0), np.arange(231.0)
    assert light_to_levels(curve, levels_to_light(curve, levels)) == pytest.approx(levels)
    encode, light = Encoding(curve), np.linspace(-0.1, 1.2, 999, dtype=np.float32)
    assert (encode(light.clip(0)) == light_to_levels(curve, light.clip(0)).round()).all()
    black = encode.encode_noisy(np.zeros(50_000, np.float32), 0, 1e-6, rng)
    assert black.mean() == pytest.approx(20, abs=0.3)  # noise is on both sides of no light
    assert black.min() < 10
    sensor = {"black_grey": 20.0, "gamma": 0.7, "full_well": 5000.0, "read_noise": 20.0}
    settings = RecordSettings.model_validate({"sensor": sensor})
    sigma = ImageSensor(settings, 0, RIG, RIG).noise_sigma(1.0)
    assert np.isfinite(sigma).all()
    assert sigma[21] > 1


def test_ground_has_the_height_and_the_tilt_of_the_camera():
    """A plane 0.5 m below a camera that looks down by 20 degrees, and a wall 3 m ahead."""
    u, v = rng.uniform(0, 319, 600), rng.uniform(0, 239, 600)
    x, y = (u - RIG.cx_px) / RIG.f_px, (v - RIG.cy_px) / RIG.f_px
    down, along = np.cos(np.radians(20)), np.sin(np.radians(20))
    inverse_depth = np.maximum((down * y + along) / 0.5, 1 / 3)
    disparity = RIG.f_px * RIG.baseline_m * inverse_depth + rng.normal(0, 0.1, 600)
    points = np.column_stack([u, v, disparity])
    height, tilt = estimate_ground(points, RIG)
    assert height.value == pytest.approx(0.5, rel=0.03)
    assert tilt.value == pytest.approx(20, abs=1)
    assert estimate_ground(points[:20], RIG)[0].value is None
    points[:, 2] = 5 + x
    assert estimate_ground(points, RIG)[0].note == "no level ground is seen"


def test_speed_is_that_of_the_steps_and_slowed_with_the_rate():
    halting = np.r_[np.full(20, 0.03), np.zeros(8)]
    speed, rate = estimate_motion(halting, 0.1)
    assert (speed.value, rate.value) == pytest.approx((0.3, 10))
    speed, rate = estimate_motion(np.full(9, 1.2), 0.1)
    expected = FASTEST_MPS, FASTEST_MPS / 1.2
    assert (speed.value, rate.value) == pytest.approx(expected, rel=1e-3)
    assert "12 m/s at 10 Hz" in speed.note
    assert [x.key for x in estimate_motion(np.zeros(5), 0.1)] == ["rig.rate_hz"]


def test_intervals_move_with_corrected_values():
    found = CameraMatch("real", [CameraSetting("sensor.softness_px", 1.0, 0.8, 1.3, "")])
    moved = _with_values(found, {"sensor.softness_px": 0.9, "sensor.gamma": 1.2})
    assert moved.estimates[0].text == "0.9 (0.7 to 1.2)"
    assert moved.values["sensor.gamma"] == 1.2
    assert "corrected" in moved.estimates[0].note


def test_command_of_a_twin_names_its_place_and_layout():
    assert CameraMatch("real", []).twin_command("c.toml") == ""
    place = Place("sandbox", ("scene.surround=hall",))
    found = CameraMatch("real", [], {place.label: 0.3}, place=place, seeds=[2, 0, 1])
    words = "driftyard generate sandbox --camera 'my c.toml' --set scene.surround=hall --seed 2"
    assert found.twin_command("my c.toml") == f"{words} --out twin"
    assert "# A recording of it: " + words.replace("'my c.toml'", "THIS_FILE") in found.toml()


def test_linear_response_shows_in_the_noise():
    _, images = patches_and_images(30, {"full_well": 3000.0, "response": "linear"})
    measured = Measured("twin", 30, _noise([measure_blocks(x) for x in images]))
    assert estimate_response(measured) == "linear"
    full_well, read_noise = estimate_noise(measured, "linear")
    assert full_well.value == pytest.approx(3000, rel=0.1)
    assert read_noise.value < 15


def test_lost_frames_are_found_from_times():
    times = np.delete(np.arange(100) * 50_000_000, [3, 4, 50, 80, 81])
    assert estimate_drops(times).value == pytest.approx(0.05)
    assert estimate_drops(times[:1]).value is None


@pytest.fixture(scope="module")
def walls(tmp_path_factory):
    """A wall that moves by 4 px a frame, one that is dark, and a single pair."""
    root = tmp_path_factory.mktemp("walls")
    pairs = wall(8)
    write_euroc(root / "wall", pairs)
    write_euroc(root / "dark", [tuple(x // 128 for x in pair) for pair in pairs])
    write_euroc(root / "single", pairs[:1])
    return root


def test_known_shift_is_disparity_motion_and_track_length(walls):
    found = measure(walls / "wall", 100)
    assert found.frames == 8
    means = {name: summary(found, name) for name in ("disparity", "motion", "track_length")}
    assert means["disparity"] == pytest.approx(DISPARITY_PX, abs=0.3)
    assert means["motion"] == pytest.approx(4, abs=0.3)
    assert 2 < means["track_length"] <= 8
    same = compare_measured(found, found)
    assert {x.value for x in same.distances.values()} <= {0.0, None}
    assert same.distances["disparity"].error < 0.1


def test_dark_recording_says_why_by_quantity_others_go_on(walls, tmp_path):
    page = tmp_path / "page.html"
    found = dy.compare(walls / "wall", walls / "dark", page)
    assert found.distances["grey"].value > 1
    assert found.distances["power"].value > 1
    assert found.distances["disparity"].value is None
    assert found.distances["disparity"].reason.startswith("dark: the estimator follows too few")
    assert "too few landmarks" in page.read_text()


def test_kept_statistics_are_those_that_were_measured(walls, tmp_path, monkeypatch):
    first = saved_measure(walls / "wall", 3, tmp_path)
    monkeypatch.setattr("trials.realism.saved_measures.measure", None)
    again = saved_measure(walls / "wall", 3, tmp_path)
    assert again.statistics.keys() == first.statistics.keys()
    for name, x in first.statistics.items():
        assert np.array_equal(again.statistics[name].parts, x.parts)
        assert (again.statistics[name].weights is None) == (x.weights is None)
    assert (again.name, again.frames, again.baseline_m) == ("wall", 3, first.baseline_m)
    assert np.array_equal(again.landmarks, first.landmarks)
    assert np.array_equal(again.pictures, first.pictures)


def test_damaged_image_costs_its_frame_alone(walls):
    write_euroc(walls / "damaged", wall(3))
    file = sorted((walls / "damaged/mav0/cam1/data").iterdir())[1]
    file.write_bytes(file.read_bytes()[:100])
    with pytest.warns(Remark, match="1 of 3 frames"):
        found = measure(walls / "damaged", 3)
    assert found.statistics["grey"].parts.sum() == 2 * WIDTH * HEIGHT
    assert found.statistics["power"].weights.sum() == 2
    assert found.statistics["features"].weights.sum() == 2


def test_figure_shows_the_ratios_of_both_distances(walls, tmp_path):
    real, *others = (measure(walls / x, 2) for x in ("wall", "single", "dark"))
    near, far = (compare_measured(real, x) for x in others)
    match = CameraMatch("wall", [], {"office": 0.1}, near, far)
    assert match.ratios["grey"] < 0.1
    assert "grey" not in match.undecided
    write_match_figure(match, tmp_path / "match.png")
    assert cv2.imread(str(tmp_path / "match.png")).shape[1] > 1000
    with pytest.raises(dy.SettingsError, match=r"name it match\.png"):
        write_match_figure(match, tmp_path / "match.jpg")


def test_low_camera_is_enlarged_to_the_height_of_the_rover(walls):
    points = np.column_stack(
        [np.tile(np.arange(0, 240, 8.0), 10), np.repeat(np.arange(100, 180, 8.0), 30)]
    )
    disparity = (points[:, 1] - 89.5) * 0.1 / 0.14  # a plane 0.14 m below
    measured = Measured("low", 3, {}, (), np.column_stack([points, disparity]), np.full(2, 0.01))
    found = {x.key: x.value for x in _rig(dy.open(walls / "wall").sequence, measured)}
    assert found["rig.height_m"] == pytest.approx(0.35)
    assert found["rig.baseline_m"] == pytest.approx(0.25, abs=1e-3)
    assert found["drive.speed_mps"] == pytest.approx(0.25, abs=1e-3)  # 0.01 m in 0.1 s, enlarged


def test_single_frame_has_distances_without_errors(walls):
    found = dy.compare(walls / "single", walls / "wall")
    assert found.distances["gradient"].value == pytest.approx(0, abs=1e-9)
    assert found.distances["gradient"].error is None
    assert found.distances["motion"].reason.startswith("single and wall: the estimator")


def test_match_writes_a_camera_and_says_what_is_missing(walls):
    done = driftyard("match", "wall", "--no-scenes", "--out", "camera.toml", cwd=walls)
    assert "not matched: sensor.full_well: no grey level has enough flat" in done.stdout, (
        done.stderr
    )
    values = camera_values(str(walls / "camera.toml"))
    assert (values["rig.width_px"], values["rig.baseline_m"]) == (WIDTH, BASELINE_M)
    assert values["rig.rate_hz"] == 10
    assert "sensor.full_well" not in values
    done = driftyard("match", "wall", "--scenes", "moon", cwd=walls)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)


def test_command_prints_json_or_writes_a_page(walls):
    both = ("compare", "wall", "single")
    done = driftyard(*both, "--json", cwd=walls)
    assert json.loads(done.stdout)["quantities"]["grey"]["distance"] == 0, done.stderr
    assert "grey level" in driftyard(*both, "--out", "c.html", cwd=walls).stdout
    assert "<svg" in (walls / "c.html").read_text()
    assert driftyard("compare", "wall", "nowhere", cwd=walls).returncode == 2
