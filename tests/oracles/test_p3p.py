"""P3P and absolute orientation against truth, OpenCV, SciPy and numbers worked by hand."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from vo.contract import se3
from vo.orientation import absolute_orientation
from vo.p3p import leg_lengths, solve_p3p

MOST_SOLUTIONS = 4


def unit(x):
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def triplets(count, nearest_m, farthest_m, seed=0):
    """Truth T_ref_cam, points in the reference frame, and the rays on which a camera sees them."""
    rng = np.random.default_rng(seed)
    T_ref_cam = se3.pose(
        Rotation.random(count, random_state=seed).as_matrix(), rng.normal(scale=5, size=(count, 3))
    )
    rays_cam = unit(np.append(rng.uniform(-0.7, 0.7, (count, 3, 2)), np.ones((count, 3, 1)), -1))
    legs = rng.uniform(nearest_m, farthest_m, (count, 3, 1))
    return T_ref_cam, se3.transform(T_ref_cam, legs * rays_cam), rays_cam


def pose_difference(T_a, T_b):
    return np.abs(T_a - T_b).max(axis=(-2, -1))


def opencv_solutions(points_ref, rays_cam):
    pixels = rays_cam[:, :2] / rays_cam[:, 2:]
    _, rotations, translations = cv2.solveP3P(
        points_ref[:, None], pixels[:, None], np.eye(3), None, cv2.SOLVEPNP_AP3P
    )
    T_cam_ref = [
        se3.pose(cv2.Rodrigues(r)[0], t.ravel())
        for r, t in zip(rotations, translations, strict=True)
    ]
    in_front = [T for T in T_cam_ref if (se3.transform(T, points_ref)[:, 2] > 0).all()]
    return se3.inverse(np.array(in_front).reshape(-1, 4, 4))


@pytest.mark.parametrize(("nearest_m", "farthest_m"), [(0.3, 1.0), (1.0, 8.0), (50.0, 80.0)])
def test_truth_is_among_the_solutions(nearest_m, farthest_m):
    T_ref_cam, points_ref, rays_cam = triplets(2000, nearest_m, farthest_m)
    found, triplet = solve_p3p(points_ref, rays_cam)
    assert found.shape == (len(triplet), 4, 4)
    error = pose_difference(found, T_ref_cam[triplet])
    best = np.full(len(T_ref_cam), np.inf)
    np.minimum.at(best, triplet, error)
    # Close to a double root the quartic loses half the digits, and sometimes the root.
    assert (best < 1e-3 * farthest_m).mean() > 0.997
    assert np.median(best) < 1e-9 * farthest_m
    counts = np.bincount(triplet, minlength=len(T_ref_cam))
    assert counts.max() == MOST_SOLUTIONS
    assert 1 < counts.mean() < 3


def test_every_solution_sees_the_points_on_the_rays():
    _, points_ref, rays_cam = triplets(2000, 0.5, 10.0, seed=1)
    T_ref_cam, triplet = solve_p3p(points_ref, rays_cam)
    seen = unit(se3.transform(se3.inverse(T_ref_cam), points_ref[triplet]))
    error_rad = np.linalg.norm(seen - rays_cam[triplet], axis=-1).max(axis=-1)
    assert error_rad.max() < 1e-4
    assert np.median(error_rad) < 1e-12
    R = T_ref_cam[:, :3, :3]
    assert np.allclose(R @ R.swapaxes(-1, -2), np.eye(3), atol=1e-9)
    assert (np.linalg.det(R) > 0).all()


def test_same_solutions_as_opencv():
    _, points_ref, rays_cam = triplets(500, 0.5, 8.0, seed=2)
    found, triplet = solve_p3p(points_ref, rays_cam)
    unlike = 0
    for b in range(len(points_ref)):
        ours, theirs = found[triplet == b], opencv_solutions(points_ref[b], rays_cam[b])
        apart = pose_difference(ours[:, None], theirs[None])
        matched = apart.size and max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-3
        unlike += not (matched and len(ours) == len(theirs))
    assert unlike <= 5  # of 500: pairs of roots about to become complex


def test_hand_worked_legs():
    """A regular tetrahedron: all six edges 2 m long, a double root at the truth."""
    points_ref = np.array([[[0, 0, 0], [2, 0, 0], [1, np.sqrt(3), 0]]])
    apex = np.array([1, 1 / np.sqrt(3), np.sqrt(8 / 3)])
    legs, triplet = leg_lengths(points_ref, unit(points_ref - apex))
    assert (triplet == 0).all()
    np.testing.assert_allclose(legs, 2, atol=1e-6)


def test_example_of_fischler_and_bolles():
    """Their appendix A: sides 2 sqrt(3), cosines 20 / 32; x^2 - 5 x + 4 = 0 has legs 1 and 4."""
    corners = 2 * np.array([[1, 0], [-0.5, np.sqrt(0.75)], [-0.5, -np.sqrt(0.75)]])
    points_ref = np.column_stack([corners, np.zeros(3)])
    rays_cam = unit(points_ref - [0, 0, np.sqrt(12)])
    legs, _ = leg_lengths(points_ref[None], rays_cam[None])
    expected = {(4, 4, 4), (1, 4, 4), (4, 1, 4), (4, 4, 1)}
    assert {tuple(row) for row in np.round(legs, 4).tolist()} == expected


LINE = np.array([[0.0, 0, 2], [0.5, 0.2, 2], [1.5, 0.6, 2]])
DEGENERATE = {
    "collinear": LINE,
    "two coincide": LINE[[0, 1, 1]],
    "other two coincide": LINE[[0, 0, 1]],
    "outer two coincide": LINE[[0, 1, 0]],
    "all coincide": LINE[[1, 1, 1]],
    "at the origin": np.zeros((3, 3)),
}


@pytest.mark.parametrize("points_cam", DEGENERATE.values(), ids=DEGENERATE)
def test_degenerate_samples_have_no_solution(points_cam):
    rays_cam = unit(points_cam + np.array([0, 0, 1e-9]))
    T_ref_cam = se3.exp(np.array([0.3, -1, 2, 0.1, 0.4, -0.2]))
    found, triplet = solve_p3p(se3.transform(T_ref_cam, points_cam)[None], rays_cam[None])
    assert found.shape == (0, 4, 4)
    assert triplet.shape == (0,)


def test_degenerate_samples_do_not_disturb_their_batch():
    _, points_ref, rays_cam = triplets(20, 1.0, 5.0, seed=3)
    alone, triplet_alone = solve_p3p(points_ref, rays_cam)
    points_ref, rays_cam = (np.repeat(x, 2, axis=0) for x in (points_ref, rays_cam))
    points_ref[1::2] = LINE
    together, triplet = solve_p3p(points_ref, rays_cam)
    np.testing.assert_array_equal(triplet, 2 * triplet_alone)
    np.testing.assert_allclose(together, alone, atol=1e-9)


@pytest.mark.parametrize(
    "rays",
    [
        pytest.param((0, 0, 0)),
        pytest.param((0, 0, 1)),
        (0, 1, 0),
        (0, 1, 1),
    ],
)
def test_impossible_rays_do_not_warn(rays):
    """Different points on one ray."""
    _, points_ref, rays_cam = triplets(200, 1.0, 5.0, seed=4)
    found, triplet = solve_p3p(points_ref, rays_cam[:, rays])
    assert np.isfinite(found).all()
    assert len(found) == len(triplet)


def test_nothing_in_nothing_out():
    found, triplet = solve_p3p(np.zeros((0, 3, 3)), np.zeros((0, 3, 3)))
    assert found.shape == (0, 4, 4)
    assert triplet.shape == (0,)


def test_orientation_hand_worked():
    """A quarter turn to the left about z, then 1, 2, 3 m further."""
    points_b = np.array([[1.0, 0, 0], [0, 2, 0], [0, 0, 3], [1, 1, 1]])
    points_a = np.array([[1.0, 3, 3], [-1, 2, 3], [1, 2, 6], [0, 3, 4]])
    expected = [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    np.testing.assert_allclose(absolute_orientation(points_a, points_b), expected, atol=1e-12)


@settings(max_examples=100)
@given(st.integers(3, 12), st.integers(0, 10**6))
def test_orientation_undoes_any_motion(count, seed):
    rng = np.random.default_rng(seed)
    T_a_b = se3.exp(rng.normal(size=6) * [5, 5, 5, 1, 1, 1])
    points_b = rng.normal(size=(count, 3))
    found = absolute_orientation(se3.transform(T_a_b, points_b), points_b)
    # Three nearly collinear points leave the turn about their line to rounding.
    spread = np.linalg.svd(points_b - points_b.mean(axis=0), compute_uv=False)[1]
    assert np.abs(found - T_a_b).max() < 1e-12 / min(spread, 1.0) ** 2 + 1e-9


def test_orientation_equals_scipy_under_noise():
    rng = np.random.default_rng(5)
    points_b = rng.normal(size=(50, 8, 3))
    T_a_b = se3.exp(rng.normal(size=(50, 6)))
    points_a = se3.transform(T_a_b, points_b) + rng.normal(scale=0.3, size=points_b.shape)
    ours = absolute_orientation(points_a, points_b)
    for T, a, b in zip(ours, points_a, points_b, strict=True):
        R = Rotation.align_vectors(a - a.mean(axis=0), b - b.mean(axis=0))[0].as_matrix()
        expected = se3.pose(R, a.mean(axis=0) - R @ b.mean(axis=0))
        np.testing.assert_allclose(T, expected, atol=1e-7)


def test_orientation_never_mirrors():
    """Points that a mirror would fit better, and points in a plane, where it would fit as well."""
    rng = np.random.default_rng(6)
    points = rng.normal(size=(100, 6, 3))
    mirrored = absolute_orientation(points * [1, 1, -1], points)
    assert np.allclose(np.linalg.det(mirrored[:, :3, :3]), 1)
    for T, b in zip(mirrored, points, strict=True):
        a = b * [1, 1, -1]
        R = Rotation.align_vectors(a - a.mean(axis=0), b - b.mean(axis=0))[0].as_matrix()
        np.testing.assert_allclose(T[:3, :3], R, atol=1e-6)
    plane = points * [1, 1, 0]
    T_a_b = se3.exp(rng.normal(size=(100, 6)))
    found = absolute_orientation(se3.transform(T_a_b, plane), plane)
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
