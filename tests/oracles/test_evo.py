"""Metrics against evo and the numbers it is known for."""

import copy

import numpy as np
import pytest

from trials.evaluation.alignment import Alignment, Pair, associate
from trials.evaluation.metrics import errors_over_time, position_errors
from vo.contract import se3
from vo.contract.trajectory import Trajectory
from vo.recordings.kitti import read_kitti_poses
from vo.recordings.trajectory_files import read_trajectory


@pytest.fixture
def evo():
    pytest.importorskip("evo", reason="evo is a development dependency")
    import evo.core.metrics
    import evo.core.trajectory

    return evo.core


@pytest.fixture
def kitti_00(real_data):
    folder = real_data("evo")
    T, T_orb = (read_kitti_poses(folder / f"KITTI_00_{x}.txt") for x in ("gt", "ORB"))
    return Pair(np.arange(len(T)), T, T_orb)


def random_pair():
    rng = np.random.default_rng(4)
    steps = rng.normal([0, 0, 0.2, 0, 0.05, 0], 0.1, (80, 6))
    T = [np.eye(4)]
    for step in steps:
        T.append(T[-1] @ se3.exp(step))
    T = se3.exp(rng.normal(size=6)) @ np.array(T)
    wrong = T @ se3.exp(rng.normal(scale=0.05, size=(len(T), 6)))
    wrong[:, :3, 3] *= 1.1
    return Pair(np.arange(len(T)), T, wrong)


def rmse(errors):
    return float(np.sqrt(np.mean(errors**2)))


def paths(evo, pair):
    return tuple(
        evo.trajectory.PosePath3D(poses_se3=list(T)) for T in (pair.T_world_cam, pair.T_odom_cam)
    )


def evo_ate(evo, pair, alignment):
    truth, estimate = paths(evo, pair)
    estimate = copy.deepcopy(estimate)
    if alignment is Alignment.FIRST_POSE:
        estimate.align_origin(truth)
    else:
        estimate.align(truth, correct_scale=alignment is Alignment.SIM3)
    metric = evo.metrics.APE(evo.metrics.PoseRelation.translation_part)
    metric.process_data((truth, estimate))
    return metric.error


@pytest.mark.parametrize("alignment", list(Alignment))
def test_absolute_errors_equal_evo(evo, alignment):
    pair = random_pair()
    assert np.allclose(position_errors(pair, alignment), evo_ate(evo, pair, alignment), atol=1e-9)


@pytest.mark.parametrize("step", [1, 5])
def test_relative_errors_equal_evo(evo, step):
    pair = random_pair()
    ours = errors_over_time(pair, step)
    relation = evo.metrics.PoseRelation
    for kind, mine in (
        (relation.translation_part, ours.translation_m),
        (relation.rotation_angle_rad, ours.rotation_rad),
    ):
        metric = evo.metrics.RPE(kind, step, evo.metrics.Unit.frames, all_pairs=True)
        metric.process_data(paths(evo, pair))
        assert np.allclose(mine, metric.error, atol=1e-7)


def test_kitti_00_errors_equal_published_ones(kitti_00):
    # Unaligned: both start at the identity, up to the rounding of the file.
    assert rmse(position_errors(kitti_00, Alignment.FIRST_POSE)) == pytest.approx(
        7.790289, abs=1e-4
    )
    assert rmse(position_errors(kitti_00, Alignment.SE3)) == pytest.approx(1.303450, abs=1e-6)
    assert rmse(position_errors(kitti_00, Alignment.SIM3)) == pytest.approx(0.937709, abs=1e-6)


def test_fr2_desk_errors_equal_published_ones(real_data, tmp_path):
    """Evo takes the nearest truth, we interpolate it: equal to 0.02 mm."""
    folder = real_data("evo")
    lines = (folder / "fr2_desk_groundtruth.txt").read_text().splitlines()
    times = [line.split()[0] for line in lines]
    once = [x for i, x in enumerate(lines) if i == 0 or x[0] == "#" or times[i] != times[i - 1]]
    (tmp_path / "truth.txt").write_text("\n".join(once) + "\n")
    truth = read_trajectory(tmp_path / "truth.txt")
    estimate = read_trajectory(folder / "fr2_desk_ORB.txt")
    pair = associate(truth, estimate)
    assert rmse(position_errors(pair, Alignment.SE3)) == pytest.approx(0.008119, abs=2e-5)
    assert rmse(position_errors(pair, Alignment.SIM3)) == pytest.approx(0.006123, abs=2e-5)


def test_nearest_association_reproduces_evo_exactly(real_data):
    """Without interpolation the same code gives evo's published figures exactly."""
    folder = real_data("evo")
    rows = np.loadtxt(folder / "fr2_desk_groundtruth.txt")
    estimate = read_trajectory(folder / "fr2_desk_ORB.txt")
    seconds = estimate.timestamps_ns / 1e9
    after = np.searchsorted(rows[:, 0], seconds).clip(1, len(rows) - 1)
    nearest = after - (seconds - rows[after - 1, 0] <= rows[after, 0] - seconds)
    near = np.abs(rows[nearest, 0] - seconds) <= 0.01
    T_world_cam = se3.from_quat_wxyz(rows[nearest[near]][:, [7, 4, 5, 6]], rows[nearest[near], 1:4])
    chosen = Trajectory(estimate.timestamps_ns[near], estimate.T_ref_frame[near])
    pair = Pair(chosen.timestamps_ns, T_world_cam, chosen.T_ref_frame)
    assert rmse(position_errors(pair, Alignment.SE3)) == pytest.approx(0.008119, abs=1e-6)
    assert rmse(position_errors(pair, Alignment.SIM3)) == pytest.approx(0.006123, abs=1e-6)
