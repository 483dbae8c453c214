"""NEES on runs whose errors were drawn from the covariances that they come with."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from trials.evaluation.consistency import calibration, mean_bounds, nees, normalized, summarize
from trials.evaluation.covariances import Covariances
from trials.evaluation.runs import read_run
from vo.contract import se3
from vo.contract.errors import TrajectoryError
from vo.contract.estimator import Estimate, Status
from vo.contract.trajectory import Trajectory
from vo.runner import Run, companion, write_run

FRAMES = 60
TIMES = 1_000_000_000 + 50_000_000 * np.arange(FRAMES)


def drive(tmp_path, seed, belief=1.0, first=0, own=0.0):
    """A random walk of errors on 6 m of path; covariances are `belief` times the right ones.

    Beside the walk, each pose has an error of its own, `own` times that of a step.
    """
    rng = np.random.default_rng(seed)
    step = se3.exp(np.array([0.01, 0.0, 0.1, 0.0, 0.02, 0.0]))
    A = rng.normal(size=(6, 6)) * np.array([1e-3] * 3 + [3e-4] * 3)[:, None]
    Q = A @ A.T
    T_true, T_odom, P = [np.eye(4)], [np.eye(4)], [np.zeros((6, 6))]
    apart, Q_own = [np.eye(4)], own**2 * Q
    for _ in range(FRAMES - 1):
        noisy = step @ se3.exp(A @ rng.normal(size=6))
        T_true.append(T_true[-1] @ step)
        T_odom.append(T_odom[-1] @ noisy)
        P.append(se3.transform_covariance(se3.inverse(noisy), P[-1]) + belief * Q)
        apart.append(se3.exp(own * A @ rng.normal(size=6)))
    T_odom = [T @ e for T, e in zip(T_odom, apart, strict=True)]
    own_before = se3.transform_covariance(se3.inverse(step), Q_own)
    estimates = tuple(
        Estimate(int(t), Status.TRACKED if i else Status.START, T,
                 covariance=p + belief * Q_own * (i > 0),
                 step_covariance=belief * (Q + Q_own + own_before * (i > 1)) * (i > 0),
                 drift_covariance=belief * Q if own else None)
        for i, (t, T, p) in enumerate(zip(TIMES, T_odom, P, strict=True))
    )  # fmt: skip
    out = tmp_path / f"{seed}-{belief}.txt"
    write_run(out, Run("walk", estimates, (1.0,) * FRAMES), "walker", {}, tmp_path)
    T_world_odom = se3.exp(np.array([3.0, -2.0, 1.0, 0.4, 1.1, -2.0]))
    return Trajectory(TIMES[first:], (T_world_odom @ np.array(T_true))[first:]), read_run(out)


def test_nees_of_correct_covariances_is_chi_squared(tmp_path):
    runs = [nees(*drive(tmp_path, seed)) for seed in range(40)]
    steps = np.concatenate([x.step for x in runs])
    assert np.isnan(steps[::FRAMES]).all()
    steps = steps[np.isfinite(steps)]
    assert len(steps) == 40 * (FRAMES - 1)
    assert kstest(steps, chi2(6).cdf).pvalue > 0.01
    low, high = mean_bounds(40, 0.999)
    for kind in ("absolute", "over_1m"):
        last = np.array([getattr(x, kind)[-1] for x in runs])
        assert low < last.mean() < high, kind
    levels = np.linspace(0.1, 0.9, 9)
    np.testing.assert_allclose(calibration(steps, levels), levels, atol=0.03)


def test_nees_over_1m_counts_both_own_errors_of_poses(tmp_path):
    """What a pose errs by itself is in no later pose, and adds to a motion at both of its ends."""
    runs = [nees(*drive(tmp_path, seed, own=5.0)) for seed in range(40)]
    low, high = mean_bounds(40, 0.999)
    for kind in ("absolute", "step", "over_1m"):
        last = np.array([getattr(x, kind)[-1] for x in runs])
        assert low < last.mean() < high, kind


def test_own_errors_of_both_ends_of_a_motion_count():
    """A blurred frame errs by more than those before, and so does every motion that ends there."""
    own = np.array([0.0, 1.0, 1.0, 9.0])[:, None, None] * np.eye(6)
    drift = 0.25 * np.tile(np.eye(6), (4, 1, 1))
    steps = own + np.roll(own, 1, axis=0) + drift
    found = Covariances(np.tile(np.eye(4), (4, 1, 1)), own, steps, drift)
    motions = found.of_motions(np.array([1, 1, 2]), np.array([2, 3, 3]))
    np.testing.assert_allclose(motions[:, 0, 0], [2.25, (2.25 + 10.25) / 2 + 0.25, 10.25])
    summed = Covariances(found.T_odom_cam, own, drift, drift)  # all of a step's error lasts
    last = summed.of_motions(np.array([0]), np.array([3]))
    np.testing.assert_allclose(last[0], 3 * drift[0])


def test_nees_of_overconfident_covariances_is_large(tmp_path):
    truth, run = drive(tmp_path, 0)
    sure, right = nees(*drive(tmp_path, 0, belief=0.25)), nees(truth, run)
    for kind in ("absolute", "step", "over_1m"):
        np.testing.assert_allclose(getattr(sure, kind), 4 * getattr(right, kind), rtol=1e-6)
    assert calibration(sure.step, np.array([0.9]))[0] < 0.6


def test_nees_needs_1m_of_path_and_two_truths_per_step(tmp_path):
    values = nees(*drive(tmp_path, 3, first=20))
    assert len(values.step) == FRAMES - 20
    assert np.isnan(values.step[0])
    assert np.isfinite(values.step[1:]).all()
    assert np.isnan(values.over_1m[:9]).all()
    assert np.isfinite(values.over_1m[12:]).all()


def test_summarize_by_status_keeps_its_frames(tmp_path):
    values = nees(*drive(tmp_path, 1))
    every, tracked = summarize([values])  # no step ends at the start, and no frame is weak
    assert (every.status, tracked.status) == ("all", Status.TRACKED.value)
    assert tracked.steps == every.steps == FRAMES - 1
    assert tracked.step == pytest.approx(values.step[1:].mean())
    assert every.absolute == pytest.approx(np.nanmean(values.absolute))


def test_nees_without_covariances_is_an_error(tmp_path):
    truth, run = drive(tmp_path, 2)
    companion(run.path, "covariance.npz").unlink()
    with pytest.raises(TrajectoryError, match=r"gave no covariances \(2-1.0.covariance.npz\)"):
        nees(truth, run)
    assert np.isnan(calibration(np.array([np.nan]), np.array([0.5]))).all()


def test_nees_of_singular_covariance_is_nan():
    flat = np.diag([1.0, 1, 1, 1, 1, 0])
    tied = np.eye(6)
    tied[0, 1] = tied[1, 0] = 1.0
    found = normalized(np.ones((3, 6)), np.array([flat, tied, np.diag(np.full(6, 0.5))]))
    np.testing.assert_allclose(found, [np.nan, np.nan, 12.0])
