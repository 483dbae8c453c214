"""The baseline, on a wall whose motion is known and on what it cannot track."""

import numpy as np
import pytest
from folders import BASELINE_M, DISPARITY_PX, HEIGHT, WIDTH, wall, write_euroc

from trials.estimators.baselines.corner_flow import CornerFlow
from trials.evaluation.alignment import associate
from trials.evaluation.metrics import errors_over_distance
from vo.contract.estimator import Status
from vo.contract.sequence import StereoFrame
from vo.recordings.readers import open_sequence, read_truth
from vo.runner import run

STEP_PX = 4
STEP_M = STEP_PX / DISPARITY_PX * BASELINE_M


@pytest.fixture
def sequence(tmp_path):
    return open_sequence(write_euroc(tmp_path / "wall", wall(8, STEP_PX)))


def test_corner_flow_known_motion_is_recovered(sequence):
    T = run(sequence, CornerFlow(sequence.rig)).trajectory.T_ref_frame
    end = T[-1, :3, 3]
    assert end == pytest.approx([7 * STEP_M, 0, 0], abs=2e-3)


def test_corner_flow_estimates_are_complete(sequence):
    estimates = run(sequence, CornerFlow(sequence.rig)).estimates
    assert [x.status for x in estimates] == [Status.START] + [Status.TRACKED] * 7
    last = estimates[-1]
    assert list(last.counts) == ["corners", "stereo", "flow", "inliers"]
    counts = list(last.counts.values())
    assert counts == sorted(counts, reverse=True)
    assert list(last.timings_ms) == ["corners", "stereo", "flow", "pose"]
    assert len(last.observations.ids) == last.counts["flow"]
    assert np.allclose(last.observations.disparity_px, DISPARITY_PX, atol=0.2)
    ids = np.concatenate([x.observations.ids for x in estimates[1:]])
    assert len(np.unique(ids)) == len(ids)


def test_corner_flow_repeated_gives_equal_poses(sequence):
    a, b = (run(sequence, CornerFlow(sequence.rig)).trajectory.T_ref_frame for _ in range(2))
    assert (a == b).all()


def test_corner_flow_blank_images_are_lost(sequence):
    tracker = CornerFlow(sequence.rig)
    blank = np.full((HEIGHT, WIDTH), 90, np.uint8)
    tracker.track(sequence[0])
    before = tracker.track(sequence[1])
    lost = tracker.track(StereoFrame(10**12, blank, blank))
    assert lost.status is Status.LOST
    assert lost.reason.startswith("0 inliers")
    resumed = tracker.track(sequence[2])
    assert resumed.status is Status.START
    assert (resumed.T_odom_cam == before.T_odom_cam).all()
    assert tracker.track(sequence[3]).status is Status.TRACKED


def test_corner_flow_noise_never_raises(sequence):
    tracker = CornerFlow(sequence.rig)
    rng = np.random.default_rng(0)
    for i in range(5):
        left, right = rng.integers(0, 255, (2, HEIGHT, WIDTH), dtype=np.uint8)
        assert tracker.track(StereoFrame(i, left, right)).status in (Status.START, Status.LOST)


@pytest.mark.slow
def test_corner_flow_kitti_06_drift_is_bounded(real_data):
    folder = real_data("kitti_06")
    sequence = open_sequence(folder)
    result = run(sequence, CornerFlow(sequence.rig))
    assert all(x.status is not Status.LOST for x in result.estimates)
    pair = associate(read_truth(folder), result.trajectory)
    errors = errors_over_distance(pair, 50.0)
    drift_percent = 100 * np.mean(errors.translation_m / errors.length_m)
    assert 0.3 < drift_percent < 1.3
