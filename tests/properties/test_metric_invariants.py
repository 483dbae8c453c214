"""What must hold of any metric on any trajectory."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trials.evaluation.alignment import Alignment, Pair, fit, umeyama
from trials.evaluation.metrics import errors_over_distance, errors_over_time, position_errors
from vo.contract import se3

seeds = st.integers(0, 2**32 - 1)


def wander(seed, frames=60):
    """A smooth random walk of a camera, about 0.1 m a frame."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(scale=[0.02, 0.02, 0.03, 0.02, 0.05, 0.02], size=(frames, 6))
    steps[:, 2] += 0.1
    T = [se3.exp(rng.normal(size=6))]
    for step in steps:
        T.append(T[-1] @ se3.exp(step))
    return np.array(T)


def noisy(seed):
    rng = np.random.default_rng(seed)
    T = wander(seed)
    wrong = T @ se3.exp(rng.normal(scale=0.01, size=(len(T), 6)))
    return Pair(np.arange(len(T)), T, wrong)


def moved(pair, T_a_odom):
    return Pair(pair.timestamps_ns, pair.T_world_cam, T_a_odom @ pair.T_odom_cam)


def relative(pair):
    return errors_over_distance(pair, 1.0), errors_over_time(pair, 3)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_errors_of_the_truth_are_zero(seed):
    T = wander(seed)
    itself = Pair(np.arange(len(T)), T, T)
    assert all(position_errors(itself, a).max() < 1e-9 for a in Alignment)
    for errors in relative(itself):
        assert errors.translation_m.max() < 1e-9
        assert errors.rotation_rad.max() < 1e-6


@settings(max_examples=20, deadline=None)
@given(seeds, seeds)
def test_errors_do_not_depend_on_the_estimates_frame(seed, frame):
    pair = noisy(seed)
    other = moved(pair, se3.exp(3 * np.random.default_rng(frame).normal(size=6)))
    for alignment in Alignment:
        before, after = (position_errors(x, alignment) for x in (pair, other))
        assert np.allclose(before, after, atol=1e-8)
    for before, after in zip(relative(pair), relative(other), strict=True):
        assert np.allclose(before.translation_m, after.translation_m, atol=1e-8)
        assert np.allclose(before.rotation_rad, after.rotation_rad, atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(seeds, st.floats(0.5, 2))
def test_scale_error_is_measured_exactly(seed, scale):
    """A segment errs by |scale - 1| times its chord; Sim(3) finds 1 / scale and removes it."""
    T = wander(seed)
    wrong = T.copy()
    wrong[:, :3, 3] *= scale
    pair = Pair(np.arange(len(T)), T, wrong)
    errors = errors_over_distance(pair, 1.0)
    assert (errors.translation_m <= abs(scale - 1) * 1.0 + 1e-9).all()
    steps = errors_over_time(pair, 1)
    assert np.allclose(steps.translation_m, abs(scale - 1) * steps.length_m)
    assert position_errors(pair, Alignment.SIM3).max() < 1e-8
    assert fit(pair, Alignment.SIM3).scale == pytest.approx(1 / scale)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.5, 2), st.integers(2, 40))
def test_scale_error_is_drift_on_a_straight_path(scale, frames):
    T = np.tile(np.eye(4), (frames + 1, 1, 1))
    T[:, 2, 3] = np.linspace(0, 3, frames + 1)
    wrong = T.copy()
    wrong[:, 2, 3] *= scale
    errors = errors_over_distance(Pair(np.arange(frames + 1), T, wrong), 1.0)
    assert np.allclose(errors.translation_m, abs(scale - 1))


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_alignment_with_more_freedom_fits_no_worse(seed):
    pair = noisy(seed)
    first, rigid, similar = (
        np.sqrt(np.mean(position_errors(pair, a) ** 2))
        for a in (Alignment.FIRST_POSE, Alignment.SE3, Alignment.SIM3)
    )
    assert similar <= rigid + 1e-12
    assert rigid <= first + 1e-12


@settings(max_examples=20, deadline=None)
@given(seeds, st.floats(0.1, 10))
def test_umeyama_recovers_the_motion(seed, scale):
    rng = np.random.default_rng(seed)
    T_a_b, points_b = se3.exp(rng.normal(size=6)), rng.normal(size=(10, 3))
    points_a = scale * points_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]
    found = umeyama(points_a, points_b, with_scale=True)
    assert found.scale == pytest.approx(scale)
    assert np.allclose(found.R_a_b, T_a_b[:3, :3])
    assert np.allclose(found.t_a_b, T_a_b[:3, 3], atol=1e-9 * max(scale, 1))
