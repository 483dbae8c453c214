"""Absolute orientation against truth, SciPy and numbers worked by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vo.contract import se3
from vo.pose.absolute_orientation import absolute_orientation


def orient(points_a, points_b):
    """(..., 4, 4) T_a_b of stacks of points (..., N, 3); NaN where there is none."""
    T_a_b = np.tile(np.eye(4), (*points_a.shape[:-2], 1, 1))
    rows = np.arange(points_a.shape[-2])
    for i in np.ndindex(points_a.shape[:-2]):
        if not absolute_orientation(points_a[i], points_b[i], rows, T_a_b[i][:3]):
            T_a_b[i][:3] = np.nan
    return T_a_b


def test_orientation_quarter_turn_hand_worked():
    """A quarter turn to the left about z, then 1, 2, 3 m further."""
    points_b = np.array([[1.0, 0, 0], [0, 2, 0], [0, 0, 3], [1, 1, 1]])
    points_a = np.array([[1.0, 3, 3], [-1, 2, 3], [1, 2, 6], [0, 3, 4]])
    expected = [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    np.testing.assert_allclose(orient(points_a, points_b), expected, atol=1e-12)


@settings(max_examples=200)
@given(st.integers(3, 12), st.integers(0, 10**6))
def test_orientation_exact_points_give_motion(count, seed):
    rng = np.random.default_rng(seed)
    T_a_b = se3.exp(rng.normal(size=6) * [5, 5, 5, 1, 1, 1])
    points_b = rng.normal(size=(count, 3))
    found = orient(se3.transform(T_a_b, points_b), points_b)
    # Three nearly collinear points leave the turn about their line to rounding.
    extent = np.linalg.svd(points_b - points_b.mean(axis=0), compute_uv=False)[1]
    assert np.abs(found - T_a_b).max() < 1e-12 / min(extent, 1.0) ** 2 + 1e-9


def test_orientation_with_noise_equals_scipy():
    rng = np.random.default_rng(5)
    points_b = rng.normal(size=(50, 8, 3))
    T_a_b = se3.exp(rng.normal(size=(50, 6)))
    points_a = se3.transform(T_a_b, points_b) + rng.normal(scale=0.3, size=points_b.shape)
    ours = orient(points_a, points_b)
    for T, a, b in zip(ours, points_a, points_b, strict=True):
        R = Rotation.align_vectors(a - a.mean(axis=0), b - b.mean(axis=0))[0].as_matrix()
        expected = se3.pose(R, a.mean(axis=0) - R @ b.mean(axis=0))
        np.testing.assert_allclose(T, expected, atol=1e-7)


def test_orientation_never_mirrors():
    """Points that a mirror would fit better, and points in a plane, where it would fit as well."""
    rng = np.random.default_rng(6)
    points = rng.normal(size=(100, 6, 3))
    mirrored = orient(points * [1, 1, -1], points)
    assert np.allclose(np.linalg.det(mirrored[:, :3, :3]), 1)
    for T, b in zip(mirrored, points, strict=True):
        a = b * [1, 1, -1]
        R = Rotation.align_vectors(a - a.mean(axis=0), b - b.mean(axis=0))[0].as_matrix()
        np.testing.assert_allclose(T[:3, :3], R, atol=1e-6)
    plane = points * [1, 1, 0]
    T_a_b = se3.exp(rng.normal(size=(100, 6)))
    found = orient(se3.transform(T_a_b, plane), plane)
    np.testing.assert_allclose(found, T_a_b, atol=1e-6)


def test_orientation_error_shrinks_with_root_of_count():
    """Translation error of N points with isotropic noise s is s sqrt(3 / N), seen from their mean.

    Two-sided: a smaller error would mean that the truth leaked.
    """
    rng = np.random.default_rng(7)
    noise_m, count = 0.05, 40
    points_b = rng.normal(size=(500, count, 3))
    points_b -= points_b.mean(axis=1, keepdims=True)
    found = orient(points_b + rng.normal(scale=noise_m, size=points_b.shape), points_b)
    rmse_m = np.sqrt((found[:, :3, 3] ** 2).sum(axis=1).mean())
    expected_m = noise_m * np.sqrt(3 / count)
    assert 0.9 * expected_m < rmse_m < 1.1 * expected_m


def test_orientation_minimum_equals_nearest_rotation():
    """Also with noise as large as the cloud, for three points, and after half a turn."""
    rng = np.random.default_rng(8)
    for count, noise_m in [(3, 0.01), (4, 1.0), (30, 0.3)]:
        points_b = rng.normal(size=(300, count, 3))
        half_turn = Rotation.from_rotvec([np.pi, 0, 0]).as_matrix()
        points_a = points_b @ half_turn.T + rng.normal(scale=noise_m, size=points_b.shape)
        R = orient(points_a, points_b)[:, :3, :3]
        np.testing.assert_allclose(
            R @ R.swapaxes(1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12
        )
        a, b = (x - x.mean(axis=1, keepdims=True) for x in (points_a, points_b))
        by_svd = np.stack([se3.nearest_rotation(x.T @ y)[0] for x, y in zip(a, b, strict=True)])
        # Nearly equal eigenvalues leave the minimum flat, and its place to rounding.
        apart = np.abs(R - by_svd).max(axis=(1, 2))
        assert np.median(apart) < 1e-14
        assert apart.max() < 1e-9


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_orientation_not_finite_is_refused(bad):
    points = np.random.default_rng(10).normal(size=(2, 4, 3))
    spoilt = points.copy()
    spoilt[0, 2, 1] = bad
    found = orient(spoilt, points)
    assert np.isnan(found[0, :3]).all()
    np.testing.assert_allclose(found[1], np.eye(4), atol=1e-12)
