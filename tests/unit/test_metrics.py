"""Metrics on trajectories whose errors can be worked out by hand."""

from pathlib import Path

import numpy as np
import pytest

from trials.evaluation.alignment import MAX_GAP_NS, Alignment, Pair, associate, umeyama
from trials.evaluation.metrics import (
    errors_over_distance,
    errors_over_time,
    position_errors,
    segment_lengths_m,
)
from trials.evaluation.runs import SavedRun
from trials.evaluation.score import score_run
from vo.contract import se3
from vo.contract.errors import TrajectoryError
from vo.contract.trajectory import Trajectory


def along_x(x_m):
    T = np.tile(np.eye(4), (len(x_m), 1, 1))
    T[:, 0, 3] = x_m
    return T


def pair(true_x, estimated_x):
    return Pair(np.arange(len(true_x)), along_x(true_x), along_x(estimated_x))


def test_segments_have_exactly_the_requested_length():
    """Frames at 0, 0.4, 1.3, 2.3 m; the estimate is 1 % long: every segment errs by 1 %."""
    true = np.array([0, 0.4, 1.3, 2.3])
    errors = errors_over_distance(pair(true, 1.01 * true), 1.0)
    # Segments from 0 m (ends between frames) and 0.4 m; and 1.3 m ends on the last frame.
    assert errors.start.tolist() == [0, 1, 2]
    assert np.allclose(errors.translation_m, 0.01)
    assert np.allclose(errors.rotation_rad, 0)


def test_error_within_a_frame_is_interpolated_by_length():
    """The estimate slips 0.2 m in the second of two 1 m steps; a 1.5 m segment gets half of it."""
    errors = errors_over_distance(pair([0, 1, 2], [0, 1, 2.2]), 1.5)
    assert np.allclose(errors.translation_m, [0.1])


def test_stationary_frames_start_segments_without_length():
    errors = errors_over_distance(pair([0, 0, 0, 1, 1], [0, 0.1, 0, 1, 1]), 1.0)
    assert errors.start.tolist() == [0, 1, 2]
    assert np.allclose(errors.translation_m, [0, 0.1, 0])


def test_errors_over_distance_short_path_is_empty():
    assert len(errors_over_distance(pair([0, 0.5], [0, 0.5]), 1.0)) == 0


def test_errors_over_distance_of_one_degree_turn():
    """Straight 2 m, but the estimate turns by 1° after 1 m: 1.5 m segments from 0 m see
    0.5 m after the bend, 2 * 0.5 * sin(0.5°) off."""
    true = along_x(np.arange(0, 2.01, 0.25))
    bend = se3.exp(np.array([0, 0, 0, 0, 0, np.radians(1)]))
    estimate = true.copy()
    after = true[:, 0, 3] > 1
    origin = along_x([1.0])[0]
    estimate[after] = origin @ bend @ se3.inverse(origin) @ true[after]
    errors = errors_over_distance(Pair(np.arange(9), true, estimate), 1.5)
    assert errors.translation_m[0] == pytest.approx(2 * 0.5 * np.sin(np.radians(0.5)))
    assert errors.rotation_rad[0] == pytest.approx(np.radians(1))


def test_errors_over_time_of_known_steps():
    errors = errors_over_time(pair([0, 1, 2, 3], [0, 1, 2.5, 3.5]), step=2)
    assert np.allclose(errors.translation_m, [0.5, 0.5])
    assert np.allclose(errors.length_m, [2, 2])
    assert len(errors_over_time(pair([0, 1], [0, 1]), step=2)) == 0


def test_position_errors_depend_on_alignment():
    """Estimate twice as long: from the first pose 0, 1, 2 m off; fitted, 1, 0, 1; scaled, none."""
    twice = pair([0, 1, 2], [0, 2, 4])
    assert np.allclose(position_errors(twice, Alignment.FIRST_POSE), [0, 1, 2])
    assert np.allclose(position_errors(twice, Alignment.SE3), [1, 0, 1])
    assert np.allclose(position_errors(twice, Alignment.SIM3), 0, atol=1e-12)


def test_umeyama_reproduces_the_paper():
    """The worked example at the end of Umeyama's paper, lifted to three dimensions: a reflection
    would fit better and must not be returned."""
    b = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0]], dtype=float)
    a = np.array([[0, 0, 0], [-1, 0, 0], [0, 2, 0]], dtype=float)
    found = umeyama(a, b, with_scale=True)
    assert np.linalg.det(found.R_a_b) == pytest.approx(1)
    # In the plane the paper finds scale 0.721 for a rotation about z; in space the mirror image
    # is a half turn about y, exact.
    assert found.scale == pytest.approx(1)
    assert np.allclose(found.R_a_b, np.diag([-1, 1, -1]))


def test_umeyama_returns_no_reflection():
    rng = np.random.default_rng(0)
    b = rng.normal(size=(20, 3))
    found = umeyama(b * [-1, 1, 1], b, with_scale=False)
    assert np.linalg.det(found.R_a_b) == pytest.approx(1)


def test_fit_scale_without_motion_is_an_error():
    with pytest.raises(TrajectoryError, match="does not move"):
        position_errors(pair([0, 1, 2], [0, 0, 0]), Alignment.SIM3)


def test_associate_leaves_out_gaps_of_the_truth():
    far = 50 * MAX_GAP_NS
    truth = Trajectory(np.array([0, 1000, far, far + 1000]), along_x([0, 1, 50, 51]))
    times = np.array([500, 2000, far // 2, far - 500, far + 500, far + 2000])
    found = associate(truth, Trajectory(times, along_x(np.zeros(6))))
    assert found.timestamps_ns.tolist() == [500, 2000, far - 500, far + 500]
    assert found.T_world_cam[0, 0, 3] == pytest.approx(0.5)


def test_associate_without_shared_times_is_an_error():
    truth = Trajectory(np.array([0, 10]), along_x([0, 1]))
    late = Trajectory(np.array([10**12, 10**12 + 1]), along_x([0, 1]))
    with pytest.raises(TrajectoryError, match="shares 0 times"):
        associate(truth, late)
    sparse = Trajectory(np.array([0, 10**9]), along_x([0, 1]))
    between = Trajectory(10**8 * np.array([2, 3]), along_x([0, 1]))
    with pytest.raises(
        TrajectoryError, match=r"nearest true pose is 200\.0 ms away, of 20 allowed"
    ):
        associate(sparse, between)


def test_associate_names_the_empty_trajectory():
    moving = Trajectory(np.array([0, 10]), along_x([0, 1]))
    nothing = Trajectory(np.zeros(0, dtype=np.int64), along_x([]))
    with pytest.raises(TrajectoryError, match=r"truth 0\.\.10 ns, estimate is empty"):
        associate(moving, nothing)
    with pytest.raises(TrajectoryError, match=r"truth is empty, estimate 0\.\.10 ns"):
        associate(nothing, moving)
    with pytest.raises(TrajectoryError, match="truth is empty, estimate is empty"):
        associate(nothing, nothing)


def test_segment_lengths_are_all_those_of_a_long_path():
    assert segment_lengths_m(8.5) == (1, 2, 3, 4, 5, 6, 7, 8)
    assert segment_lengths_m(99.9) == (1, 2, 3, 4, 5, 6, 7, 8)
    assert segment_lengths_m(1000) == (100, 200, 300, 400, 500, 600, 700, 800)
    assert segment_lengths_m(100) == (100,)


def test_segment_lengths_depend_on_the_path():
    assert segment_lengths_m(0.9) == ()
    assert segment_lengths_m(3.5) == (1, 2, 3)
    assert segment_lengths_m(250) == (100, 200)


def test_score_of_a_run_without_frame_table():
    """11 frames of 0.5 m, estimate 2 % short, two poses missing at the end."""
    times = np.arange(11) * 10**8
    truth = Trajectory(times, along_x(0.5 * np.arange(11)))
    estimate = Trajectory(times[:9], along_x(0.49 * np.arange(9)))
    score = score_run(truth, SavedRun(Path("x.txt"), "x", estimate), frames=11)
    assert score.statuses == {}
    assert (score.frames, score.compared) == (11, 9)
    assert score.path_m == pytest.approx(4.0)
    assert score.drift_1m.mean_percent == pytest.approx(2)
    assert [x.length_m for x in score.segments] == [1, 2, 3, 4]
    assert [x.segments for x in score.segments] == [7, 5, 3, 1]
    assert score.kitti_percent == pytest.approx(2)
    assert (score.end_m, score.end_percent) == (pytest.approx(0.08), pytest.approx(2))
    assert score.rpe_frame_m.rmse == pytest.approx(0.01)
    assert score.ate_m["sim3"].rmse == pytest.approx(0, abs=1e-12)
    assert score.frame_ms is None


def test_score_with_true_positions_has_ate_only():
    """The truth is that of a point 1 m to the right of a camera that turns on the spot."""
    times, turns = np.arange(9) * 10**8, np.zeros((9, 6))
    turns[:, 4] = 0.2 * np.arange(9)
    T_odom_cam = se3.exp(turns)
    points = se3.pose(np.eye(3), T_odom_cam[:, :3, 0])
    truth = Trajectory(times, points, point_cam=np.array([1.0, 0, 0]))
    score = score_run(truth, SavedRun(Path("x.txt"), "x", Trajectory(times, T_odom_cam)), 9)
    assert set(score.ate_m) == {"se3", "sim3"}
    assert score.ate_m["se3"].rmse == pytest.approx(0, abs=1e-9)
    assert (score.has_attitude, score.drift_1m, score.end_m, score.rpe_frame_m) == (
        False,
        *[None] * 3,
    )


def test_score_of_a_stationary_estimate_has_no_sim3():
    times = np.arange(3)
    truth = Trajectory(times, along_x([0, 1, 2]))
    score = score_run(truth, SavedRun(Path("x.txt"), "x", Trajectory(times, along_x([0, 0, 0]))), 3)
    assert score.drift_1m.mean_percent == pytest.approx(100)
    assert "sim3" not in score.ate_m
