"""The estimator on a real camera: 51 frames and 60 m of KITTI odometry 06."""

import numpy as np
import pytest

from trials.evaluation.alignment import Alignment, associate
from trials.evaluation.metrics import position_errors
from vo.contract.estimator import Status
from vo.odometry import StereoOdometry
from vo.recordings.readers import open_sequence, read_truth
from vo.runner import run


@pytest.mark.slow
def test_kitti_06(real_data):
    folder = real_data("kitti_06")
    sequence = open_sequence(folder)
    result = run(sequence, StereoOdometry(sequence.rig))
    assert [x.status for x in result.estimates] == [Status.START] + 50 * [Status.TRACKED]
    pair = associate(read_truth(folder), result.trajectory)
    path_m = pair.travelled_m[-1]
    end_m = position_errors(pair, Alignment.FIRST_POSE)[-1]
    assert path_m == pytest.approx(59.9, abs=0.2)
    # The truth itself is good to about 1 %; less than a tenth of that would be its leak.
    assert 0.1 < 100 * end_m / path_m < 1.2
    turned_rad = np.arccos((np.trace(result.trajectory.T_ref_frame[-1][:3, :3]) - 1) / 2)
    assert turned_rad < np.radians(5)  # a straight road
