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
from trials.evaluation.runs import SavedRun
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import TrajectoryError
from vo.contract.estimator import Status
from vo.contract.trajectory import Trajectory
from vo.runner import companion

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

    An estimator gives covariances of steps and of poses. The covariance of a longer motion is the
    increase of that of the pose, which assumes that later errors are independent.
    """

    timestamps_ns: Indices
    status: tuple[Status, ...]
    absolute: Array
    step: Array
    over_1m: Array

    def with_status(self, status: Status) -> "Nees":
        """Keep the times with one status."""
        keep = np.array([x is status for x in self.status], dtype=bool)
        kept = tuple(x for x in self.status if x is status)
        columns = (self.absolute[keep], self.step[keep], self.over_1m[keep])
        return Nees(self.timestamps_ns[keep], kept, *columns)


def nees(truth: Trajectory, run: SavedRun) -> Nees:
    """Compute the NEES of a run.

    Args:
        truth: T_world_cam.
        run: With `<stem>.covariance.npz` beside it.

    Raises:
        TrajectoryError: If there are no covariances, or fewer than two times are shared.
    """
    path = companion(run.path, "covariance.npz")
    if not path.is_file():
        raise TrajectoryError(f"{run.path}: the estimator gave no covariances ({path.name})")
    pair = associate(truth, run.trajectory)
    with np.load(path) as file:
        times, poses, steps = file["timestamp_ns"], file["pose"], file["step"]
    known = np.isin(pair.timestamps_ns, times)
    if not known.all():
        raise TrajectoryError(f"{path}: lacks frame {pair.timestamps_ns[~known][0]} ns")
    rows = np.searchsorted(times, pair.timestamps_ns)
    return Nees(
        pair.timestamps_ns,
        _statuses(run, pair.timestamps_ns),
        _nees_of_motions(
            pair, poses[rows], np.zeros(len(rows), dtype=np.int64), np.arange(len(rows))
        ),
        _steps(
            pair, steps[rows], np.searchsorted(run.trajectory.timestamps_ns, pair.timestamps_ns)
        ),
        _over_length(pair, poses[rows]),
    )


def mean_bounds(samples: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the interval of the mean of independent NEES if the covariances are correct."""
    tails = [(1 - confidence) / 2, (1 + confidence) / 2]
    low, high = chi2.ppf(tails, DEGREES * samples) / samples
    return float(low), float(high)


def calibration(values: Array, levels: Array) -> Array:
    """Return the fraction (K,) of errors inside the ellipsoids of probabilities `levels`.

    Args:
        values: (N,) NEES; NaN is ignored.
        levels: (K,) probabilities.
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


def _steps(pair: Pair, covariances: Array, rows: Indices) -> Array:
    """Return the NEES (N,) of steps; the previous pose must have a truth too."""
    values = np.full(len(covariances), np.nan)
    ends = np.flatnonzero(np.diff(rows) == 1) + 1
    values[ends] = normalized(_motion_errors(pair, ends - 1, ends), covariances[ends])
    return values


def _over_length(pair: Pair, covariances: Array) -> Array:
    values = np.full(len(covariances), np.nan)
    travelled_m = pair.travelled_m
    ends = np.flatnonzero(travelled_m >= LENGTH_M)
    starts = np.searchsorted(travelled_m, travelled_m[ends] - LENGTH_M, side="right") - 1
    values[ends] = _nees_of_motions(pair, covariances, starts, ends)
    return values


def _nees_of_motions(pair: Pair, covariances: Array, starts: Indices, ends: Indices) -> Array:
    """Return the NEES (K,) of motions, with the increase of the pose's covariance."""
    T_end_start = se3.inverse(pair.T_odom_cam[ends]) @ pair.T_odom_cam[starts]
    growth = [
        covariances[end] - se3.transform_covariance(T, covariances[start])
        for T, start, end in zip(T_end_start, starts, ends, strict=True)
    ]
    return normalized(_motion_errors(pair, starts, ends), np.array(growth).reshape(-1, 6, 6))


def _motion_errors(pair: Pair, starts: Indices, ends: Indices) -> Array:
    true, estimated = (
        se3.inverse(T[starts]) @ T[ends] for T in (pair.T_world_cam, pair.T_odom_cam)
    )
    return se3.log(se3.inverse(true) @ estimated)


def _statuses(run: SavedRun, timestamps_ns: Indices) -> tuple[Status, ...]:
    if run.frames is None:
        return (Status.TRACKED,) * len(timestamps_ns)
    status = dict(zip(run.frames.timestamps_ns.tolist(), run.frames.status, strict=True))
    return tuple(status[x] for x in timestamps_ns.tolist())


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


def summarize(runs: Sequence[Nees]) -> list[Summary]:
    """Summarise runs: all frames first, then each status that has a step."""
    parts = {"all": runs, **{x.value: [run.with_status(x) for run in runs] for x in Status}}
    return [found for name, some in parts.items() if (found := _summary(name, some))]


def _summary(name: str, runs: Sequence[Nees]) -> Summary | None:
    step, over_1m, absolute = (
        np.concatenate([np.zeros(0), *(getattr(run, kind) for run in runs)])
        for kind in ("step", "over_1m", "absolute")
    )
    step, over_1m, absolute = (x[np.isfinite(x)] for x in (step, over_1m, absolute))
    if len(step) == 0:
        return None
    level = np.array([CONFIDENCE])
    return Summary(
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
