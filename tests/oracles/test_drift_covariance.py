"""Covariances over several windows: against errors that templates repeat from frame to frame."""

from dataclasses import replace

import numpy as np
from passage import RIG, SIGMA, Passage

from vo.bundle_adjustment.adjust import Refined
from vo.config import RefinementSettings
from vo.contract import se3
from vo.map.local_map import pose_covariance
from vo.mapping.window_adjustment import LEAST_EXCESS, adjust_window, extend_covariance

SETTINGS = RefinementSettings(window=6, min_views=2)
OWN = np.diag([1e-8] * 3 + [1e-9] * 3)


def drive(seed, slope, keyframes=18):
    """Add keyframe after keyframe to a window, and adjust it; NEES of the last pose.

    The template of a landmark slides on its surface: by `slope` times SIGMA, a normal number for
    each direction, at each keyframe since the first that saw it.
    """
    passage = Passage(seed, keyframes, fresh=50)
    rng = np.random.default_rng(100 + seed)
    slide_px = rng.normal(scale=slope * SIGMA, size=(len(passage.points), 3))
    born = np.full(len(passage.points), keyframes)
    moved = []
    for i, k in enumerate(passage.keyframes):
        seen = k.observations
        born[seen.ids] = np.minimum(born[seen.ids], i)
        measured = seen.measured + slide_px[seen.ids] * (i - born[seen.ids])[:, None]
        seen = replace(seen, pixels=measured[:, :2], disparity_px=measured[:, 2])
        moved.append(replace(k, observations=seen))
    window = moved[:1]
    for k in moved[1:]:
        before = window[-1]
        step = se3.inverse(passage.T_odom_cam[k.serial - 1]) @ passage.T_odom_cam[k.serial]
        T = before.T_odom_cam @ step
        k = replace(k, T_odom_cam=T, covariance=pose_covariance(before, T, OWN))
        window = [*window, k][-SETTINGS.window :]
        local_map = passage.local_map(window)
        known = local_map.landmarks
        known = replace(known, views=known.views + 1, anchor=known.anchor + window[0].serial)
        local_map = replace(local_map, landmarks=known)
        window = list(adjust_window(local_map, RIG, SETTINGS)[0].keyframes)
    last = window[-1]
    error = se3.log(se3.inverse(passage.T_odom_cam[last.serial]) @ last.T_odom_cam)
    return error @ np.linalg.solve(last.covariance, error)


def test_drift_over_windows_covers_errors_that_templates_repeat():
    """Three windows: chi-squared of six degrees has a mean of 6; it was 41."""
    assert 2 < np.mean([drive(seed, 1.0) for seed in range(8)]) < 18


def test_drift_over_windows_is_not_exaggerated():
    """Independent errors average out over the keyframes of a window; others are allowed for."""
    assert 0.5 < np.mean([drive(seed, 0.0) for seed in range(8)]) < 9


def test_excess_below_that_of_independent_errors():
    """Of few landmarks they do so by chance; the loss weighs down some of independent errors."""
    keyframes = tuple(Passage(0, 3).keyframes)
    T, covariance = np.array([k.T_odom_cam for k in keyframes]), np.tile(OWN, (3, 1, 1))

    def of_excess(excess):
        excess = np.full(3, excess)
        points = np.zeros((9, 3)), np.zeros((9, 3, 3))
        refined = Refined(T, *points, covariance, excess, 1, 0.0, np.ones(2))
        return extend_covariance(keyframes, refined)

    np.testing.assert_array_equal(of_excess(0.6), of_excess(LEAST_EXCESS))
    assert np.trace(of_excess(1.2)) > 1.5 * np.trace(of_excess(0.6))
