"""Evidence for a pose: what makes its step uncertain, and its frame weak."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from folders import BASELINE_M, F_PX, HEIGHT, WIDTH, wall

from vo.config import THESIS, OdometrySettings
from vo.contract import se3
from vo.contract.estimator import Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.map.local_map import transform_map
from vo.odometry import StereoOdometry
from vo.tracking.evidence import UNSEEN_PX

RIG = StereoRig(WIDTH, HEIGHT, F_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, BASELINE_M)


def frames(pairs):
    return [StereoFrame(i * 66_666_667, *pair) for i, pair in enumerate(pairs)]


def track(pairs, settings=None):
    odometry = StereoOdometry(RIG, settings)
    return odometry, [odometry.track(x) for x in frames(pairs)]


def test_step_includes_what_the_map_moved():
    """A map that is moved between two frames moves the second pose, but not the first one's."""
    pairs = wall(3, 4)
    still, moved = (StereoOdometry(RIG) for _ in range(2))
    shift = se3.exp(np.array([0.02, 0.0, 0.0, 0.0, 0.0, 0.0]))
    for odometry in (still, moved):
        for frame in frames(pairs)[:2]:
            odometry.track(frame)
    assert moved.state.map.keyframes
    moved.state.T_odom_cam = shift @ moved.state.T_odom_cam  # as an adjustment does
    moved.state.map = transform_map(moved.state.map, shift, np.zeros((6, 6)))
    a, b = (x.track(frames(pairs)[2]) for x in (still, moved))
    error = se3.log(se3.inverse(a.T_odom_cam) @ b.T_odom_cam)
    assert np.linalg.norm(error[:3]) == pytest.approx(0.02, rel=0.1)
    assert error @ np.linalg.solve(b.step_covariance, error) < 2
    assert error @ np.linalg.solve(a.step_covariance, error) > 100
    assert a.status is Status.TRACKED
    assert b.status is Status.WEAK
    assert "map was corrected by 20" in b.reason


def test_start_counts_with_landmarks_that_begin_to_move():
    """Motion of a twentieth of a pixel, which no residual shows, widens the first step."""
    _, (_, second) = track(wall(2, 4))
    sigma_m = UNSEEN_PX * BASELINE_M / np.nanmedian(second.observations.disparity_px)
    assert np.linalg.eigvalsh(second.step_covariance[:3, :3])[0] > sigma_m**2
    assert second.status is Status.TRACKED


def test_start_that_half_the_landmarks_deny_is_weak():
    """Most of the second images shows something else: what is left of the start is unconfirmed."""
    first, second = wall(2, 4)
    other = wall(1, 4, seed=1)[0]
    cut = int(0.85 * HEIGHT)
    mixed = tuple(np.vstack([x[:cut], y[cut:]]) for x, y in zip(other, second, strict=True))
    _, (_, right) = track([first, second])
    _, (_, doubtful) = track([first, mixed])
    assert right.status is Status.TRACKED
    assert doubtful.status is Status.WEAK
    assert doubtful.reason.startswith("start not confirmed")
    thesis = OdometrySettings(motion={"weak_step_m": 0})
    _, (_, unlimited) = track([first, mixed], thesis)
    assert unlimited.status is Status.TRACKED
    assert THESIS.motion.weak_step_m == 0


def test_disagreeing_landmarks_make_a_step_less_sure():
    """A strip of the image that does not move widens the covariance, more than its points' loss."""
    pairs = wall(3, 1)
    strip = slice(0, HEIGHT // 4)
    stuck = [tuple(x.copy() for x in pair) for pair in pairs]
    for pair in stuck[1:]:
        for image, before in zip(pair, stuck[0], strict=True):
            image[strip] = before[strip]
    sure, unsure = (track(x)[1][2].step_covariance for x in (pairs, stuck))
    assert np.trace(unsure[:3, :3]) > 2 * np.trace(sure[:3, :3])


BLANK = (np.full((HEIGHT, WIDTH), 90, np.uint8),) * 2


def drive(shifts_px, ticks=None):
    """Frames of a wall from places in pixels along it, or blank ones; 10 counts a pixel."""
    pairs = wall(max(x for x in shifts_px if x is not None) + 1, 1)
    counts = ticks or [10 * (x or 0) for x in shifts_px]
    return [
        StereoFrame(i * 66_666_667, *(BLANK if x is None else pairs[x]), wheel_ticks=(n, n))
        for i, (x, n) in enumerate(zip(shifts_px, counts, strict=True))
    ]


def track_all(sequence):
    odometry = StereoOdometry(RIG)
    return [odometry.track(frame) for frame in sequence]


METRES_PER_PX = BASELINE_M / 8.0
BEFORE = [6 * i for i in range(14)]
GAP_PX = 300
"""Further than the image is wide: nothing after the gap was seen before."""


def gap(ticks=None):
    """Steps of 6 px, twenty blank frames at more than twice the speed, then steps of 6 px."""
    after = [BEFORE[-1] + GAP_PX + 6 * i for i in range(2)]
    shifts = [*BEFORE, *(None,) * 20, *after]
    places = np.interp(range(len(shifts)), [0, 13, 34, 35], [0, BEFORE[-1], after[0], after[-1]])
    return drive(shifts, ticks or [round(10 * x) for x in places])


def test_wheels_bridge_a_gap_in_which_the_speed_changes():
    estimates = track_all(gap())
    assert estimates[20].status is Status.LOST
    assert estimates[34].status is Status.START
    true_m = METRES_PER_PX * (BEFORE[-1] + GAP_PX)
    error = np.array([estimates[34].T_odom_cam[0, 3] - true_m, 0, 0, 0, 0, 0])
    assert abs(error[0]) < 0.03 * true_m
    assert error @ np.linalg.solve(estimates[34].covariance, error) < 20
    assert np.sqrt(estimates[34].covariance[0, 0]) < 0.2  # 1 m where nothing is known


def test_wheels_that_died_are_noticed_and_not_used():
    """Counts stand still from the start: no pose is predicted at rest for that."""
    dead = track_all(drive(BEFORE, [7] * len(BEFORE)))
    assert "stand still while the images move" in dead[-1].reason
    assert {x.status for x in dead[1:]} == {Status.TRACKED}
    silent = track_all(gap([*(10 * x for x in BEFORE), *(10 * BEFORE[-1],) * 22]))
    moved_m = METRES_PER_PX * (BEFORE[-1] - BEFORE[-2]) * 16
    assert silent[34].T_odom_cam[0, 3] < METRES_PER_PX * BEFORE[-1] + moved_m


def test_wheels_that_slip_are_noticed_and_not_used():
    """Wheels turn three times as fast over the same ground from frame 12 on."""
    shifts = [3 * i for i in range(24)]
    counts = [30 * i + 60 * max(i - 12, 0) for i in range(24)]
    estimates = track_all(drive(shifts, counts))
    assert estimates[11].reason == ""
    assert "contradict the images" in estimates[19].reason
    step_m = np.diff([x.T_odom_cam[0, 3] for x in estimates])
    np.testing.assert_allclose(step_m, 3 * METRES_PER_PX, rtol=0.1)


MOUNT = se3.exp(np.array([0, 0, 0, 0.3, -1.2, 0.7]))[:3, :3]
BIAS_RAD = np.array([2e-3, -1e-3, 3e-3])
DISTANCE_M = F_PX * METRES_PER_PX
TEXTURE = np.kron(np.random.default_rng(3).integers(40, 215, (400, 400)), np.ones((4, 4)))
TEXTURE = cv2.GaussianBlur(TEXTURE.astype(np.float32), None, 2.0)


def roll(angles_deg, gyro_rad=None, gap_after=None):
    """Frames of a wall from a camera that rolls; blank ones from 13 to 32 with `gap_after`."""
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    rays = np.stack([(u - RIG.cx_px) / F_PX, (v - RIG.cy_px) / F_PX], axis=-1) * DISTANCE_M
    sequence = []
    for i, angle in enumerate(np.radians(angles_deg)):
        c, s = np.cos(angle), np.sin(angle)
        R = np.array([[c, -s], [s, c]])
        views = [
            cv2.remap(TEXTURE, *np.moveaxis(at / METRES_PER_PX + 800, -1, 0).astype(np.float32), 1)
            for at in ((rays + np.array([eye, 0])) @ R.T for eye in (0.0, BASELINE_M))
        ]
        pair = BLANK if gap_after and 13 <= i < gap_after else [x.astype(np.uint8) for x in views]
        turned = np.array([0, 0, angle]) if gyro_rad is None else gyro_rad[i]
        reading = tuple((1.1 * MOUNT @ turned + i * BIAS_RAD).tolist())
        sequence.append(StereoFrame(i * 66_666_667, *pair, gyro_rad=reading))
    return sequence


SWAY_DEG = 2 * np.cumsum(np.sin(np.arange(13)))


def test_gyroscope_bridges_a_gap_in_which_the_camera_turns():
    """Whatever its axes, scale and bias; the last motion alone ends elsewhere."""
    angles = [*SWAY_DEG, *(SWAY_DEG[-1] + 2.5 * np.arange(1, 23))]
    sequence = roll(angles, gap_after=33)
    with_gyro = track_all(sequence)[33]
    without = track_all([replace(x, gyro_rad=None) for x in sequence])[33]
    assert with_gyro.status is without.status is Status.START
    turned = (se3.log(x.T_odom_cam)[5] for x in (with_gyro, without))
    error, blind = np.abs(np.degrees(list(turned)) - (angles[33] - angles[0]))
    assert error < 1.5 < 10 < blind
    assert np.degrees(np.sqrt(with_gyro.covariance[5, 5])) < 2 < np.degrees(1.0)


def test_gyroscope_that_died_or_lies_is_noticed():
    angles = np.array([*SWAY_DEG, *(SWAY_DEG[-1] + 2.5 * np.arange(1, 12))])
    true_rad = np.radians(angles)[:, None] * [0, 0, 1.0]
    right, dead = roll(angles), roll(angles)
    stopped = [replace(x, gyro_rad=right[13].gyro_rad) if i > 13 else x for i, x in enumerate(dead)]
    lying = true_rad.copy()
    lying[13:] = 2 * true_rad[12] - true_rad[13:]  # turns the other way
    reasons = [track_all(x)[-1].reason for x in (right, stopped, roll(angles, lying))]
    assert reasons[0] == ""
    assert "gyroscope stands still while the images turn" in reasons[1]
    assert "gyroscope contradicts the images" in reasons[2]
