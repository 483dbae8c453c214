"""Both backends of bundle adjustment on real windows, and GTSAM's factors against hand-worked ones.

`windows.npz` holds windows of eight keyframes that the default settings and the thesis preset
adjusted on rendered drives (`trials.studies.speed.backends.record_windows`): brick_court with
half of the sensor noise and office with all of it, seed 3.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X

from trials.studies.speed.backends import adjust
from vo.bundle_adjustment.gtsam_backend import factor_graph
from vo.bundle_adjustment.problem import Bundle
from vo.config import THESIS, RefinementSettings
from vo.contract import se3

WINDOWS = {
    "textured": RefinementSettings(),
    "noisy": RefinementSettings(),
    "textured_thesis": THESIS.refinement,
    "noisy_thesis": THESIS.refinement,
}
STEP_M, LIMIT = 1e-9, 200
"""Change of a pose that ends the repeated adjustments, and their largest number."""


def window(name):
    with np.load(Path(__file__).with_name("windows.npz")) as archive:
        values = {x.split(".")[1]: archive[x] for x in archive.files if x.startswith(f"{name}.")}
    wide = {"points_world": np.float64, "measured": np.float64, "sigma": np.float64}
    wide |= {"camera": np.int64, "point": np.int64}
    for key, kind in wide.items():
        values[key] = values[key].astype(kind)
    values["baseline_m"] = float(values["baseline_m"])
    return Bundle(**values)


def difference(T_a, T_b):
    """Largest component of (metres, radians)."""
    return np.abs(se3.log(se3.inverse(T_a) @ T_b)).max()


def converge(bundle, settings, backend):
    """Adjust a bundle again and again, until no pose moves any more."""
    found = adjust(bundle, settings, backend)
    for _ in range(LIMIT - 1):
        bundle = replace(bundle, T_world_cam=found.T_world_cam, points_world=found.points_world)
        found = adjust(bundle, settings, backend)
        if np.abs(found.T_world_cam - bundle.T_world_cam).max() < STEP_M:
            break
    return found


@cache
def converged_by_factors(name):
    return converge(window(name), WINDOWS[name], "gtsam")


@pytest.mark.parametrize("name", WINDOWS)
def test_backends_converge_to_the_same_poses(name):
    bundle, settings = window(name), WINDOWS[name]
    assert np.isnan(bundle.measured[:, 2]).sum() > 10
    schur, by_factors = converge(bundle, settings, "schur"), converged_by_factors(name)
    moved = difference(schur.T_world_cam, bundle.T_world_cam)
    assert moved > 5e-5
    assert difference(schur.T_world_cam, by_factors.T_world_cam) < 1e-6
    near = np.abs(schur.points_world - schur.T_world_cam[0, :3, 3]).max(axis=1) < 10
    assert near.mean() > 0.8
    apart = np.abs(schur.points_world - by_factors.points_world)[near]
    assert np.median(apart) < 1e-6
    assert by_factors.error == pytest.approx(schur.error, rel=1e-6)
    deviations = (
        np.sqrt(np.diagonal(x.covariance[~bundle.fixed], axis1=1, axis2=2))
        for x in (schur, by_factors)
    )
    np.testing.assert_allclose(*deviations, rtol=1e-3)


def test_backends_agree_where_disparities_are_lost():
    """Most measurements are of the left camera alone."""
    bundle = window("textured_thesis")
    measured = bundle.measured.copy()
    lost = np.random.default_rng(0).random(len(measured)) < 0.7
    measured[lost, 2] = np.nan
    spoilt = replace(bundle, measured=measured)
    schur, by_factors = (converge(spoilt, THESIS.refinement, x) for x in ("schur", "gtsam"))
    assert difference(schur.T_world_cam, bundle.T_world_cam) > 1e-4
    assert difference(schur.T_world_cam, by_factors.T_world_cam) < 1e-6


@pytest.mark.parametrize("name", WINDOWS)
def test_backends_are_close_after_one_adjustment(name):
    """The elimination renews the Huber weights once, GTSAM at every step."""
    bundle, settings = window(name), WINDOWS[name]
    schur, by_factors = (adjust(bundle, settings, x) for x in ("schur", "gtsam"))
    best = converged_by_factors(name).T_world_cam
    errors = [difference(x.T_world_cam, best) for x in (schur, by_factors)]
    assert errors[1] < errors[0] < 0.6 * difference(bundle.T_world_cam, best)
    assert schur.iterations <= settings.max_iterations
    assert by_factors.iterations <= settings.max_iterations


def one_measurement(disparity_px, error_px):
    """A camera at rest that sees a point 2 m ahead, off by an error in (u, v, disparity)."""
    K = np.array([[400.0, 0, 320], [0, 400, 240], [0, 0, 1]])
    measured = np.array([[320.0, 240, disparity_px]]) + error_px
    return Bundle(
        T_world_cam=np.eye(4)[None],
        points_world=np.array([[0.0, 0, 2]]),
        camera=np.array([0]),
        point=np.array([0]),
        measured=measured,
        sigma=np.array([[0.2, 0.4, 0.1]]),
        fixed=np.array([False]),
        K=K,
        baseline_m=0.1,
    )


@pytest.mark.parametrize("disparity", [20.0, np.nan], ids=["stereo", "left"])
def test_factor_error_is_the_joint_huber_loss(disparity):
    """Residuals in sigmas are (2, 1, 3) or (2, 1); k |r| - k² / 2 beyond k, by hand."""
    bundle = one_measurement(disparity, [0.4, 0.4, 0.3])
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose3())
    values.insert(L(0), bundle.points_world[0])
    norm = np.sqrt(14) if np.isfinite(disparity) else np.sqrt(5)
    for huber, expected in ((1.5, 1.5 * norm - 1.5**2 / 2), (10.0, norm**2 / 2)):
        graph = factor_graph(bundle, RefinementSettings(huber=huber))
        assert graph.size() == 1
        assert graph.error(values) == pytest.approx(expected)


def test_gtsam_covariance_equals_marginals():
    """GTSAM's own marginals, where residuals do not exceed the assumed noise."""
    bundle = window("textured_thesis")
    bundle = replace(bundle, sigma=3 * bundle.sigma)
    found = converge(bundle, THESIS.refinement, "gtsam")
    solved = replace(bundle, T_world_cam=found.T_world_cam, points_world=found.points_world)
    values = gtsam.Values()
    for i, T in enumerate(solved.T_world_cam):
        values.insert(X(i), gtsam.Pose3(T))
    for j, point in enumerate(solved.points_world):
        values.insert(L(j), point)
    graph = factor_graph(solved, THESIS.refinement)
    marginals = gtsam.Marginals(graph, values)
    turn = [3, 4, 5, 0, 1, 2]
    for i in np.flatnonzero(~bundle.fixed):
        expected = marginals.marginalCovariance(X(i))[turn][:, turn]
        deviation = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(
            found.covariance[i] / np.outer(deviation, deviation),
            expected / np.outer(deviation, deviation),
            atol=1e-3,
        )


def test_gtsam_backend_keeps_cameras_without_measurements():
    bundle = window("textured_thesis")
    kept = bundle.camera != 3
    fields = {x: getattr(bundle, x)[kept] for x in ("camera", "point", "measured", "sigma")}
    spoilt = replace(bundle, **fields, fixed=bundle.fixed | (np.arange(8) == 3))
    found = adjust(spoilt, THESIS.refinement, "gtsam")
    assert (found.T_world_cam[3] == bundle.T_world_cam[3]).all()
    assert difference(found.T_world_cam[[4]], bundle.T_world_cam[[4]]) > 1e-4


@pytest.mark.parametrize("backend", ["schur", "gtsam"])
def test_backends_survive_points_behind_cameras(backend):
    bundle = window("textured_thesis")
    points = bundle.points_world.copy()
    T = bundle.T_world_cam[4]
    points[:20] = T[:3, 3] - np.outer(np.linspace(0.1, 2, 20), T[:3, 2])
    found = adjust(replace(bundle, points_world=points), THESIS.refinement, backend)
    assert np.isfinite(found.T_world_cam).all()
    assert np.isfinite(found.covariance).all()
    clean = adjust(bundle, THESIS.refinement, backend)
    assert difference(found.T_world_cam, clean.T_world_cam) < 0.05


def test_gtsam_backend_without_determined_poses_returns_them():
    """One measurement leaves most of camera and point open."""
    bundle = one_measurement(20.0, [0.4, 0.4, 0.3])
    found = adjust(bundle, RefinementSettings(), "gtsam")
    assert np.isfinite(found.T_world_cam).all()
    assert difference(found.T_world_cam, bundle.T_world_cam) < 0.1
