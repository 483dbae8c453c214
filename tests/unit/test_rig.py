"""The rectified pair: projection, triangulation, and what it refuses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vo.contract.errors import CalibrationError
from vo.contract.rig import StereoRig

RIG = StereoRig(640, 480, 457.0, 319.5, 239.5, 0.09)


def test_hand_worked_projection():
    """2 m ahead, 0.5 m right, 0.1 m down, at f 457 px and b 9 cm."""
    u, v, disparity_px = RIG.project(np.array([0.5, 0.1, 2.0]))
    assert u == pytest.approx(319.5 + 457 / 4)
    assert v == pytest.approx(239.5 + 457 / 20)
    assert disparity_px == pytest.approx(457 * 0.09 / 2)


def test_right_camera_has_positive_disparity():
    """The right camera's own projection is u - disparity."""
    point = np.array([0.2, 0.1, 1.5])
    seen_right = RIG.project(point - [RIG.baseline_m, 0, 0])
    u, v, disparity_px = RIG.project(point)
    assert seen_right[:2] == pytest.approx([u - disparity_px, v])


@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(0.05, 50)), max_size=5))
def test_triangulate_inverts_project(points):
    points = np.array(points).reshape(-1, 3)
    observed = RIG.project(points)
    assert np.allclose(RIG.triangulate(observed[:, :2], observed[:, 2]), points)


def test_points_behind_and_at_infinity_are_nan():
    assert np.isnan(RIG.project(np.array([[0, 0, 0], [1, 1, -2.0]]))).all()
    assert np.isnan(RIG.triangulate(np.zeros((3, 2)), np.array([0, -1, np.nan]))).all()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((640, 480, 457, 320, 240, 0.0), "baseline_m is 0.0"),
        ((640, 480, 457, 320, 240, -0.1), "baseline_m"),
        ((640, 480, float("nan"), 320, 240, 0.1), "f_px is nan"),
        ((640, 480, 457, float("inf"), 240, 0.1), "cx_px is inf"),
        ((0, 480, 457, 320, 240, 0.1), "width_px is 0"),
        ((640, 480, 457, 320, 240, 0.1, 2 * np.eye(4)), "not a rigid"),
        ((640, 480, 457, 320, 240, 0.1, np.diag([1, 1, -1, 1.0])), "not a rigid"),
    ],
)
def test_impossible_rigs_are_refused(values, message):
    with pytest.raises(CalibrationError, match=message):
        StereoRig(*values)
