"""Bundle adjustment against published figures, SciPy, truth and the covariance of its errors."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from vo.bundle_adjustment.adjust import refine_motion, refine_structure
from vo.bundle_adjustment.problem import Bundle
from vo.config import RefinementSettings
from vo.contract import se3
from vo.contract.rig import StereoRig

RIG = StereoRig(640, 480, 457.0, 319.5, 239.5, 0.09)
T_WORLD_CAM = se3.exp(np.array([0.4, -0.2, 0.3, 0.1, -0.3, 0.2]))
NUDGE = se3.exp(np.array([0.03, -0.02, 0.04, 0.01, 0.02, -0.015]))
SIGMA = np.array([0.2, 0.2, 0.4])
PLAIN = RefinementSettings(huber=1e6, max_iterations=50)
"""Least squares: no loss."""


def points_ahead(count, rng):
    """Points in view of T_WORLD_CAM, 1 to 5 m away."""
    pixels = rng.uniform([40, 20], [600, 460], (count, 2))
    points_cam = RIG.triangulate(pixels, RIG.f_px * RIG.baseline_m / rng.uniform(1, 5, count))
    return se3.transform(T_WORLD_CAM, points_cam)


def measure(T_world_cam, points_world, rng=None):
    """(N, 3) pixels and disparities, with noise if there is a generator."""
    seen = RIG.project(se3.transform(se3.inverse(T_world_cam), points_world))
    if rng is not None:
        seen = seen + rng.normal(scale=SIGMA, size=seen.shape)
    return seen


def refined(T_start, points, measured, settings=PLAIN):
    sigma = np.tile(SIGMA, (len(points), 1))
    return refine_motion(T_start, points, measured, sigma, RIG, settings)


def whitened(T_world_cam, points_world, measured):
    """Residuals (N, 3) over their noise, zero where nothing was measured."""
    seen = RIG.project(se3.transform(se3.inverse(T_world_cam), points_world))
    return np.nan_to_num((seen - measured) / SIGMA)


def jacobian(T_world_cam, *data, step=1e-6):
    """By central differences over tangents (v, w) on the right: (3 N, 6)."""
    columns = [
        whitened(T_world_cam @ se3.exp(e), *data) - whitened(T_world_cam @ se3.exp(-e), *data)
        for e in step * np.eye(6)
    ]
    return np.stack([c.ravel() for c in columns], axis=1) / (2 * step)


def covariance_by_differences(T_world_cam, *data):
    """The covariance is the inverse information where scores of squares have no more.

    There are six squares along the width; of Cameron and Miller, 2015, eq. 11.
    """
    J = jacobian(T_world_cam, *data).reshape(-1, 3, 6)
    scores = np.einsum("nij,ni->nj", J, whitened(T_world_cam, *data))
    inverse = np.linalg.inv(np.einsum("nij,nik->jk", J, J))
    square = data[1][:, :2] // (2 * RIG.cx_px / 6)
    _, square = np.unique(square, axis=0, return_inverse=True)
    sums = np.array([scores[square == k].sum(axis=0) for k in range(square.max() + 1)])
    B = sums.T @ sums * len(sums) / max(len(sums) - 6, len(sums) / 2)
    root = np.linalg.cholesky(inverse)
    excess, turn = np.linalg.eigh(root.T @ B @ root)
    return root @ turn @ np.diag(np.maximum(excess, 1)) @ turn.T @ root.T


def scipy_motion(T_start, *data, loss="linear"):
    def residuals(tangent):
        r = whitened(T_start @ se3.exp(tangent), *data)
        return r.ravel() if loss == "linear" else np.linalg.norm(r, axis=1)

    f_scale = 1.5 if loss == "huber" else 1.0
    found = least_squares(residuals, np.zeros(6), loss=loss, f_scale=f_scale, xtol=1e-14)
    return T_start @ se3.exp(found.x)


def difference(T_a, T_b):
    return np.abs(se3.log(se3.inverse(T_a) @ T_b)).max()


@pytest.fixture(scope="module")
def sba_7(real_data):
    """Lourakis' demonstration: seven cameras, 465 points, 1916 projections."""
    folder = real_data("sba_7")
    cameras = np.loadtxt(folder / "7cams.txt")
    T_cam_world = se3.from_quat_wxyz(cameras[:, :4], cameras[:, 4:])
    points, views = [], []
    for line in (folder / "7pts.txt").read_text().splitlines():
        if line.startswith("#"):
            continue
        values = [float(x) for x in line.split()]
        views += [(len(points), *values[k : k + 3]) for k in range(4, len(values), 3)]
        points.append(values[:3])
    point, camera, u, v = np.array(views).T
    return Bundle(
        T_world_cam=se3.inverse(T_cam_world),
        points_world=np.array(points),
        camera=camera.astype(int),
        point=point.astype(int),
        measured=np.column_stack([u, v, np.full(len(u), np.nan)]),
        sigma=np.ones((len(u), 3)),
        fixed=np.arange(7) == 0,
        K=np.loadtxt(folder / "calib.txt"),
        baseline_m=1.0,
    )


def mean_squared_px2(bundle, T_world_cam, points_world):
    T_cam_world = se3.inverse(T_world_cam)[bundle.camera]
    p = np.einsum("mij,mj->mi", T_cam_world[:, :3, :3], points_world[bundle.point])
    p = (p + T_cam_world[:, :3, 3]) @ bundle.K.T
    return ((p[:, :2] / p[:, 2:] - bundle.measured[:, :2]) ** 2).sum(axis=1).mean()


def test_structure_of_sba_7_has_the_published_error(sba_7):
    assert (len(sba_7.points_world), len(sba_7.measured)) == (465, 1916)
    before = mean_squared_px2(sba_7, sba_7.T_world_cam, sba_7.points_world)
    assert before == pytest.approx(19.0947, abs=1e-4)
    settings = RefinementSettings(huber=1e6, max_iterations=100)
    refined = refine_structure(sba_7, settings)
    after = mean_squared_px2(sba_7, refined.T_world_cam, refined.points_world)
    assert after == pytest.approx(0.675396, abs=1e-5)
    assert refined.error == pytest.approx(after * 1916 / 2, rel=1e-6)
    assert refined.iterations < settings.max_iterations
    np.testing.assert_allclose(refined.T_world_cam[0], sba_7.T_world_cam[0], atol=1e-12)


@pytest.mark.parametrize("start", [T_WORLD_CAM, T_WORLD_CAM @ NUDGE], ids=["truth", "nearby"])
@pytest.mark.parametrize("mono", [False, True])
def test_motion_without_noise_is_true(start, mono):
    points = points_ahead(60, np.random.default_rng(0))
    measured = measure(T_WORLD_CAM, points)
    if mono:
        measured[:, 2] = np.nan
    found = refined(start, points, measured)
    assert difference(found.T_world_cam, T_WORLD_CAM) < 1e-6
    assert found.iterations >= int(start is not T_WORLD_CAM)


def test_motion_with_noise_equals_scipy():
    rng = np.random.default_rng(1)
    points = points_ahead(50, rng)
    measured = measure(T_WORLD_CAM, points, rng)
    measured[::3, 2] = np.nan
    found = refined(T_WORLD_CAM @ NUDGE, points, measured).T_world_cam
    expected = scipy_motion(T_WORLD_CAM, points, measured)
    assert difference(expected, T_WORLD_CAM) > 1e-4
    assert difference(found, expected) < 1e-5


def test_motion_error_has_the_covariance_of_noise():
    """Squared error over its covariance is 6 on average, the number of unknowns.

    Smaller would mean that the truth leaked, larger that information was lost.
    """
    rng = np.random.default_rng(2)
    normalised = []
    for _ in range(150):
        points = points_ahead(25, rng)
        data = points, measure(T_WORLD_CAM, points, rng)
        found = refined(T_WORLD_CAM @ NUDGE, *data)
        error = se3.log(se3.inverse(T_WORLD_CAM) @ found.T_world_cam)
        normalised.append(np.sum((jacobian(T_WORLD_CAM, *data) @ error) ** 2))
        expected = covariance_by_differences(found.T_world_cam, *data)
        deviation = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(
            found.covariance / np.outer(deviation, deviation),
            expected / np.outer(deviation, deviation),
            atol=1e-3,
        )
    # Of 150 means of chi-squared with 6 degrees the deviation is sqrt(12 / 150) = 0.28.
    assert 5.1 < np.mean(normalised) < 6.9


def test_motion_ignores_unknown_disparities():
    """With NaN it is as if only the left eye existed; with a value it does count."""
    rng = np.random.default_rng(3)
    points = points_ahead(40, rng)
    measured = measure(T_WORLD_CAM, points, rng)
    unknown = measured.copy()
    unknown[:, 2] = np.nan
    mono = refined(T_WORLD_CAM @ NUDGE, points, unknown).T_world_cam
    stereo = refined(T_WORLD_CAM @ NUDGE, points, measured).T_world_cam
    assert difference(mono, scipy_motion(T_WORLD_CAM, points, unknown)) < 1e-5
    assert difference(mono, stereo) > 1e-5


def test_motion_with_outliers_is_held_by_huber():
    rng = np.random.default_rng(4)
    points = points_ahead(80, rng)
    measured = measure(T_WORLD_CAM, points, rng)
    measured[::8, :2] += rng.uniform(3, 6, (10, 2))
    robust = PLAIN.model_copy(update={"huber": 1.5})
    plain, held = (
        difference(refined(T_WORLD_CAM, points, measured, s).T_world_cam, T_WORLD_CAM)
        for s in (PLAIN, robust)
    )
    assert plain > 5e-3
    assert 1e-5 < held < plain / 4
    # SciPy minimises the same loss to the end; three renewals of the weights come close.
    found = refined(T_WORLD_CAM, points, measured, robust).T_world_cam
    expected = scipy_motion(T_WORLD_CAM, points, measured, loss="huber")
    assert difference(found, expected) < held / 2


def test_motion_with_points_behind_is_finite():
    rng = np.random.default_rng(5)
    points = points_ahead(30, rng)
    measured = measure(T_WORLD_CAM, points)
    points[0] = T_WORLD_CAM[:3, 3] - 2 * T_WORLD_CAM[:3, 2]
    found = refined(T_WORLD_CAM, points, measured, PLAIN.model_copy(update={"huber": 1.5}))
    assert np.isfinite(found.T_world_cam).all()


@pytest.fixture
def stereo_bundle():
    """Four cameras a step apart and forty points; some measurements are of one eye only."""
    rng = np.random.default_rng(6)
    points = points_ahead(40, rng)
    steps = np.outer(np.arange(4), [0.05, 0.01, 0.08, 0.01, -0.02, 0.005])
    T_world_cam = T_WORLD_CAM @ se3.exp(steps)
    measured = np.concatenate([measure(T, points, rng) for T in T_world_cam])
    measured[::5, 2] = np.nan
    return Bundle(
        T_world_cam=np.concatenate([T_world_cam[:1], T_world_cam[1:] @ NUDGE]),
        points_world=points + rng.normal(scale=0.02, size=points.shape),
        camera=np.repeat(np.arange(4), 40),
        point=np.tile(np.arange(40), 4),
        measured=measured,
        sigma=np.tile(SIGMA, (160, 1)),
        fixed=np.arange(4) == 0,
        K=RIG.K,
        baseline_m=RIG.baseline_m,
    )


def test_structure_with_noise_equals_scipy(stereo_bundle):
    """Poses, points and final error, with stereo and mono measurements mixed."""
    b = stereo_bundle
    refined = refine_structure(b, PLAIN)

    def unpack(x):
        T = np.concatenate([b.T_world_cam[:1], b.T_world_cam[1:] @ se3.exp(x[:18].reshape(3, 6))])
        return T, b.points_world + x[18:].reshape(-1, 3)

    def residuals(x):
        T, points = unpack(x)
        parts = []
        for i in range(4):
            own = b.camera == i
            parts.append(whitened(T[i], points, b.measured[own]))
        return np.concatenate(parts).ravel()

    found = least_squares(residuals, np.zeros(18 + 120), xtol=1e-12, ftol=1e-12)
    T, points = unpack(found.x)
    assert refined.error == pytest.approx(found.cost, rel=1e-4)
    assert max(difference(a, c) for a, c in zip(refined.T_world_cam, T, strict=True)) < 1e-4
    assert np.abs(refined.points_world - points).max() < 1e-3
    assert np.abs(refined.points_world - b.points_world).max() > 0.01


def test_structure_keeps_fixed_cameras(stereo_bundle):
    fixed = np.array([True, False, True, False])
    bundle = Bundle(**{**vars(stereo_bundle), "fixed": fixed})
    refined = refine_structure(bundle, PLAIN)
    moved = np.abs(refined.T_world_cam - bundle.T_world_cam).max(axis=(1, 2))
    assert (moved[fixed] < 1e-12).all()
    assert (moved[~fixed] > 1e-3).all()


def test_structure_with_outlier_is_held_by_huber(stereo_bundle):
    measured = stereo_bundle.measured.copy()
    measured[10, :2] += [25, -20]
    spoilt = Bundle(**{**vars(stereo_bundle), "measured": measured})
    clean = refine_structure(stereo_bundle, PLAIN)
    errors = [
        difference(refine_structure(spoilt, s).T_world_cam[3], clean.T_world_cam[3])
        for s in (PLAIN, PLAIN.model_copy(update={"huber": 1.5}))
    ]
    assert errors[1] < errors[0] / 3


def test_structure_covariance_equals_full_inverse(stereo_bundle):
    """The block of the inverse of all normal equations, points included, by differences."""
    b = stereo_bundle
    found = refine_structure(b, PLAIN)

    def residuals(x):
        T = np.concatenate(
            [found.T_world_cam[:1], found.T_world_cam[1:] @ se3.exp(x[:18].reshape(3, 6))]
        )
        points = found.points_world + x[18:].reshape(-1, 3)
        return np.concatenate(
            [whitened(T[i], points, b.measured[b.camera == i]).ravel() for i in range(4)]
        )

    steps = 1e-6 * np.eye(18 + 120)
    J = np.stack([(residuals(e) - residuals(-e)) / 2e-6 for e in steps], axis=1)
    covariance = np.linalg.inv(J.T @ J)[12:18, 12:18]
    np.testing.assert_allclose(found.covariance[3], covariance, rtol=1e-3, atol=1e-9)


def test_structure_iterations_are_bounded(stereo_bundle):
    refined = refine_structure(stereo_bundle, PLAIN.model_copy(update={"max_iterations": 1}))
    assert refined.iterations == 1
