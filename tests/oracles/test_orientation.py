"""Absolute orientation, both ways, against truth, SciPy and numbers worked by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vo.contract import se3
from vo.pose.absolute_orientation import ABSOLUTE_SOLVERS, absolute_orientation

each_solver = pytest.mark.parametrize("solver", ABSOLUTE_SOLVERS)


@each_solver
def test_orientation_hand_worked(solver):
    """A quarter turn to the left about z, then 1, 2, 3 m further."""
    points_b = np.array([[1.0, 0, 0], [0, 2, 0], [0, 0, 3], [1, 1, 1]])
    points_a = np.array([[1.0, 3, 3], [-1, 2, 3], [1, 2, 6], [0, 3, 4]])
    expected = [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    np.testing.assert_allclose(
        absolute_orientation(points_a, points_b, solver), expected, atol=1e-12
    )


@settings(max_examples=200)
@given(st.integers(3, 12), st.integers(0, 10**6), st.sampled_from(list(ABSOLUTE_SOLVERS)))
def test_orientation_undoes_any_motion(count, seed, solver):
    rng = np.random.default_rng(seed)
    T_a_b = se3.exp(rng.normal(size=6) * [5, 5, 5, 1, 1, 1])
    points_b = rng.normal(size=(count, 3))
    found = absolute_orientation(se3.transform(T_a_b, points_b), points_b, solver)
    # Three nearly collinear points leave the turn about their line to rounding.
    spread = np.linalg.svd(points_b - points_b.mean(axis=0), compute_uv=False)[1]
    assert np.abs(found - T_a_b).max() < 1e-12 / min(spread, 1.0) ** 2 + 1e-9


@each_solver
def test_orientation_equals_scipy_under_noise(solver):
    rng = np.random.default_rng(5)
    points_b = rng.normal(size=(50, 8, 3))
    T_a_b = se3.exp(rng.normal(size=(50, 6)))
    points_a = se3.transform(T_a_b, points_b) + rng.normal(scale=0.3, size=points_b.shape)
    ours = absolute_orientation(points_a, points_b, solver)
    for T, a, b in zip(ours, points_a, points_b, strict=True):
        R = Rotation.align_vectors(a - a.mean(axis=0), b - b.mean(axis=0))[0].as_matrix()
        expected = se3.pose(R, a.mean(axis=0) - R @ b.mean(axis=0))
        np.testing.assert_allclose(T, expected, atol=1e-7)


@each_solver
def test_orientation_never_mirrors(solver):
    """Points that a mirror would fit better, and points in a plane, where it would fit as well."""
    rng = np.random.default_rng(6)
    points = rng.normal(size=(100, 6, 3))
    mirrored = absolute_orientation(points * [1, 1, -1], points, solver)
    assert np.allclose(np.linalg.det(mirrored[:, :3, :3]), 1)
    for T, b in zip(mirrored, points, strict=True):
        a = b * [1, 1, -1]
        R = Rotation.align_vectors(a - a.mean(axis=0), b - b.mean(axis=0))[0].as_matrix()
        np.testing.assert_allclose(T[:3, :3], R, atol=1e-6)
    plane = points * [1, 1, 0]
    T_a_b = se3.exp(rng.normal(size=(100, 6)))
    found = absolute_orientation(se3.transform(T_a_b, plane), plane, solver)
    np.testing.assert_allclose(found, T_a_b, atol=1e-6)


def test_noise_shrinks_with_the_root_of_the_count():
    """Translation error of N points with isotropic noise s is s sqrt(3 / N), seen from their mean.

    Two-sided: a smaller error would mean that the truth leaked.
    """
    rng = np.random.default_rng(7)
    noise_m, count = 0.05, 40
    points_b = rng.normal(size=(500, count, 3))
    points_b -= points_b.mean(axis=1, keepdims=True)
    found = absolute_orientation(
        points_b + rng.normal(scale=noise_m, size=points_b.shape), points_b
    )
    rmse_m = np.sqrt((found[:, :3, 3] ** 2).sum(axis=1).mean())
    expected_m = noise_m * np.sqrt(3 / count)
    assert 0.9 * expected_m < rmse_m < 1.1 * expected_m


def test_both_ways_lead_to_the_same_minimum():
    """Also with noise as large as the cloud, for three points, and after half a turn."""
    rng = np.random.default_rng(8)
    for count, noise_m in [(3, 0.01), (4, 1.0), (30, 0.3)]:
        points_b = rng.normal(size=(300, count, 3))
        half_turn = Rotation.from_rotvec([np.pi, 0, 0]).as_matrix()
        points_a = points_b @ half_turn.T + rng.normal(scale=noise_m, size=points_b.shape)
        horn, umeyama = (
            absolute_orientation(points_a, points_b, solver) for solver in ABSOLUTE_SOLVERS
        )
        R = horn[:, :3, :3]
        np.testing.assert_allclose(
            R @ R.swapaxes(1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12
        )
        # Nearly equal eigenvalues leave the minimum flat, and its place to rounding.
        apart = np.abs(horn - umeyama).max(axis=(1, 2))
        assert np.median(apart) < 1e-14
        assert apart.max() < 1e-9


@each_solver
def test_a_stack_of_stacks_keeps_its_shape(solver):
    points = np.random.default_rng(9).normal(size=(2, 5, 4, 3))
    found = absolute_orientation(points + np.array([1, 2, 3]), points, solver)
    assert found.shape == (2, 5, 4, 4)
    np.testing.assert_allclose(found[..., :3, 3], np.broadcast_to([1, 2, 3], (2, 5, 3)), atol=1e-12)
    assert absolute_orientation(points[:0], points[:0], solver).shape == (0, 5, 4, 4)


@each_solver
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_numbers_that_are_none_give_none(solver, bad):
    points = np.random.default_rng(10).normal(size=(2, 4, 3))
    spoilt = points.copy()
    spoilt[0, 2, 1] = bad
    found = absolute_orientation(spoilt, points, solver)
    assert np.isnan(found[0, :3]).all()
    np.testing.assert_allclose(found[1], np.eye(4), atol=1e-12)
