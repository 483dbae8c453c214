"""Rows of a rolling shutter are carried to one instant; the line time is read, used and found."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml

from vo.calibration.line_time import SeenFrame, estimate_line_time
from vo.contract import se3
from vo.contract.errors import CalibrationError
from vo.contract.observations import Observations
from vo.contract.remarks import Remark
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.odometry import StereoOdometry
from vo.recordings.calibration import read_cameras
from vo.recordings.rectify import rectify
from vo.stereo.rolling_shutter import row_delay, see_by_rows, shift_to_instant

RIG = StereoRig(160, 120, 114.0, 79.5, 59.5, 0.09, line_time_s=200e-6)
GLOBAL = replace(RIG, line_time_s=0.0)


def shaking(t, pitch_rad=0.02):
    """T_world_cam (..., 4, 4) of a camera that starts from rest, drives sideways and shakes."""
    t = np.maximum(t, 0.0)
    t = t * t / (t + 0.15)
    swing = [pitch_rad * np.sin(12 * t), 0.006 * np.sin(16 * t), 0.01 * np.sin(5 * t)]
    return se3.exp(np.stack([0.4 * t, 0 * t, 0.1 * t, *swing], axis=-1))


def seen_points(t, points, rig):
    """u, v and disparity (N, 3) of points, each at the time of its row, and the velocity (6,)."""
    delay_s = np.zeros(len(points))
    for _ in range(5):
        T = se3.inverse(shaking(t + delay_s))
        seen = rig.project((T[:, :3, :3] @ points[..., None])[..., 0] + T[:, :3, 3])
        delay_s = row_delay(rig, seen[:, 1])
    step = se3.inverse(shaking(np.array(t - 1e-3))) @ shaking(np.array(t + 1e-3))
    return seen, se3.log(step) / 2e-3


def test_rows_are_carried_to_one_instant_and_back():
    rng = np.random.default_rng(0)
    points = rng.uniform([-1, -0.7, 2], [1, 0.7, 4], (200, 3))
    seen, velocity = seen_points(0.6, points, RIG)
    at_instant, _ = seen_points(0.6, points, GLOBAL)
    assert np.abs(seen - at_instant).max() > 0.2
    np.testing.assert_allclose(seen + shift_to_instant(seen, RIG, velocity), at_instant, atol=0.01)
    np.testing.assert_allclose(see_by_rows(at_instant, RIG, velocity), seen, atol=0.01)


@pytest.mark.parametrize("stated_us", [0.0, 200.0])
def test_line_time_is_found_within_its_interval(stated_us):
    rng = np.random.default_rng(0)
    points = rng.uniform([-3, -1, 1], [4, 1, 8], (800, 3))
    frames = []
    for t in np.arange(0.2, 1.8, 1 / 15):
        seen, velocity = seen_points(t, points, RIG)
        inside = (seen[:, :2] > 0).all(axis=1) & (seen[:, :2] < [159, 119]).all(axis=1)
        seen = seen[inside] + rng.normal(0, 0.1, (inside.sum(), 3))
        observations = Observations(np.flatnonzero(inside), seen[:, :2], seen[:, 2])
        frames.append(SeenFrame(shaking(np.array(t)), velocity, observations))
    pairs = list(zip(frames[:-2], frames[2:], strict=True))
    found = estimate_line_time(pairs, replace(RIG, line_time_s=1e-6 * stated_us))
    assert found.value == pytest.approx(200e-6, abs=4 * found.standard_error + 4e-6)
    assert found.standard_error < 5e-6
    assert estimate_line_time(pairs[:10], RIG) is None


def images(times):
    """Stereo pairs of a textured wall, each row exposed at a time of its own."""
    rng = np.random.default_rng(0)
    noise = (rng.normal(size=(800 // k, 800 // k)) * k**0.5 for k in (2, 4, 8, 16))
    wall = sum(cv2.resize(x, (800, 800), interpolation=cv2.INTER_CUBIC) for x in noise)
    wall = np.clip(128 + 45 * wall / np.std(wall), 0, 255).astype(np.uint8)
    u, v = np.meshgrid(np.arange(160.0), np.arange(120.0))
    pixels = np.stack([u, v], axis=-1)
    rays = np.concatenate([RIG.normalized(pixels), np.ones((120, 160, 1))], axis=-1)
    for t in times:
        pair = []
        for shift_m in (0.0, RIG.baseline_m):
            T = shaking(t + row_delay(RIG, np.arange(120.0)))
            start = T[:, None, :3, 3] + shift_m * T[:, None, :3, 0]
            along = (T[:, None, :3, :3] @ rays[..., None])[..., 0]
            far = (2 - start @ [0, 0.6, 1]) / (along @ [0, 0.6, 1])  # the wall leans
            x, y = np.moveaxis(start + far[..., None] * along, -1, 0)[:2].astype(np.float32)
            pair.append(cv2.remap(wall, 180 * x + 400, 180 * y + 400, cv2.INTER_LINEAR))
        yield StereoFrame(int(1e9 * t) + 1, *pair)


def test_line_time_takes_the_shutter_out_of_the_poses():
    times = np.arange(14) / 15
    frames, true = list(images(times)), shaking(times)

    def error_m(rig):
        odometry = StereoOdometry(rig)
        poses = np.array([odometry.track(x).T_odom_cam for x in frames])
        return np.linalg.norm((poses - true)[:, :3, 3], axis=1).max()

    assert 0 < error_m(RIG) < 0.5 * error_m(GLOBAL)


def sheet(tmp_path, camera, **keys):
    T = np.eye(4)
    T[0, 3] = 0.09 * camera
    content = {"T_BS": {"data": T.ravel().tolist()}, "resolution": [160, 120]}
    content |= {"intrinsics": [114.0, 114.0, 79.5, 59.5], **keys}
    path = tmp_path / f"cam{camera}.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.mark.parametrize("keys", [{"line_delay": 3e-5}, {"line_delay_nanoseconds": 30_000}])
def test_line_time_of_calibrations_is_read(tmp_path, keys):
    left = sheet(tmp_path, 0, **keys)
    rig, _, _ = rectify(*read_cameras(left, sheet(tmp_path, 1, **keys)))
    assert rig.line_time_s == pytest.approx(3e-5)
    with pytest.warns(Remark, match="line times of 30 and 0 us"):
        rig, _, _ = rectify(*read_cameras(left, sheet(tmp_path, 1)))
    assert rig.line_time_s == pytest.approx(3e-5)


@pytest.mark.parametrize("value", [30, "fast", float("nan"), [1, 2]])
def test_line_time_of_another_unit_is_refused(tmp_path, value):
    with pytest.raises(CalibrationError, match=r"cam0\.yaml: line_delay"):
        read_cameras(sheet(tmp_path, 0, line_delay=value), sheet(tmp_path, 1))
