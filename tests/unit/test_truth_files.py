"""True trajectories of recordings: states, motion capture, positions only."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from trials.evaluation.alignment import associate, gaps
from trials.evaluation.runs import SavedRun
from trials.evaluation.score import score_run
from vo.contract import se3
from vo.contract.errors import TrajectoryError
from vo.contract.remarks import Remark
from vo.contract.trajectory import Trajectory
from vo.recordings.euroc import EUROC, TUMVI
from vo.recordings.truth_files import read_true_poses, read_true_states

T_BODY_CAM = se3.exp(np.array([0.1, 0.2, 0.3, 0.5, -0.5, 0.4]))
T_WORLD_BODY = se3.exp(np.outer(np.arange(5), [0.1, 0.2, 0.0, 0.1, 0.0, 0.2]))
TIMES_NS = 1403636579763555584 + 5_000_000 * np.arange(5)
HEADER = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
)


def lines(T, columns=8):
    values = np.hstack([T[:, :3, 3], se3.to_quat_wxyz(T)]).tolist()
    rows = zip(TIMES_NS.tolist(), values, strict=True)
    return [",".join(map(repr, [time, *row][:columns])) for time, row in rows]


def write(mav, name, rows, T_body_sensor=None):
    (mav / name).mkdir(parents=True)
    (mav / name / "data.csv").write_text("\n".join([HEADER, *rows]) + "\n")
    if T_body_sensor is not None:
        sheet = {"T_BS": {"rows": 4, "cols": 4, "data": T_body_sensor.ravel().tolist()}}
        (mav / name / "sensor.yaml").write_text("%YAML:1.0\n" + yaml.safe_dump(sheet))


def read_states(mav, layout=EUROC):
    return read_true_states([mav / x for x in layout.truths], T_BODY_CAM)


def test_states_are_preferred_and_bring_no_remark(tmp_path):
    write(tmp_path, "state_groundtruth_estimate0", lines(T_WORLD_BODY))
    write(tmp_path, "leica0", ["nothing"])
    found = read_states(tmp_path)
    assert found.timestamps_ns.tolist() == TIMES_NS.tolist()
    assert np.allclose(found.T_ref_frame, T_WORLD_BODY @ T_BODY_CAM)


def test_motion_capture_is_moved_to_the_camera(tmp_path):
    T_body_marker = se3.exp(np.array([0.3, 0, 0.1, 0, 1, 0]))
    write(tmp_path, "vicon0", lines(T_WORLD_BODY @ T_body_marker), T_body_marker)
    with pytest.warns(Remark, match=r"vicon0/data\.csv: is taken as the truth"):
        found = read_states(tmp_path)
    assert np.allclose(found.T_ref_frame, T_WORLD_BODY @ T_BODY_CAM)


def test_positions_are_compared_with_the_point_that_was_measured(tmp_path):
    T_body_prism = se3.pose(np.eye(3), np.array([0.1, 0.5, 0.2]))
    write(tmp_path, "leica0", lines(T_WORLD_BODY @ T_body_prism, columns=4), T_body_prism)
    with pytest.warns(Remark, match=r"(?s)leica0/data\.csv: (is taken|has positions only)"):
        truth = read_states(tmp_path)
    pair = associate(truth, Trajectory(TIMES_NS, T_WORLD_BODY @ T_BODY_CAM))
    assert not pair.has_attitude
    assert np.allclose(pair.T_odom_cam, pair.T_world_cam)


def test_blanks_and_seconds_without_header_are_tum(tmp_path):
    rows = np.hstack([T_WORLD_BODY[:, :3, 3], np.roll(se3.to_quat_wxyz(T_WORLD_BODY), -1, axis=1)])
    times = [f"{x // 10**9}.{x % 10**9:09d}" for x in TIMES_NS.tolist()]
    text = [" ".join([t, *map(repr, x)]) for t, x in zip(times, rows.tolist(), strict=True)]
    (tmp_path / "x.csv").write_text("\n".join(text))
    with pytest.warns(Remark, match="no header names its columns; quaternions are taken as qx"):
        found = read_true_poses(tmp_path / "x.csv", T_BODY_CAM)
    assert np.allclose(found.T_ref_frame, T_WORLD_BODY @ T_BODY_CAM)


def test_rows_with_nan_or_repeated_are_left_out_with_a_remark(tmp_path):
    rows = lines(T_WORLD_BODY)
    rows[1] = f"{TIMES_NS[1]}," + ",".join(["NaN"] * 7)
    write(tmp_path, "state_groundtruth_estimate0", [*rows[:4], rows[3], rows[4]])
    with pytest.warns(Remark) as remarks:
        found = read_states(tmp_path)
    assert found.timestamps_ns.tolist() == TIMES_NS[[0, 2, 3, 4]].tolist()
    said = [str(x.message) for x in remarks]
    assert said[0].endswith("data.csv: rows with NaN are left out: 1, the first in line 3")
    assert said[1].endswith("rows that repeat the row before are left out: 1, the first in line 6")


def test_tumvi_truth_is_that_of_the_inertial_unit(tmp_path):
    assert read_states(tmp_path, TUMVI) is None
    (tmp_path / "gt_imu.csv").write_text("\n".join(["# ts, poses", *lines(T_WORLD_BODY)]))
    found = read_states(tmp_path, TUMVI)
    assert np.allclose(found.T_ref_frame, T_WORLD_BODY @ T_BODY_CAM)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda rows: [*rows[:3], rows[1]],
            r":5: time must increase, but .* before that of line 4",
        ),
        (lambda rows: [*rows, f"{TIMES_NS[4]},9,0,0,1,0,0,0"], r":7: .* repeats that of line 6"),
        (lambda rows: [*rows, "1403636579783555585,0,0"], r":7: 3 columns; expected"),
        (
            lambda rows: [*rows, "1403636579783555585,0,0,0,1,1,0,0"],
            r":7: the quaternion has length",
        ),
        (lambda _: [], "holds no poses"),
    ],
)
def test_malformed_truth_names_its_line(tmp_path, change, message):
    write(tmp_path, "state_groundtruth_estimate0", change(lines(T_WORLD_BODY)))
    with pytest.raises(TrajectoryError, match=message):
        read_states(tmp_path)


def test_no_motion_is_compared_across_a_gap_of_the_truth():
    """Two stretches of 2 m with 10 s between them, in which the estimate runs away."""
    times = np.concatenate([np.arange(21), 121 + np.arange(21)]) * 10**8
    T = np.tile(np.eye(4), (42, 1, 1))
    T[:, 0, 3] = np.concatenate([np.arange(21), 200 + np.arange(21)]) * 0.1
    truth, estimate = Trajectory(times, T), T.copy()
    estimate[21:, 1, 3] += 5
    assert len(gaps(truth)) == 1
    score = score_run(truth, SavedRun(Path("x.txt"), "x", Trajectory(times, estimate)), 142)
    assert (score.frames, score.compared) == (142, 42)
    assert score.path_m == pytest.approx(4)
    assert score.drift_1m.mean_percent == pytest.approx(0, abs=1e-9)
    assert score.rpe_frame_m.max == pytest.approx(0, abs=1e-9)
    assert score.end_m == pytest.approx(5)
    assert score.end_percent is None
