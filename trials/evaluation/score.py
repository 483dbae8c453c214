"""Score of one run: all metrics of the tables."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from trials.evaluation import metrics
from trials.evaluation.alignment import Alignment, associate, gaps
from trials.evaluation.consistency import consistency_of
from trials.evaluation.disparity_errors import LARGE_PX, DisparityErrors
from trials.evaluation.display import html_display, import_pandas, text_display
from trials.evaluation.runs import SavedRun
from vo.contract.arrays import Array
from vo.contract.errors import TrajectoryError
from vo.contract.estimator import Status
from vo.contract.trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class ErrorSummary:
    """Root mean square, median and maximum of errors, in their unit."""

    rmse: float
    median: float
    max: float

    @staticmethod
    def of(errors: Array) -> "ErrorSummary":
        """Summarise (N,) errors, N >= 1."""
        rmse = np.sqrt(np.mean(np.square(errors)))
        return ErrorSummary(float(rmse), float(np.median(errors)), float(np.max(errors)))


@dataclass(frozen=True)
class SegmentDrift:
    """Drift over all segments of one length of the true path: errors divided by that length."""

    length_m: float
    segments: int
    mean_percent: float
    median_percent: float
    mean_deg_per_m: float

    @staticmethod
    def of(length_m: float, errors: metrics.RelativeErrors) -> "SegmentDrift":
        """Summarise the errors of at least one segment."""
        mean, median = float(np.mean(errors.percent)), float(np.median(errors.percent))
        turn = float(np.mean(errors.deg_per_m))
        return SegmentDrift(length_m, len(errors), mean, median, turn)


@dataclass(frozen=True, repr=False)
class Score:
    """Score of one estimator on one sequence.

    With a truth of positions only, the figures that need attitude are None: all but those of
    ATE after a fit.

    Attributes:
        frames: Number of frames of the sequence.
        statuses: Status to number of frames; empty without frames.csv, where a frame without a pose
            may be one that the estimator never claimed.
        compared: Number of poses with a truth.
        has_attitude: Whether the truth has rotations.
        path_m: Length of the true path between the first and the last of them; long gaps in the
            truth are left out, and no motion across them is compared.
        drift_1m: Drift over 1 m; None if the path is shorter.
        segments: Drift by segment length; the lengths depend on the path.
        kitti_percent: Mean translation error over all segments, with equal weight.
        kitti_deg_per_m: The same for rotation.
        end_m: Position error of the last pose, first pose aligned.
        end_percent: The same in % of the path; None without a path, or with gaps in it.
        ate_m: Alignment to the summary of position errors, metres.
        rpe_frame_m: Translation error of the motion between successive poses, metres.
        rpe_1m_m: The same over 1 m of path; rotation errors likewise.
        nees_step: Mean NEES of steps between successive poses; 6 if their covariances are correct.
            None without covariances.
        nees_1m: The same of motions over 1 m.
        frame_ms: Median wall time of the estimator per frame, ms, which excludes compilation.
        stage_ms: Stage to its mean time per frame, over all frames.
        disparity: Errors of the inliers' disparities; None unless the dataset has labels of depth
            and the run its tracks.

    Example:
        >>> score = dy.score(ds, run)
        >>> score.drift_pct == score.drift_1m.mean_percent
        True
        >>> score.ate_m["se3"].rmse < 0.05
        True
        >>> sorted(score.to_dict())[:3]
        ['ate_m', 'compared', 'disparity']
    """

    estimator: str
    frames: int
    statuses: Mapping[str, int]
    compared: int
    has_attitude: bool
    path_m: float
    drift_1m: SegmentDrift | None
    segments: tuple[SegmentDrift, ...]
    kitti_percent: float | None
    kitti_deg_per_m: float | None
    end_m: float | None
    end_percent: float | None
    ate_m: Mapping[str, ErrorSummary]
    rpe_frame_m: ErrorSummary | None
    rpe_frame_deg: ErrorSummary | None
    rpe_1m_m: ErrorSummary | None
    rpe_1m_deg: ErrorSummary | None
    nees_step: float | None
    nees_1m: float | None
    frame_ms: float | None
    stage_ms: Mapping[str, float]
    disparity: DisparityErrors | None = None

    @property
    def drift_pct(self) -> float | None:
        """Mean translation drift over 1 m of path, %; None if the path is shorter."""
        return self.drift_1m.mean_percent if self.drift_1m else None

    def to_dict(self) -> dict[str, Any]:
        """Return all figures by name, ready for JSON or a row of a `pandas.DataFrame`."""
        return asdict(self)

    def table(self) -> "pd.DataFrame":
        """Return all figures as a row of a pandas.DataFrame; names are joined by dots.

        `pandas.concat` joins those of several scores.

        Raises:
            DriftyardError: If pandas is not installed.

        Example:
            >>> dy.score(ds, run).table()[["estimator", "frames", "drift_1m.mean_percent"]].shape
            (1, 3)
        """
        return import_pandas().json_normalize(self.to_dict())

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Label with unit, and value as text or "–" where there is none, of every figure."""
        figures = FIGURES | (DISPARITY_FIGURES if self.disparity else {})
        values = [(label, figure(self), digits) for label, (figure, digits) in figures.items()]
        return [(label, "–" if x is None else f"{x:.{n}f}") for label, x, n in values]

    def __repr__(self) -> str:
        return text_display(f"Score of {self.estimator}", self.rows)

    def _repr_html_(self) -> str:
        return html_display(f"Score of {self.estimator}", self.rows)


def _ate_m(score: Score, alignment: Alignment) -> float | None:
    errors = score.ate_m.get(alignment.value)
    return errors.rmse if errors else None


FIGURES: dict[str, tuple[Callable[[Score], float | None], int]] = {
    "drift over 1 m, mean, %": (lambda x: x.drift_pct, 3),
    "drift over 1 m, median, %": (lambda x: x.drift_1m.median_percent if x.drift_1m else None, 3),
    "rotation over 1 m, °/m": (lambda x: x.drift_1m.mean_deg_per_m if x.drift_1m else None, 4),
    "end point, m": (lambda x: x.end_m, 3),
    "end point, % of path": (lambda x: x.end_percent, 2),
    "ATE, first pose, m": (lambda x: _ate_m(x, Alignment.FIRST_POSE), 4),
    "ATE, SE(3), m": (lambda x: _ate_m(x, Alignment.SE3), 4),
    "ATE, Sim(3), m": (lambda x: _ate_m(x, Alignment.SIM3), 4),
    "NEES of steps, expected 6": (lambda x: x.nees_step, 1),
    "NEES over 1 m, expected 6": (lambda x: x.nees_1m, 1),
    "path, m": (lambda x: x.path_m, 2),
    "frames": (lambda x: x.frames, 0),
    "frames compared": (lambda x: x.compared, 0),
    "weak": (lambda x: x.statuses.get("weak"), 0),
    "lost": (lambda x: x.statuses.get("lost"), 0),
    "ms per frame, median": (lambda x: x.frame_ms, 1),
}
"""Rows of the table of errors, each a figure and its digits."""

DISPARITY_FIGURES: dict[str, tuple[Callable[[Score], float | None], int]] = {
    "disparity of inliers, median error, px": (
        lambda x: x.disparity.median_px if x.disparity else None, 3),
    "disparity of inliers, sigma, px": (
        lambda x: x.disparity.sigma_px if x.disparity else None, 3),
    f"disparity of inliers, above {LARGE_PX} px, %": (
        lambda x: x.disparity.large_percent if x.disparity else None, 1),
}  # fmt: skip
"""Further rows where the dataset has labels of depth."""


def score_run(truth: Trajectory, run: SavedRun, frames: int) -> Score:
    """Compare a run, in any fixed frame, with the true T_world_cam of a sequence of `frames`.

    Raises:
        TrajectoryError: If the two share fewer than two times.
    """
    try:
        pair = associate(truth, run.trajectory)
    except TrajectoryError as error:
        raise TrajectoryError(f"{run.path}: {error}") from None
    parts, table = pair.split(gaps(truth)), run.frames
    paths_m = [float(part.travelled_m[-1]) for part in parts]
    path_m = sum(paths_m)

    def over(length_m: float) -> metrics.RelativeErrors:
        return metrics.joined([metrics.errors_over_distance(part, length_m) for part in parts])

    lengths_m = metrics.segment_lengths_m(max(paths_m)) if pair.has_attitude else ()
    segments = {x: over(x) for x in lengths_m}
    over_1m, over_frame = over(1.0), metrics.joined([metrics.errors_over_time(x) for x in parts])
    has_1m, has_attitude = pair.has_attitude and len(over_1m) > 0, pair.has_attitude
    has_path = path_m > 0 and len(parts) == 1
    ate_m: dict[str, ErrorSummary] = {}
    for alignment in Alignment if has_attitude else (Alignment.SE3, Alignment.SIM3):
        try:
            ate_m[alignment.value] = ErrorSummary.of(metrics.position_errors(pair, alignment))
        except TrajectoryError:  # the scale of an estimate without motion is undefined
            continue
    end_m = float(metrics.position_errors(pair, Alignment.FIRST_POSE)[-1]) if has_attitude else None
    consistency = consistency_of(truth, run) if has_attitude else None
    return Score(
        estimator=run.estimator,
        frames=frames,
        statuses=_statuses(run),
        compared=len(pair.timestamps_ns),
        has_attitude=has_attitude,
        path_m=path_m,
        drift_1m=SegmentDrift.of(1.0, over_1m) if has_1m else None,
        segments=tuple(SegmentDrift.of(x, errors) for x, errors in segments.items()),
        kitti_percent=_pooled_mean([x.percent for x in segments.values()]),
        kitti_deg_per_m=_pooled_mean([x.deg_per_m for x in segments.values()]),
        end_m=end_m,
        end_percent=100 * end_m / path_m if end_m is not None and has_path else None,
        ate_m=ate_m,
        rpe_frame_m=ErrorSummary.of(over_frame.translation_m) if has_attitude else None,
        rpe_frame_deg=_degrees(over_frame) if has_attitude else None,
        rpe_1m_m=ErrorSummary.of(over_1m.translation_m) if has_1m else None,
        rpe_1m_deg=_degrees(over_1m) if has_1m else None,
        nees_step=_mean(consistency.step) if consistency else None,
        nees_1m=_mean(consistency.over_1m) if consistency else None,
        frame_ms=float(np.median(table.frame_ms)) if table else None,
        stage_ms={x: float(np.nansum(ms)) / len(table) for x, ms in table.timings_ms.items()}
        if table
        else {},
    )


def _mean(values: Array) -> float | None:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else None


def _degrees(errors: metrics.RelativeErrors) -> ErrorSummary:
    return ErrorSummary.of(np.degrees(errors.rotation_rad))


def _statuses(run: SavedRun) -> dict[str, int]:
    if run.frames is None:
        return {}
    seen = Counter(run.frames.status)
    return {status.value: seen[status] for status in Status}


def _pooled_mean(errors: Sequence[Array]) -> float | None:
    return float(np.mean(np.concatenate(errors))) if errors else None
