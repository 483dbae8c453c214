"""Errors of a stereo calibration are found again from the rows of points that both cameras see."""

from dataclasses import replace

import numpy as np
import pytest

from vo.calibration.clock_offset import estimate_clock_offset
from vo.calibration.self_calibration import SelfCalibration
from vo.calibration.stereo_errors import StereoSamples, estimate_errors
from vo.config import THESIS, OdometrySettings
from vo.contract.rig import StereoRig
from vo.recording_calibration import Calibration
from vo.recordings.calibration import read_cameras
from vo.recordings.rectify import rectify
from vo.stereo.right_camera import RightCamera, StereoErrors

RIG = StereoRig(320, 240, 229.0, 159.5, 119.5, 0.09)
FRAMES, POINTS = 12, 1200
NOISE_PX = 0.1


def seen(errors, seed=0, shake=0.0):
    """Points that a moving pair with these errors sees; its velocities are known but for shake."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform([5, 5], [314, 234], (POINTS, 2))
    disparity_px, frame = rng.uniform(3, 15, POINTS), np.arange(POINTS) * FRAMES // POINTS
    velocity = rng.normal(0, [0.05, 0.05, 0.05, 0.1, 0.3, 0.1], (FRAMES, 6))
    velocity[:, 2] += 0.3
    true = velocity + shake * rng.normal(size=(FRAMES, 1)) * [0, 0, 0, 1, 0, 0]
    right = RightCamera(errors, RIG, true[frame]).see(pixels, disparity_px)
    right += rng.normal(0, NOISE_PX, right.shape)
    return StereoSamples(pixels, right, velocity[frame], frame)


@pytest.mark.parametrize(
    "given",
    [
        {"pitch_rad": 0.0009},
        {"pitch_rad": -0.017, "roll_rad": 0.017},
        {"roll_rad": 0.002, "delay_s": -0.004},
        {"delay_s": 0.008},
        {"keystone_rad": -0.01, "pitch_rad": 0.002},
    ],
    ids=lambda given: ",".join(given),
)
def test_injected_errors_are_found_within_their_intervals(given):
    for seed in range(3):
        found = estimate_errors(seen(StereoErrors(**given), seed), RIG)
        assert {x.name for x in found.quantities if x.significant} == set(given)
        for x in found.quantities:
            assert abs(x.value - given.get(x.name, 0)) < 3.5 * x.standard_error
        assert found.row_px[0] > 1.5 * found.row_px[1]
        assert found.row_px[1] == pytest.approx(NOISE_PX, rel=0.15)


def test_exact_calibration_has_no_significant_error():
    ratios = []
    for seed in range(8):
        found = estimate_errors(seen(StereoErrors(), seed), RIG)
        assert found.errors == StereoErrors()
        ratios += [x.value / x.standard_error for x in found.quantities]
    assert 0.5 < np.std(ratios) < 1.2  # where frames scatter more, the standard error is larger


def test_delay_is_found_although_the_head_shakes():
    """A shake between frames moves the rows of a frame alike; it is not in the velocity."""
    found = estimate_errors(seen(StereoErrors(delay_s=0.008), shake=0.2), RIG)
    delay = next(x for x in found.quantities if x.name == "delay_s")
    assert abs(delay.value - 0.008) < 4 * delay.standard_error < 0.004
    assert found.corrected == found.errors


def test_keystone_is_reported_and_not_corrected():
    found = estimate_errors(seen(StereoErrors(keystone_rad=-0.01)), RIG)
    assert found.errors.keystone_rad == pytest.approx(-0.01, abs=0.001)
    assert found.corrected == StereoErrors()


@pytest.mark.parametrize("name", StereoErrors.names())
def test_right_camera_inverts_its_disparities(name):
    errors = replace(StereoErrors(), **{name: 0.5 if name == "row_px" else 0.01})
    samples = seen(errors)
    right = RightCamera(errors, RIG, samples.velocity)
    disparity_px = np.linspace(-1, 30, POINTS)
    there = right.see(samples.pixels, disparity_px)
    again = right.disparity(samples.pixels, there[:, 0])
    np.testing.assert_allclose(again, disparity_px, atol=0.02 if name == "keystone_rad" else 1e-9)


def test_calibration_on_line_uses_each_landmark_once():
    calibration, samples = SelfCalibration(RIG), seen(StereoErrors(delay_s=0.008))
    assert calibration.unused(np.array([3, 7, 9]), next_id=8).tolist() == [0, 1, 2]
    assert calibration.unused(np.array([3, 8, 9]), next_id=12).tolist() == [1, 2]
    worn = []
    for k in range(4):
        here = samples.select(samples.frame == k)
        calibration.add(k, here.pixels, here.right_pixels)
        worn.append(calibration.complete(here.velocity[0]))
    assert worn == [False, True, False, False]
    assert calibration.errors.delay_s == pytest.approx(0.008, abs=0.001)
    assert not calibration.complete(None)


@pytest.mark.parametrize(("error_px", "corrected"), [(0.12, False), (0.2, True)])
def test_small_errors_are_reported_and_larger_ones_corrected(error_px, corrected):
    pitch_rad = error_px / RIG.f_px
    samples = seen(StereoErrors(pitch_rad=pitch_rad))
    assert estimate_errors(samples, RIG).errors.pitch_rad == pytest.approx(pitch_rad, abs=1e-4)
    calibration = SelfCalibration(RIG)
    for k in range(8):
        here = samples.select(samples.frame == k)
        calibration.add(k, here.pixels, here.right_pixels)
        calibration.complete(here.velocity[0])
    assert (calibration.errors is not None) == corrected
    assert OdometrySettings().self_calibration == "auto"
    assert THESIS.self_calibration == "off"


@pytest.mark.parametrize("offset_s", [0.0, 0.013, -0.042])
def test_clock_offset_is_found_within_its_interval(offset_s):
    rng, times = np.random.default_rng(0), np.arange(0, 20, 1 / 15)
    sensor_s = np.arange(-1, 21, 0.005)

    def angle(t):
        return np.sin(t) + 0.1 * np.sin(5 * t) + 2 * t

    motion = np.diff(angle(times)) + rng.normal(0, 1e-3, len(times) - 1)
    total = 2.5 * angle(sensor_s - offset_s)
    ns = [np.rint(1e9 * x).astype(np.int64) for x in (times, sensor_s)]
    found = estimate_clock_offset(ns[0], motion, ns[1], total)
    assert abs(found.value - offset_s) < 4 * found.standard_error + 1e-4
    assert found.standard_error < 0.002
    assert estimate_clock_offset(ns[0], np.full(len(motion), 0.1), ns[1], total) is None
    assert estimate_clock_offset(ns[0][:10], motion[:9], ns[1], total) is None


def test_saved_calibration_is_read_as_the_corrected_cameras(tmp_path):
    samples = seen(StereoErrors(pitch_rad=0.01, roll_rad=-0.02))
    found = Calibration(RIG, samples, estimate_errors(samples, RIG), {})
    file = found.save(tmp_path / "camchain.yaml")
    left, right = read_cameras(file, file)
    rig, _, _ = rectify(left, right)
    assert rig.baseline_m == pytest.approx(RIG.baseline_m)
    R_left_right = (np.linalg.inv(left.T_body_cam) @ right.T_body_cam)[:3, :3]
    assert R_left_right[2, 1] == pytest.approx(0.01, abs=1e-3)
    assert R_left_right[1, 0] == pytest.approx(-0.02, abs=1e-3)
    before, after = found.row_offsets_px
    assert np.std(before) > 10 * np.std(after)
    figures = found.to_dict()
    assert figures["points"] == POINTS
    assert "baseline" in figures["not_observable"]
