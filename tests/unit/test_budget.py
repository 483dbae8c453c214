"""What frames leave out to end in time, in which order, and what they say."""

import time
from itertools import pairwise

import pytest
from folders import BASELINE_M, F_PX, HEIGHT, WIDTH, wall

from vo.config import OdometrySettings
from vo.contract.estimator import Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.odometry import StereoOdometry
from vo.tracking.budget import MAX_WAIT_FRAMES, MIN_SHARE, Budget

RIG = StereoRig(WIDTH, HEIGHT, F_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, BASELINE_M)


def frames_of(budget, count, seconds=0.0):
    """Landmarks of 200, whether a keyframe waits, and what was said, frame by frame."""
    found = []
    for _ in range(count):
        budget.begin()
        waits = budget.lets_keyframe_wait()
        time.sleep(seconds)
        found.append((budget.landmarks(200), waits, budget.end()))
    return zip(*found, strict=True)


def test_without_a_limit_nothing_is_left_out():
    landmarks, waits, said = frames_of(Budget(), 3)
    assert (set(landmarks), set(waits), set(said)) == ({200}, {False}, {""})
    budget = Budget()
    budget.begin()
    assert not budget.is_spent()


def test_landmarks_are_left_out_before_keyframes_wait():
    landmarks, waits, said = frames_of(Budget(0.01), 12, seconds=1e-4)
    least = int(MIN_SHARE * 200)
    assert landmarks[:4] == (200, 100, least, least)
    assert waits[:2] == (False, False)
    assert max(len(run) for run in "".join("01"[x] for x in waits).split("0")) == MAX_WAIT_FRAMES
    assert said[:3] == ("", "in 0.01 ms: 100 of 200 landmarks", said[2])
    assert said[2] == f"in 0.01 ms: keyframe waits, {least} of 200 landmarks"


def test_landmarks_return_when_there_is_time():
    budget = Budget(1000.0)
    budget._share = MIN_SHARE
    landmarks, _, said = frames_of(budget, 20)
    assert list(landmarks) == sorted(landmarks)
    assert (landmarks[-1], said[-1]) == (200, "")


@pytest.mark.parametrize("limit_ms", [0.0, 0.01, 1e6])
def test_poses_are_kept_with_any_limit(limit_ms):
    """The wall moves by 4 px a frame."""
    odometry = StereoOdometry(RIG, OdometrySettings(budget_ms=limit_ms))
    found = [odometry.track(StereoFrame(i, *pair)) for i, pair in enumerate(wall(6, 4))]
    claimed = {x.status for x in found[1:]}
    assert claimed <= {Status.TRACKED, Status.WEAK}  # with few landmarks, a step is less sure
    assert limit_ms == 0.01 or claimed == {Status.TRACKED}
    steps = [b.T_odom_cam[0, 3] - a.T_odom_cam[0, 3] for a, b in pairwise(found)]
    assert steps == pytest.approx([steps[0]] * 5, rel=0.1)
    said = [x.reason for x in found[1:]]
    assert any("landmarks" in x for x in said) == (limit_ms == 0.01)
    assert limit_ms == 0.01 or set(said) == {""}
    smoothed = odometry.finalize().trajectory
    assert smoothed.timestamps_ns.tolist() == list(range(6))
