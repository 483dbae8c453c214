"""Trajectory files of every format that estimators write."""

import numpy as np
import pytest

from vo.contract import se3
from vo.contract.errors import TrajectoryError
from vo.contract.remarks import Remark
from vo.recordings.trajectory_files import read_trajectory

FRAMES_NS = 1403636579763555584 + 50_000_000 * np.arange(4)
T = se3.exp(np.outer(np.arange(4), [0.1, 0.2, 0.3, 0.03, 0.02, 0.01]))
SECONDS = [f"{t // 10**9}.{t % 10**9:09d}" for t in FRAMES_NS]
POSITIONS = [" ".join(map(repr, x)) for x in T[:, :3, 3].tolist()]
QUATS_WXYZ = [" ".join(map(repr, x)) for x in se3.to_quat_wxyz(T).tolist()]
QUATS_XYZW = [" ".join([*x.split()[1:], x.split()[0]]) for x in QUATS_WXYZ]

MATRICES = [" ".join(map(repr, x)) for x in T[:, :3].reshape(4, 12).tolist()]


def rows(*columns, comma=False):
    text = "".join(" ".join(map(str, row)) + "\n" for row in zip(*columns, strict=True))
    return text.replace(" ", ",") if comma else text


TUM = rows(SECONDS, POSITIONS, QUATS_XYZW)
ASL = rows(FRAMES_NS, POSITIONS, QUATS_WXYZ, comma=True)


def read(tmp_path, text, frames_ns=FRAMES_NS):
    (tmp_path / "x.txt").write_text(text)
    return read_trajectory(tmp_path / "x.txt", frames_ns)


@pytest.mark.parametrize(
    "text",
    [
        TUM,
        rows(FRAMES_NS, POSITIONS, QUATS_XYZW),
        rows([f"{t}.000000" for t in FRAMES_NS], POSITIONS, QUATS_XYZW),
        rows(SECONDS, POSITIONS, QUATS_XYZW, ["1e-4 " * 12] * 4),
        "# timestamp(s) tx ty tz qx qy qz qw Pr11\n"
        + rows(SECONDS, POSITIONS, QUATS_XYZW, [1] * 4),
        "timestamp tx ty tz qw qx qy qz\n" + rows(SECONDS, POSITIONS, QUATS_WXYZ),
        "# format: timestamp tx ty tz qw qx qy qz\n" + rows(SECONDS, POSITIONS, QUATS_WXYZ),
        "num t x y z qx qy qz qw\n" + rows(range(4), SECONDS, POSITIONS, QUATS_XYZW),
        ",timestamp,x,y,z,qx,qy,qz,qw\n"
        + rows(range(4), SECONDS, POSITIONS, QUATS_XYZW, comma=True),
        "t_ms rx ry rz rw trans_x trans_y trans_z\n" + rows(SECONDS, QUATS_XYZW, POSITIONS),
        "Time,transform.translation.x,transform.translation.y,transform.translation.z,"
        "transform.rotation.w,transform.rotation.x,transform.rotation.y,transform.rotation.z\n"
        + rows(SECONDS, POSITIONS, QUATS_WXYZ, comma=True),
        "# time, position, orientation (xyzw)\n" + rows(SECONDS, POSITIONS, QUATS_XYZW),
        "# time, position, orientation (wxyz)\n" + rows(SECONDS, POSITIONS, QUATS_WXYZ),
        "# timestamp(s) q_GtoI(4) p_IinG(3) v bg ba\n"
        + rows(SECONDS, QUATS_XYZW, POSITIONS, [0] * 4),
        "# timestamp tx ty tz qx qy qz qw\n" + rows(SECONDS, POSITIONS, QUATS_XYZW, comma=True),
        "#timestamp,p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],"
        "v_RS_R_x [m s^-1],b_w_RS_S_x [rad s^-1]\n" + ASL.replace("\n", ",7,8\n"),
        "%time,field.header.seq,field.pose.pose.position.x,field.pose.pose.position.y,"
        "field.pose.pose.position.z,field.pose.pose.orientation.x,field.pose.pose.orientation.y,"
        "field.pose.pose.orientation.z,field.pose.pose.orientation.w,field.twist.twist.linear.x\n"
        + rows(FRAMES_NS, range(4), POSITIONS, QUATS_XYZW, [9] * 4, comma=True),
        rows(MATRICES),
        rows(SECONDS, MATRICES),
        rows(FRAMES_NS, MATRICES, ["0 0 0 1"] * 4),
        rows(MATRICES, ["0 0 0 1"] * 4, comma=True),
    ],
)
def test_every_format_gives_the_same_trajectory(tmp_path, text):
    found = read(tmp_path, text)
    assert found.timestamps_ns.tolist() == FRAMES_NS.tolist()
    assert np.allclose(found.T_ref_frame, T, atol=1e-12)


def test_rows_between_commas_without_header_bring_a_remark(tmp_path):
    with pytest.warns(
        Remark, match=r"x\.txt: no header names its columns; quaternions are taken as qw, qx"
    ):
        found = read(tmp_path, ASL.replace("\n", ",\n"))
    assert np.allclose(found.T_ref_frame, T, atol=1e-12)


@pytest.mark.parametrize("start_ns", [0, 10**9, 1403636579 * 10**9])
def test_unit_of_times_is_that_which_fits_the_recording(tmp_path, start_ns):
    times = start_ns + FRAMES_NS - FRAMES_NS[0]
    for words in (times, [f"{t // 10**9}.{t % 10**9:09d}" for t in times]):
        found = read(tmp_path, rows(words, POSITIONS, QUATS_XYZW), times)
        assert found.timestamps_ns.tolist() == times.tolist()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (rows(range(4), POSITIONS, QUATS_XYZW), r"x\.txt:1: the first column counts rows"),
        (rows(range(4), SECONDS, POSITIONS, QUATS_XYZW), r"x\.txt:1: "),
        (rows([0, 2, 3], MATRICES[1:]), r"x\.txt:1: the first column counts rows or frames"),
        (TUM.replace(" 0.0", " nan", 1), r"x\.txt:1: nan is not finite"),
        (TUM + "\n" + TUM.splitlines()[1], r"x\.txt:6: time must increase"),
        (TUM + TUM.splitlines()[3], r"x\.txt:5: time must increase, but .* repeats"),
        (
            rows(SECONDS, QUATS_XYZW, POSITIONS),
            r"x\.txt:2: the quaternion has length 1.07 instead of 1",
        ),
        (rows(SECONDS, POSITIONS), r"x\.txt:1: 4 columns; expected"),
        (
            "t,x,y,z\n" + rows(SECONDS, POSITIONS, comma=True),
            r"x\.txt: its header names no quaternion",
        ),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3, r"3 rows of a matrix, .*for 4 frames"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n" + "1 0 0 0 0 2 0 0 0 0 1 0\n" * 3, r":2: holds no rotation"),
        ("# nothing\n", "holds no poses"),
    ],
)
def test_other_files_are_refused_with_a_reason(tmp_path, text, message):
    with pytest.raises(TrajectoryError, match=message):
        read(tmp_path, text)


def test_rounded_times_bring_a_remark(tmp_path):
    words = [f"{int(t) / 1e9:.2f}" for t in FRAMES_NS]
    with pytest.warns(
        Remark, match=r"3 of 3 poses are not at the time of a frame but up to 3\.6 ms"
    ):
        read(tmp_path, rows(words, POSITIONS, QUATS_XYZW))


def test_poses_of_keyframes_bring_no_remark(tmp_path):
    text = "".join(TUM.splitlines(keepends=True)[::2])
    assert len(read(tmp_path, text)) == 2


def test_own_files_are_in_seconds_however_far_apart(tmp_path):
    text = rows(["7.000000000", "27.000000000"], POSITIONS[:2], QUATS_XYZW[:2])
    assert read(tmp_path, text, None).timestamps_ns.tolist() == [7 * 10**9, 27 * 10**9]
