"""V1: whether simulated twins order estimators as real recordings do, and predict their drift."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy import stats

from trials.evaluation.intervals import CONFIDENCE, RESAMPLES, Interval, ratio_interval
from trials.evaluation.runs import read_run
from trials.evaluation.score import score_run
from trials.evaluation.truth import true_trajectory
from trials.execution.cache import CACHE
from trials.execution.jobs import Variant
from trials.execution.runner import cached_run, record_all
from trials.realism.matching import match_camera
from trials.realism.twins import twin_recording
from trials.studies.experiments.base import Verdict
from trials.studies.experiments.variants import DEFAULT, THESIS, UNREFINED
from vo.contract.arrays import Array
from vo.contract.errors import DatasetError, TrajectoryError
from vo.recordings.pairing import FrameSelection
from vo.recordings.readers import open_sequence

FRAMES = 50
VARIANTS = (
    DEFAULT,
    THESIS,
    UNREFINED,
    Variant("corner_flow", "corner_flow"),
    Variant("default, no refinement", "driftyard", ("refinement.mode=none",)),
    Variant(
        "default, no alignment", "driftyard", ("matching.align=false", "matching.guided=false")
    ),
    Variant("default, 100 features", "driftyard", ("features.count=100",)),
    Variant("default, Harris corners", "driftyard", ("features.detector=harris",)),
)
"""Estimators that are compared: those at hand, and the default with single stages worsened."""
WANTED_FACTOR = 2.0
"""Factor within which 95 % of the drifts are to be predicted."""
MIN_RECORDINGS = 5
"""Smallest number of recordings from which a general verdict would be drawn."""
Tell = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Twinned:
    """Drifts of the variants on a recording and on its simulated twins, % of the path.

    Attributes:
        name: Of the recording.
        scene: Of the twins.
        frames: Number of frames of the recording.
        path_m: Length of its true path.
        real: (V,) drifts; NaN where a run fails.
        twins: (S, V) drifts on the twins of S seeds.
    """

    name: str
    scene: str
    frames: int
    path_m: float
    real: Array
    twins: Array

    @property
    def predicted(self) -> Array:
        """(V,) geometric means over twins, of the runs that did not fail."""
        with np.errstate(invalid="ignore"):
            logs = np.log(self.twins)
        known = np.isfinite(logs)
        total = np.where(known, logs, 0).sum(axis=0)
        return np.where(known.any(axis=0), np.exp(total / np.maximum(known.sum(axis=0), 1)), np.nan)

    @property
    def ratio(self) -> Interval:
        """Drift on twins over that on the recording: geometric mean over variants."""
        return ratio_interval(self.predicted, self.real)


@dataclass(frozen=True)
class Validity:
    """The study: recordings with their twins, and the variants."""

    recordings: Sequence[Twinned]
    variants: Sequence[Variant] = VARIANTS

    def correlation(self, of: Sequence[Twinned], kind: Callable[[Array, Array], Array]) -> Interval:
        """Return the mean rank correlation of recordings, with a bootstrap over variants."""
        count = len(self.variants)
        drawn = np.random.default_rng(0).integers(count, size=(RESAMPLES, count))
        rows = np.vstack([np.arange(count), drawn])
        pairs = ([_ranked(y)[rows] for y in (x.real, x.predicted)] for x in of)
        found = np.mean([kind(*pair) for pair in pairs], axis=0)
        tail = (1 - CONFIDENCE) / 2
        low, high = np.nanquantile(found[1:], [tail, 1 - tail])
        return Interval(float(found[0]), float(low), float(high))

    @property
    def factor(self) -> float:
        """Factor within which the twins predict 95 % of the drifts."""
        ratios = np.concatenate([x.predicted / x.real for x in self.recordings])
        return float(np.exp(np.nanquantile(abs(np.log(ratios)), CONFIDENCE)))

    @property
    def finding(self) -> tuple[Verdict, str]:
        """Verdict and reasons."""
        tau = self.correlation(self.recordings, kendall)
        rho = self.correlation(self.recordings, spearman)
        number = len(self.recordings)
        several = "s" * (number != 1)
        text = (
            f"Kendall's rank correlation of real and simulated drifts is {tau.text(2)}, Spearman's "
            f"{rho.text(2)} (mean over {number} recording{several}, 95 % bootstrap over "
            f"{len(self.variants)} variants). The twins predict 95 % of the drifts within a factor "
            f"of {self.factor:.1f}."
        )
        if self.factor >= WANTED_FACTOR:
            text += " They do not predict its size."
        if number < MIN_RECORDINGS:
            text += (
                f" {number} recording{several} cannot carry a general verdict: the "
                "intervals hold variants, not places, cameras or carriers."
            )
            if tau.low <= 0:
                return Verdict.OPEN, text
        return Verdict.of(tau.low > 0, tau.low > 0.5 and self.factor < WANTED_FACTOR), text


def validate(
    real: Sequence[Path],
    scenes: str = "all",
    seeds: int = 2,
    progress: Tell | None = None,
    cache: Path = CACHE,
) -> Validity:
    """Match each recording, record its twins, and run all variants over both.

    Progress is called with the recording and what is done on it, the number of steps that are done,
    and that of all. What the cache has of an earlier run, complete or not, is not done again.

    Raises:
        DriftyardError: If a recording is unreadable, has no truth, or stands still.
    """
    for folder in real:
        _check_moves(folder)
    tell = progress or (lambda *_: None)
    return Validity([_twinned(x, scenes, seeds, tell, cache) for x in real])


def _check_moves(folder: Path) -> None:
    truth = true_trajectory(folder)
    path_m = np.linalg.norm(np.diff(truth.T_ref_frame[:, :3, 3], axis=0), axis=1).sum()
    extent_m = np.ptp(truth.T_ref_frame[:, :3, 3], axis=0).max()
    if extent_m < 0.1:
        raise DatasetError(
            f"{folder}: stands still (extent {extent_m:.3f} m, path {path_m:.3f} m): there is no "
            "drift to compare"
        )


def _twinned(folder: Path, scenes: str, seeds: int, tell: Tell, cache: Path) -> Twinned:
    count = min(FRAMES, len(open_sequence(folder)))
    matching = partial(tell, f"{folder.name}, match")
    found = match_camera(folder, None, scenes, count, matching, cache)
    assert found.comparison is not None  # scenes are given
    assert found.place is not None
    real = found.comparison.real
    layouts = [*found.seeds, *range(len(found.seeds), seeds)][:seeds]
    twins = [twin_recording(found.values, found.place, count, real, k) for k in layouts]
    rows: list[list[float]] = []
    path_m = 0.0
    total = len(VARIANTS) * (1 + len(twins))
    for k, dataset in enumerate((folder, *record_all(twins, cache))):
        frames = FrameSelection(last=min(count, len(open_sequence(dataset))) - 1)
        rows.append([])
        for variant in VARIANTS:
            drift, length = _drift(dataset, variant, frames, cache)
            rows[-1].append(drift)
            tell(f"{folder.name}, runs", sum(map(len, rows)), total)
            path_m = path_m if k else max(path_m, length)
    drifts = np.array(rows)
    return Twinned(folder.name, found.place.label, count, path_m, drifts[0], drifts[1:])


def _drift(
    dataset: Path, variant: Variant, frames: FrameSelection, cache: Path
) -> tuple[float, float]:
    """Return the position error after a fit over the path length, %, and the latter, m."""
    run = read_run(cached_run(dataset, variant, cache, frames))
    try:
        score = score_run(true_trajectory(dataset), run, len(open_sequence(dataset, frames)))
    except TrajectoryError:
        return np.nan, 0.0
    return 100 * score.ate_m["se3"].rmse / score.path_m, score.path_m


def _ranked(drifts: Array) -> Array:
    """Return the ranks of drifts (V,); failures are last."""
    return stats.rankdata(np.where(np.isfinite(drifts), drifts, np.inf))


def kendall(first: Array, second: Array) -> Array:
    """Return Kendall's rank correlation tau-b (R,) of rows (R, V); NaN for rows of one value."""
    signs = [np.sign(x[:, :, None] - x[:, None, :]) for x in (first, second)]
    return _cosine(*(x.reshape(len(x), -1) for x in signs))


def spearman(first: Array, second: Array) -> Array:
    """Return Spearman's rank correlation (R,) of rows (R, V); NaN for rows of one value."""
    ranks = (stats.rankdata(x, axis=1) for x in (first, second))
    return _cosine(*(x - x.mean(axis=1, keepdims=True) for x in ranks))


def _cosine(first: Array, second: Array) -> Array:
    size = np.linalg.norm(first, axis=1) * np.linalg.norm(second, axis=1)
    product = (first * second).sum(axis=1)
    return np.divide(product, size, out=np.full(len(size), np.nan), where=size > 0)


def table(found: Validity) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return header and rows: each variant, and its drifts on recordings and twins."""
    header = ["estimator"]
    columns: list[list[str]] = [[x.label for x in found.variants]]
    for x in found.recordings:
        header += [f"{x.name}, %", f"twins ({x.scene}), %", "ratio"]
        ratio = x.predicted / x.real
        columns += [[_text(v) for v in values] for values in (x.real, x.predicted, ratio)]
    return tuple(header), list(zip(*columns, strict=True))


def summary(found: Validity) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return header and rows: each recording, its correlation and ratio."""
    header = ("recording", "frames", "path, m", "twin", "Kendall", "Spearman", "drift ratio")
    rows: list[tuple[str, ...]] = [
        (
            *(x.name, str(x.frames), f"{x.path_m:.1f}", x.scene),
            found.correlation([x], kendall).text(2),
            found.correlation([x], spearman).text(2),
            x.ratio.text(2),
        )
        for x in found.recordings
    ]
    return header, rows


def _text(value: float) -> str:
    if not np.isfinite(value):
        return "–"
    return f"{value:#.2g}" if value < 1 else f"{value:.2f}"


def results(found: Validity) -> Mapping[str, object]:
    """Return everything as JSON takes it."""
    verdict, text = found.finding
    return {
        "verdict": verdict.value,
        "sentence": text,
        "variants": [x.label for x in found.variants],
        "recordings": [
            {
                "name": x.name,
                "scene": x.scene,
                "frames": x.frames,
                "path_m": x.path_m,
                "real_percent": [None if np.isnan(v) else v for v in x.real.tolist()],
                "twin_percent": [
                    [None if np.isnan(v) else v for v in row] for row in x.twins.tolist()
                ],
            }
            for x in found.recordings
        ],
    }
