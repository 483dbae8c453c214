"""Map reset, modes of adjustment and iteration limits, on images of a wall moving sideways."""

import numpy as np
import pytest
from folders import BASELINE_M, F_PX, HEIGHT, WIDTH, wall

from vo.config import OdometrySettings
from vo.contract.clock import Clock
from vo.contract.estimator import Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.map.local_map import empty_map
from vo.mapping.keyframes import add_keyframe
from vo.odometry import StereoOdometry
from vo.tracking.association import find_matches
from vo.tracking.diagnostics import explain_weakness
from vo.tracking.frontend import Frontend
from vo.tracking.new_view import must_wait

RIG = StereoRig(WIDTH, HEIGHT, F_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, BASELINE_M)


def settings(**refinement):
    return OdometrySettings.model_validate({"refinement": refinement})


@pytest.fixture(scope="module")
def frames():
    return [StereoFrame(i, *pair) for i, pair in enumerate(wall(6, 4))]


@pytest.mark.parametrize(("keyframes", "kept"), [(0, True), (1, False), (2, True)])
def test_map_reset_removes_all_landmarks(frames, keyframes, kept):
    """The second keyframe resets the map if a map lasts for one keyframe."""
    s = settings(map_reset_keyframes=keyframes)
    views = [Frontend(RIG, s).extract(frame, s, 0.0, Clock()) for frame in frames[:2]]
    none = np.zeros((6, 6))
    first = add_keyframe(empty_map(), views[0], np.eye(4), none)
    matches = find_matches(first, views[1], np.eye(4), 24.0)
    T_odom_cam = np.eye(4)
    T_odom_cam[0, 3] = 0.01
    second = add_keyframe(first, views[1], T_odom_cam, none, matches)
    old = np.isin(second.landmarks.ids, first.landmarks.ids)
    assert len(second.landmarks) > 20
    assert old.any() == kept
    assert len(second.keyframes) == (2 if kept else 1)
    assert second.first_serial == (0 if kept else 1)
    assert second.next_serial == 2
    assert second.landmarks.ids.min() >= (0 if kept else first.next_id)
    np.testing.assert_array_equal(second.keyframes[-1].T_odom_cam, T_odom_cam)
    assert (second.landmarks.anchor[~old] == 1).all()


@pytest.mark.parametrize(
    "policy", [{}, {"map_reset_keyframes": 2}, {"mode": "fixed_lag"}, {"mode": "motion"}]
)
def test_odometry_moves_alike_by_every_policy(frames, policy):
    """The wall is one plane that moves by 4 px of its one depth: sideways, step by step."""
    odometry = StereoOdometry(RIG, settings(keyframe_parallax_px=0, **policy))
    estimates = [odometry.track(frame) for frame in frames]
    moved = np.array([x.T_odom_cam[0, 3] for x in estimates])
    step = np.median(np.diff(moved))
    assert abs(step) > 1e-3
    np.testing.assert_allclose(np.diff(moved), step, rtol=0.1)


def test_odometry_many_iterations_are_weak_and_no_keyframe(frames):
    """One iteration is never enough."""
    free, dropping = (
        StereoOdometry(RIG, settings(keyframe_parallax_px=0, max_keyframe_iterations=n))
        for n in (0, 1)
    )
    tracked = [free.track(frame) for frame in frames[:4]][1:]
    weak = [dropping.track(frame) for frame in frames[:4]][1:]
    assert all(x.status is Status.TRACKED for x in tracked)
    assert any("structure iterations" in x.counts for x in tracked)
    for x in weak:
        assert x.status is Status.WEAK
        assert x.reason == f"{x.counts['motion iterations']} iterations, more than 1"
        assert "structure iterations" not in x.counts


def test_keyframes_are_finished_step_by_step(frames):
    """Landmarks come with the next frame, the adjustment with the one after, then one rests."""
    odometry = StereoOdometry(RIG, settings(keyframe_parallax_px=10))
    found = []
    for frame in frames:
        before = odometry.state.map.next_serial
        estimate = odometry.track(frame)
        added = odometry.state.map.next_serial - before
        pending = odometry.state.pending
        found.append((added, pending.steps if pending else None, estimate.counts))
    added, steps, counts = zip(*found, strict=True)
    first = steps.index(0)
    assert first > 1
    assert added[: first + 2] == (1, *[0] * (first - 1), 0, 1)
    assert steps[first : first + 3] == (0, 1, 2)
    assert [i for i, x in enumerate(counts) if "structure iterations" in x] == [first + 2]
    assert "features" not in counts[first]  # detection is the keyframe's, not the frame's


def test_keyframes_at_once_or_deferred_give_about_the_same(frames):
    def moved(deferred):
        odometry = StereoOdometry(RIG, settings(keyframe_parallax_px=10, deferred=deferred))
        for frame in frames:
            T_odom_cam = odometry.track(frame).T_odom_cam
            assert deferred or odometry.state.pending is None
        return T_odom_cam

    np.testing.assert_allclose(moved(True), moved(False), atol=1e-3)


def test_urgent_keyframe_is_finished_at_once(frames):
    """One that comes before the last has its adjustment, which is done now, too."""
    odometry = StereoOdometry(RIG, settings(keyframe_parallax_px=0))
    found = []
    for frame in frames[:5]:
        odometry.track(frame)
        pending = odometry.state.pending
        found.append((pending.steps if pending else None, odometry.state.map.next_serial))
    assert found == [(None, 1), (0, 1), (None, 3), (0, 3), (None, 5)]


def test_keyframe_waits_for_the_last_within_two_baselines(frames):
    odometry = StereoOdometry(RIG, settings(keyframe_parallax_px=0))
    near, far = np.eye(4), np.eye(4)
    near[0, 3], far[2, 3] = 1.9 * RIG.baseline_m, 2.1 * RIG.baseline_m
    odometry.track(frames[0])
    assert not must_wait(odometry.state, near, RIG)  # there is none
    last = odometry.track(frames[1]).T_odom_cam
    assert must_wait(odometry.state, last @ near, RIG)
    assert not must_wait(odometry.state, last @ far, RIG)


def test_loss_finishes_a_pending_keyframe(frames):
    odometry = StereoOdometry(RIG, settings(keyframe_parallax_px=0))
    for frame in frames[:4]:
        odometry.track(frame)
    assert odometry.state.pending
    serial = odometry.state.map.next_serial
    black = np.zeros_like(frames[0].left)
    odometry.track(StereoFrame(100, black, black))
    assert odometry.state.pending is None
    assert odometry.state.map.next_serial == serial + 1


def test_weakness_in_words():
    s = settings(max_keyframe_iterations=20)
    assert explain_weakness(1000, 20, s) == ""
    assert explain_weakness(1000, 21, s) == "21 iterations, more than 20"
    few = s.motion.weak_inliers
    assert explain_weakness(few - 1, 21, s) == f"{few - 1} inliers, fewer than {few}"
    assert explain_weakness(1000, 99, settings()) == ""


@pytest.mark.parametrize("smooth", ["none", "window", "global"])
def test_final_result_by_every_smoothing(frames, smooth):
    odometry = StereoOdometry(RIG, settings(keyframe_parallax_px=0, smooth=smooth))
    said = [odometry.track(frame).T_odom_cam for frame in frames]
    seen = odometry.finalize()
    assert len(seen.points.ids) > 20
    if smooth == "none":
        assert seen.trajectory is None
    else:
        np.testing.assert_allclose(seen.trajectory.T_ref_frame, said, atol=2e-3)
