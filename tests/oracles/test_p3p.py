"""Both P3P solvers against truth, each other, OpenCV and numbers worked by hand."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vo.contract import se3
from vo.pose.p3p import SOLVERS, p3p

MAX_SOLUTIONS = 4

each_solver = pytest.mark.parametrize("solver", SOLVERS)


def solve(points_ref, rays_cam, solver="lambda_twist"):
    """Solve B triplets: (S, 4, 4) T_ref_cam, (S, 3) legs and (S,) triplet of each solution."""
    T_ref_cam, triplet = [np.zeros((0, 4, 4))], []
    poses = np.empty((MAX_SOLUTIONS, 3, 4))
    for b, (points, rays) in enumerate(zip(points_ref, rays_cam, strict=True)):
        count = p3p(points, np.ascontiguousarray(rays), SOLVERS[solver], poses)
        T_ref_cam.append(se3.inverse(se3.pose(poses[:count, :, :3], poses[:count, :, 3])))
        triplet += [b] * count
    T_ref_cam, triplet = np.concatenate(T_ref_cam), np.array(triplet, dtype=int)
    legs = np.linalg.norm(points_ref[triplet] - T_ref_cam[:, None, :3, 3], axis=-1)
    return T_ref_cam, legs, triplet


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


@each_solver
@pytest.mark.parametrize(("nearest_m", "farthest_m"), [(0.3, 1.0), (1.0, 8.0), (50.0, 80.0)])
def test_p3p_random_triplets_contain_truth(solver, nearest_m, farthest_m):
    T_ref_cam, points_ref, rays_cam = triplets(20_000, nearest_m, farthest_m)
    found, _, triplet = solve(points_ref, rays_cam, solver)
    assert found.shape == (len(triplet), 4, 4)
    error = pose_difference(found, T_ref_cam[triplet])
    best = np.full(len(T_ref_cam), np.inf)
    np.minimum.at(best, triplet, error)
    # Two roots that nearly coincide move by the square root of the rounding.
    assert best.max() < 1e-6 * farthest_m
    assert (best < 1e-9 * farthest_m).mean() > 0.999
    assert np.median(best) < 1e-12 * farthest_m
    counts = np.bincount(triplet, minlength=len(T_ref_cam))
    assert counts.max() == MAX_SOLUTIONS
    assert 1 < counts.mean() < 3


@each_solver
@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_p3p_does_not_depend_on_the_unit(solver, scale):
    """A scaled triplet has the same solutions, with scaled legs."""
    _, points_ref, rays_cam = triplets(50, 1.0, 8.0, seed=9)
    T_m, legs_m, triplet_m = solve(points_ref, rays_cam, solver)
    T, legs, triplet = solve(scale * points_ref, rays_cam, solver)
    assert np.array_equal(triplet, triplet_m)
    np.testing.assert_allclose(legs / scale, legs_m, rtol=1e-6)
    np.testing.assert_allclose(T[:, :3, :3], T_m[:, :3, :3], atol=1e-6)
    np.testing.assert_allclose(T[:, :3, 3] / scale, T_m[:, :3, 3], atol=1e-5)


@each_solver
def test_p3p_solutions_reproject_onto_rays(solver):
    _, points_ref, rays_cam = triplets(20_000, 0.5, 10.0, seed=1)
    T_ref_cam, _, triplet = solve(points_ref, rays_cam, solver)
    seen = unit(se3.transform(se3.inverse(T_ref_cam), points_ref[triplet]))
    error_rad = np.linalg.norm(seen - rays_cam[triplet], axis=-1).max(axis=-1)
    assert (error_rad < 1e-9).mean() > 0.999
    assert error_rad.max() < 1e-6
    R = T_ref_cam[:, :3, :3]
    assert np.allclose(R @ R.swapaxes(-1, -2), np.eye(3), atol=1e-12)
    assert (np.linalg.det(R) > 0).all()


def test_p3p_solvers_agree():
    _, points_ref, rays_cam = triplets(20_000, 0.5, 8.0, seed=2)
    sets = []
    for solver in SOLVERS:
        _, legs, triplet = solve(points_ref, rays_cam, solver)
        order = np.lexsort((*legs.T, triplet))
        sets.append((legs[order], np.bincount(triplet, minlength=len(points_ref))))
    (legs_a, counts_a), (legs_b, counts_b) = sets
    unlike = counts_a != counts_b  # pairs of roots about to become complex
    assert unlike.mean() < 1e-3
    pairs = zip(
        legs_a[np.repeat(~unlike, counts_a)], legs_b[np.repeat(~unlike, counts_b)], strict=True
    )
    apart = np.array([np.abs(a - b).max() for a, b in pairs])
    assert (apart < 1e-9).mean() > 0.998


@each_solver
def test_p3p_equals_opencv(solver):
    _, points_ref, rays_cam = triplets(1000, 0.5, 8.0, seed=2)
    found, _, triplet = solve(points_ref, rays_cam, solver)
    missing = 0
    more = 0
    for b in range(len(points_ref)):
        ours, theirs = found[triplet == b], opencv_solutions(points_ref[b], rays_cam[b])
        apart = pose_difference(ours[:, None], theirs[None])
        missing += len(theirs) and not (apart.size and apart.min(axis=0).max() < 1e-5)
        more += len(ours) > len(theirs)
    # OpenCV's quartic is the less exact one.
    assert missing <= 2
    assert more <= 15


@each_solver
def test_p3p_regular_tetrahedron_hand_worked(solver):
    """A regular tetrahedron: all six edges 2 m long, a double root at the truth."""
    points_ref = np.array([[[0, 0, 0], [2, 0, 0], [1, np.sqrt(3), 0]]])
    apex = np.array([1, 1 / np.sqrt(3), np.sqrt(8 / 3)])
    _, legs, triplet = solve(points_ref, unit(points_ref - apex), solver)
    assert (triplet == 0).all()
    np.testing.assert_allclose(legs, [[2, 2, 2]], atol=1e-6)


@each_solver
def test_p3p_fischler_bolles_example_has_four_solutions(solver):
    """Their appendix A: sides 2 sqrt(3), cosines 20 / 32; x^2 - 5 x + 4 = 0 has legs 1 and 4."""
    corners = 2 * np.array([[1, 0], [-0.5, np.sqrt(0.75)], [-0.5, -np.sqrt(0.75)]])
    points_ref = np.column_stack([corners, np.zeros(3)])
    rays_cam = unit(points_ref - [0, 0, np.sqrt(12)])
    _, legs, _ = solve(points_ref[None], rays_cam[None], solver)
    expected = {(4, 4, 4), (1, 4, 4), (4, 1, 4), (4, 4, 1)}
    assert {tuple(row) for row in np.round(legs, 9).tolist()} == expected
    assert len(legs) == 4


LINE = np.array([[0.0, 0, 2], [0.5, 0.2, 2], [1.5, 0.6, 2]])
DEGENERATE = {
    "collinear": LINE,
    "two coincide": LINE[[0, 1, 1]],
    "other two coincide": LINE[[0, 0, 1]],
    "outer two coincide": LINE[[0, 1, 0]],
    "all coincide": LINE[[1, 1, 1]],
    "at the origin": np.zeros((3, 3)),
}


@each_solver
@pytest.mark.parametrize("points_cam", DEGENERATE.values(), ids=DEGENERATE)
def test_p3p_degenerate_points_have_no_solution(points_cam, solver):
    rays_cam = unit(points_cam + np.array([0, 0, 1e-9]))
    T_ref_cam = se3.exp(np.array([0.3, -1, 2, 0.1, 0.4, -0.2]))
    found, _, triplet = solve(se3.transform(T_ref_cam, points_cam)[None], rays_cam[None], solver)
    assert found.shape == (0, 4, 4)
    assert triplet.shape == (0,)


@each_solver
def test_p3p_after_degenerate_triplet_is_unchanged(solver):
    _, points_ref, rays_cam = triplets(20, 1.0, 5.0, seed=3)
    alone, _, triplet_alone = solve(points_ref, rays_cam, solver)
    points_ref, rays_cam = (np.repeat(x, 2, axis=0) for x in (points_ref, rays_cam))
    points_ref[1::2] = LINE
    together, _, triplet = solve(points_ref, rays_cam, solver)
    np.testing.assert_array_equal(triplet, 2 * triplet_alone)
    np.testing.assert_allclose(together, alone, atol=1e-9)


@each_solver
@pytest.mark.parametrize(
    "rays",
    [
        pytest.param((0, 0, 0)),
        pytest.param((0, 0, 1)),
        (0, 1, 0),
        (0, 1, 1),
    ],
)
def test_p3p_coincident_rays_stay_finite(rays, solver):
    """Different points on one ray."""
    _, points_ref, rays_cam = triplets(200, 1.0, 5.0, seed=4)
    found, _, triplet = solve(points_ref, rays_cam[:, rays], solver)
    assert np.isfinite(found).all()
    assert len(found) == len(triplet)


@each_solver
@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e200])
def test_p3p_not_finite_has_no_solution(solver, bad):
    _, points_ref, rays_cam = triplets(3, 1.0, 5.0, seed=5)
    points_ref[0, 1, 2] = rays_cam[1, 2, 0] = bad
    _, _, triplet = solve(points_ref, rays_cam, solver)
    assert set(triplet) == {2}


@each_solver
def test_p3p_nearly_collinear_points_are_solved(solver):
    """A triangle a thousandth as high as it is long: legs as good as its shape allows."""
    rng = np.random.default_rng(6)
    T_ref_cam, points_ref, _ = triplets(2000, 1.0, 5.0, seed=6)
    points_ref[:, 2] = points_ref[:, 0] + rng.uniform(0.3, 0.7, (2000, 1)) * (
        points_ref[:, 1] - points_ref[:, 0]
    )
    points_ref[:, 2] += rng.normal(scale=2e-3, size=(2000, 3))
    rays_cam = unit(se3.transform(se3.inverse(T_ref_cam), points_ref))
    found, _, triplet = solve(points_ref, rays_cam, solver)
    best = np.full(2000, np.inf)
    np.minimum.at(best, triplet, pose_difference(found, T_ref_cam[triplet]))
    assert (best < 1e-6).mean() > 0.98
    assert (best < 1e-3).mean() > 0.995


@each_solver
def test_p3p_plane_facing_camera_contains_truth(solver):
    """Small triangles seen from straight ahead, where the solutions crowd together."""
    rng = np.random.default_rng(7)
    points_cam = np.append(rng.uniform(-1, 1, (2000, 3, 2)), np.full((2000, 3, 1), 4.0), -1)
    found, _, triplet = solve(points_cam, unit(points_cam), solver)
    best = np.full(2000, np.inf)
    np.minimum.at(best, triplet, pose_difference(found, np.eye(4)))
    assert (best < 1e-6).mean() > 0.99
