"""Group axioms of rigid motions, near identity and near half turns too."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vo.contract import se3

unit = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda x: np.linalg.norm(x) > 0.1)
angles = st.one_of(
    st.just(0.0),
    st.floats(1e-12, 1e-3),
    st.floats(0.5e-4, 2e-4),  # where exp and log change to their series
    st.floats(1e-3, np.pi - 1e-3),
    st.floats(np.pi - 1e-3, np.pi - 1e-9),
)
translations = st.tuples(*[st.floats(-100, 100)] * 3).map(np.array)


@st.composite
def tangents(draw):
    axis = draw(unit)
    return np.concatenate([draw(translations), draw(angles) * axis / np.linalg.norm(axis)])


motions = tangents().map(se3.exp)


def close(a, b, atol=1e-9):
    return np.allclose(a, b, rtol=1e-9, atol=atol)


@given(motions)
def test_inverse(T_a_b):
    assert close(T_a_b @ se3.inverse(T_a_b), np.eye(4))
    assert close(se3.inverse(se3.inverse(T_a_b)), T_a_b)


@given(motions)
def test_exp_is_rigid(T):
    assert close(T[:3, :3] @ T[:3, :3].T, np.eye(3))
    assert np.linalg.det(T[:3, :3]) > 0
    assert (T[3] == [0, 0, 0, 1]).all()


@given(tangents())
def test_log_undoes_exp(tangent):
    # Near pi the axis is known to about the square root of machine precision.
    assert close(se3.log(se3.exp(tangent)), tangent, atol=1e-5)


@given(motions)
def test_exp_undoes_log(T):
    assert close(se3.exp(se3.log(T)), T, atol=1e-6)


@given(tangents())
def test_exp_of_the_opposite_is_the_inverse(tangent):
    assert close(se3.exp(-tangent), se3.inverse(se3.exp(tangent)))


@given(tangents())
def test_exp_of_half_the_tangent_is_the_square_root(tangent):
    """exp(x) = exp(x / 2)²: fails for a wrong left Jacobian, which a round trip would forgive."""
    half = se3.exp(tangent / 2)
    assert close(half @ half, se3.exp(tangent))


@given(motions, motions, translations)
def test_action_composes(T_a_b, T_b_c, point):
    points_c = np.stack([point, -point])
    there = se3.transform(T_a_b, se3.transform(T_b_c, points_c))
    assert close(se3.transform(T_a_b @ T_b_c, points_c), there, atol=1e-8)


@given(motions)
def test_quaternion_round_trip(T):
    assert close(se3.from_quat_wxyz(se3.to_quat_wxyz(T), T[:3, 3]), T)
    assert se3.to_quat_wxyz(T)[0] >= 0


def test_stacks_and_empty_stacks():
    tangents = np.random.default_rng(0).normal(size=(2, 3, 6))
    T = se3.exp(tangents)
    assert T.shape == (2, 3, 4, 4)
    assert close(T[1, 2], se3.exp(tangents[1, 2]))
    assert close(se3.log(T), tangents)
    assert se3.transform(np.eye(4), np.zeros((0, 3))).shape == (0, 3)


def test_hand_worked_quarter_turn():
    """Half a unit circle's chord: moving 1 forward while turning 90° left ends at (2/pi, 2/pi)."""
    T = se3.exp(np.array([1, 0, 0, 0, 0, np.pi / 2]))
    assert close(T[:3, 3], [2 / np.pi, 2 / np.pi, 0])
    assert close(T[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
