"""Consistency of an estimator's covariances with its errors (NEES, calibration).

The normalised estimation error squared e' P^-1 e has six degrees of freedom; its mean is 6 if the
covariance is correct and larger if the estimator is overconfident (Bar-Shalom, Li and Kirubarajan,
Estimation with Applications to Tracking and Navigation, 2001, section 5.4).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from trials.evaluation.alignment import Pair, associate
from trials.evaluation.covariances import read_covariances
from trials.evaluation.runs import SavedRun
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import TrajectoryError
from vo.contract.estimator import Status
from vo.contract.trajectory import Trajectory

DEGREES = 6
LENGTH_M = 1.0
CONFIDENCE = 0.95
MIN_EIGENVALUE_RATIO = 1e-12
"""Smallest over largest eigenvalue of a correlation matrix, below which it is singular."""


@dataclass(frozen=True)
class Nees:
    """Normalised errors of a run at the N times that have a truth; NaN where undefined.

    Attributes:
        timestamps_ns: (N,).
        status: N statuses; `tracked` if the run has no table of frames.
        absolute: (N,) of the motion since the first of these times.
        step: (N,) of the motion since the pose before.
        over_1m: (N,) of the motion over the last metre of true path.

    The covariances of motions are those of `Covariances.of_motions`.
    """

    timestamps_ns: Indices
    status: tuple[Status, ...]
    absolute: Array
    step: Array
    over_1m: Array


@dataclass(frozen=True)
class Summary:
    """NEES of some runs at the frames of one status.

    Attributes:
        status: Name, or "all".
        steps: Number of motions from frame to frame.
        step: Their mean NEES; 6 if covariances are correct.
        step_bounds: Its interval at CONFIDENCE for correct covariances and independent steps.
        step_inside: Fraction of steps inside the ellipsoid of probability CONFIDENCE.
        over_1m: Mean NEES of motions over 1 m; NaN if there are none.
        over_1m_inside: As for steps.
        absolute: Mean NEES of poses.
        absolute_bounds: Interval for one pose of every run, as poses of a run are correlated.
    """

    status: str
    steps: int
    step: float
    step_bounds: tuple[float, float]
    step_inside: float
    over_1m: float
    over_1m_inside: float
    absolute: float
    absolute_bounds: tuple[float, float]


def nees(truth: Trajectory, run: SavedRun) -> Nees:
    """Compute the NEES of a run that has `<stem>.covariance.npz` beside it.

    Raises:
        TrajectoryError: If there are no covariances, or fewer than two times are shared.
    """
    covariances, pair = read_covariances(run), associate(truth, run.trajectory)
    at = np.searchsorted(run.trajectory.timestamps_ns, pair.timestamps_ns)
    status = (Status.TRACKED,) * len(at)
    if run.frames is not None:
        by_time = dict(zip(run.frames.timestamps_ns.tolist(), run.frames.status, strict=True))
        status = tuple(by_time[x] for x in pair.timestamps_ns.tolist())
    step, over_1m = np.full((2, len(at)), np.nan)

    def of_motions(starts: Indices, ends: Indices) -> Array:
        errors = se3.log(pair.motion_errors(starts, ends))
        return normalized(errors, covariances.of_motions(at[starts], at[ends]))

    absolute = _nees_of_poses(pair, covariances.poses[at])
    ends = np.flatnonzero(np.diff(at) == 1) + 1  # the pose before has a truth, too
    step[ends] = of_motions(ends - 1, ends)
    travelled_m = pair.travelled_m
    ends = np.flatnonzero(travelled_m >= LENGTH_M)
    starts = np.searchsorted(travelled_m, travelled_m[ends] - LENGTH_M, side="right") - 1
    over_1m[ends] = of_motions(starts, ends)
    return Nees(pair.timestamps_ns, status, absolute, step, over_1m)


def consistency_of(truth: Trajectory, run: SavedRun) -> Nees | None:
    """Compute the NEES of a run; None if it has no covariances, or fewer than two poses."""
    try:
        return nees(truth, run)
    except TrajectoryError:
        return None


def mean_bounds(samples: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the interval of the mean of independent NEES if the covariances are correct."""
    tails = [(1 - confidence) / 2, (1 + confidence) / 2]
    low, high = chi2.ppf(tails, DEGREES * samples) / samples
    return float(low), float(high)


def calibration(values: Array, levels: Array) -> Array:
    """Return the fraction (K,) of (N,) NEES inside the ellipsoids of (K,) probabilities.

    NaN is ignored.
    """
    known = np.sort(values[np.isfinite(values)])
    inside = np.searchsorted(known, chi2.ppf(levels, DEGREES), side="right")
    return inside / len(known) if len(known) else np.full(len(levels), np.nan)


def normalized(errors: Array, covariances: Array) -> Array:
    """NEES (N,) of tangents (N, 6) with covariances (N, 6, 6); NaN where those are singular."""
    values = np.full(len(errors), np.nan)
    for i, (e, P) in enumerate(zip(errors, covariances, strict=True)):
        scale = np.sqrt(np.maximum(np.diag(P), 0.0))
        if not (np.isfinite(P).all() and (scale > 0).all()):
            continue
        variances, axes = np.linalg.eigh(P / np.outer(scale, scale))
        if variances[0] > MIN_EIGENVALUE_RATIO * variances[-1]:
            values[i] = np.sum((axes.T @ (e / scale)) ** 2 / variances)
    return values


def summarize(runs: Sequence[Nees]) -> list[Summary]:
    """Summarise runs: all frames first, then each status that has a step."""
    statuses = [x for run in runs for x in run.status]
    parts = {"all": [True] * len(statuses)}
    parts |= {status.value: [x is status for x in statuses] for status in Status}
    values = [
        np.concatenate([np.zeros(0), *(getattr(run, kind) for run in runs)])
        for kind in ("step", "over_1m", "absolute")
    ]
    level = np.array([CONFIDENCE])
    found: list[Summary] = []
    for name, rows in parts.items():
        step, over_1m, absolute = (x[np.array(rows, dtype=bool) & np.isfinite(x)] for x in values)
        if len(step):
            found.append(
                Summary(
                    name,
                    len(step),
                    float(step.mean()),
                    mean_bounds(len(step)),
                    float(calibration(step, level)[0]),
                    float(over_1m.mean()) if len(over_1m) else np.nan,
                    float(calibration(over_1m, level)[0]),
                    float(absolute.mean()) if len(absolute) else np.nan,
                    mean_bounds(len(runs)),
                )
            )
    return found


def _nees_of_poses(pair: Pair, covariances: Array) -> Array:
    """Return the NEES (N,) of poses, with covariances (N, 6, 6), since the first of them."""
    every = np.arange(len(covariances))
    T_cam_first = se3.inverse(pair.T_odom_cam) @ pair.T_odom_cam[0]
    growth = [
        P - se3.transform_covariance(T, covariances[0])
        for T, P in zip(T_cam_first, covariances, strict=True)
    ]
    errors = se3.log(pair.motion_errors(np.zeros_like(every), every))
    return normalized(errors, np.array(growth))
