"""The estimator with oracles in place of its stages, on rendered images."""

import numpy as np
import pytest
from recordings import OFFICE, shared_recording

from trials.diagnosis.hooks import ORACLES, Oracle
from vo.contract import se3
from vo.hooks import Hooks
from vo.odometry import StereoOdometry
from vo.recordings.readers import open_sequence, read_truth
from vo.runner import run

pytestmark = [pytest.mark.gl, pytest.mark.slow]


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    return shared_recording(tmp_path_factory, "office", 5, OFFICE)


@pytest.fixture(scope="module")
def errors(drive):
    """Position error of each pose, metres, with given hooks."""
    sequence = open_sequence(drive)
    T_world_cam = read_truth(drive).T_ref_frame
    T_odom_cam = se3.inverse(T_world_cam[0]) @ T_world_cam

    def measure(hooks):
        result = run(sequence, StereoOdometry(sequence.rig, None, hooks))
        off = result.trajectory.T_ref_frame[:, :3, 3] - T_odom_cam[:, :3, 3]
        return np.linalg.norm(off, axis=1), result

    return measure


@pytest.fixture(scope="module")
def usual(errors):
    return errors(Hooks())


def test_default_hooks_change_nothing(drive, usual):
    sequence = open_sequence(drive)
    result = run(sequence, StereoOdometry(sequence.rig))
    np.testing.assert_array_equal(result.trajectory.T_ref_frame, usual[1].trajectory.T_ref_frame)


def test_all_oracles_leave_almost_no_error(drive, errors, usual):
    exact, _ = errors(Oracle(drive))
    assert 0 < exact.max() < 1e-4
    assert exact.max() < 0.3 * usual[0].max()
    noisy, _ = errors(Oracle(drive, noise_px=0.5))
    assert 2 * exact.max() < noisy.max() < 0.01


@pytest.mark.parametrize("stage", ORACLES)
def test_each_oracle_alone_changes_the_run(stage, drive, errors, usual):
    found, result = errors(Oracle(drive, [stage]))
    assert len(found) == len(usual[0])
    assert not np.array_equal(result.trajectory.T_ref_frame, usual[1].trajectory.T_ref_frame)
    assert found.max() < 3 * usual[0].max()


def test_true_matches_reduce_the_error(drive, errors, usual):
    found, _ = errors(Oracle(drive, ["matches", "features"]))
    jumps = np.abs(np.diff(found)).mean(), np.abs(np.diff(usual[0])).mean()
    assert 0 < jumps[0] < 0.5 * jumps[1]  # what stereo leaves grows without jumps


def test_features_hook_selects_features(errors):
    class LeftHalf(Hooks):
        def features(self, frame, pixels):
            return pixels[pixels[:, 0] < 160]

        def new_landmarks(self, frame, ids, pixels):
            assert (pixels[:, 0] < 160).all()

    found, _ = errors(LeftHalf())
    assert 0 < found.max() < 0.02
