"""Trajectories: interpolation, and the TUM file."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vo.contract import se3
from vo.contract.errors import TrajectoryError
from vo.contract.trajectory import Trajectory, write_tum
from vo.recordings.trajectory_files import read_trajectory

GOOD = "1.5 0 0 0 0 0 0 1\n"


def straight(times_ns, step_m=1.0):
    T = np.tile(np.eye(4), (len(times_ns), 1, 1))
    T[:, 0, 3] = step_m * np.arange(len(times_ns))
    return Trajectory(np.array(times_ns, dtype=np.int64), T)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(0, 10**13), min_size=1, max_size=5, unique=True).map(sorted), st.data())
def test_tum_round_trip(tmp_path_factory, times, data):
    finite = st.floats(-3, 3)
    tangents = np.array([[data.draw(finite) for _ in range(6)] for _ in times])
    before = Trajectory(np.array(times, dtype=np.int64), se3.exp(tangents))
    path = tmp_path_factory.mktemp("tum") / "x.txt"
    write_tum(path, before)
    after = read_trajectory(path)
    assert (after.timestamps_ns == before.timestamps_ns).all()
    assert np.abs(after.T_ref_frame - before.T_ref_frame).max() < 1e-8


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no poses"),
        ("# only a comment\n", "holds no poses"),
        (GOOD + "2 0 0 0 0 0 0\n", ":2: 7 columns"),
        (GOOD + "2 0 0 nan 0 0 0 1\n", ":2: nan is not finite"),
        (GOOD + "2 0 0 inf 0 0 0 1\n", ":2: inf is not finite"),
        (GOOD + "2 0 0 0 0 0 0 0\n", ":2: the quaternion has length 0 instead of 1"),
        (GOOD + "2 0 0 x 0 0 0 1\n", ":2: x is not a number"),
        (GOOD + "two 0 0 0 0 0 0 1\n", ":2: two is not a number"),
        (GOOD + "1.5 0 0 0 0 0 0 1\n", ":2: .* repeats that of line 1"),
        (GOOD + "1.4 0 0 0 0 0 0 1\n", ":2: .* is before that of line 1"),
    ],
)
def test_read_trajectory_malformed_row_names_its_line(tmp_path, text, message):
    path = tmp_path / "x.txt"
    path.write_text(text)
    with pytest.raises(TrajectoryError, match=message) as caught:
        read_trajectory(path)
    assert str(path) in str(caught.value)


def test_read_trajectory_missing_or_binary_file_is_refused(tmp_path):
    with pytest.raises(TrajectoryError, match="cannot be read"):
        read_trajectory(tmp_path / "nowhere.txt")
    (tmp_path / "x.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(TrajectoryError, match="not a text file"):
        read_trajectory(tmp_path / "x.txt")


def test_read_trajectory_scientific_notation(tmp_path):
    path = tmp_path / "x.txt"
    path.write_text("1.5e0 0 0 0 0 0 0 1\n")
    assert read_trajectory(path).timestamps_ns[0] == 1_500_000_000


def test_interpolation_is_linear_and_spherical():
    T = se3.exp(np.array([[0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, np.pi / 2]]))
    T[1, :3, 3] = [2, 4, 6]
    quarter = Trajectory(np.array([0, 4_000]), T).at(np.array([1_000])).T_ref_frame[0]
    assert np.allclose(quarter[:3, 3], [0.5, 1, 1.5])
    assert np.allclose(se3.rotation_vector(quarter), [0, 0, np.pi / 8])


def test_single_pose_is_returned_at_its_time():
    T = se3.exp(np.array([[1.0, 2, 3, 0.1, 0.2, 0.3]]))
    found = Trajectory(np.array([7]), T).at(np.array([7]))
    assert found.timestamps_ns.tolist() == [7]
    assert np.array_equal(found.T_ref_frame, T)
    with pytest.raises(TrajectoryError, match=r"covers 7\.\.7 ns, requested 8\.\.8 ns"):
        Trajectory(np.array([7]), T).at(np.array([8]))


def test_interpolation_does_not_extrapolate():
    with pytest.raises(TrajectoryError, match=r"covers 0\.\.20 ns, requested 5\.\.21 ns"):
        straight([0, 10, 20]).at(np.array([5, 21]))
    assert len(straight([0, 10]).at(np.zeros(0, dtype=np.int64))) == 0


def test_trajectory_invalid_is_refused():
    T = np.tile(np.eye(4), (2, 1, 1))
    with pytest.raises(TrajectoryError, match="must increase"):
        Trajectory(np.array([1, 1]), T)
    with pytest.raises(TrajectoryError, match="3 times"):
        Trajectory(np.array([1, 2, 3]), T)
    T[1, 0, 3] = np.nan
    with pytest.raises(TrajectoryError, match="not finite"):
        Trajectory(np.array([1, 2]), T)
