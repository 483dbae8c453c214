"""E5 and E8: blurred, fast turns: reprojection errors and few inliers (thesis 4.3 and 5.1.1)."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from matplotlib.figure import Figure

from trials.evaluation.intervals import mean_interval
from trials.evaluation.runs import read_map
from trials.execution.jobs import Result, Results, Variant
from trials.report.figure import BLUE, OCHRE, RED, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import (
    FAILURE_M,
    draw_turn_rate,
    failures,
    step_errors_m,
    turn_rate_deg_s,
)
from trials.studies.experiments.variants import DEFAULT, THESIS, UNREFINED
from vo.bundle_adjustment.adjust import refine_motion
from vo.config import THESIS as PRESET
from vo.contract import se3
from vo.contract.arrays import Array, Mask
from vo.recordings.readers import open_sequence
from vo.runner import companion

PEAK = 2.0
"""Ratio to the median above which an error is a peak."""
FAST_DEG_S = 60.0
MIN_POINTS = 6
"""Number of points that a frame must observe."""


@dataclass(frozen=True)
class Reprojection:
    """Mean reprojection error of every frame, pixels; NaN with fewer than MIN_POINTS.

    Attributes:
        before: (N,) with the poses of RANSAC.
        after: (N,) with poses refined on the same, fixed points.
        turn_deg_s: (N,) true turn rate of the camera.
    """

    before: Array
    after: Array
    turn_deg_s: Array

    @property
    def peaks(self) -> Mask:
        """(N,) frames whose error before is above PEAK times the median."""
        return self.before > PEAK * np.nanmedian(self.before)


def _by_seed(results: Results) -> dict[int, Reprojection]:
    return {r.seed: _reprojection(results.at(r, UNREFINED)) for r in results.recordings}


@cache
def _reprojection(result: Result) -> Reprojection:
    """Refine every pose of an unrefined run on the points of its map."""
    rig = open_sequence(result.dataset).rig
    points, tracks = read_map(companion(result.file, "map.ply")), result.tracks
    order = np.argsort(points.ids)
    row = np.searchsorted(points.ids[order], tracks.landmark).clip(max=len(order) - 1)
    known = tracks.inlier & (points.ids[order][row] == tracks.landmark)
    trajectory = result.run.trajectory
    poses = dict(zip(trajectory.timestamps_ns.tolist(), trajectory.T_ref_frame, strict=True))
    before, after = np.full((2, len(result.frames)), np.nan)
    for i, time_ns in enumerate(result.frames.timestamps_ns.tolist()):
        mine = known & (tracks.frame == i)
        if time_ns not in poses or mine.sum() < MIN_POINTS:
            continue
        seen = points.points_odom[order][row[mine]]
        measured = np.column_stack([tracks.pixels[mine], tracks.disparity_px[mine]])
        sigma = np.full(measured.shape, PRESET.refinement.sigma_px)
        refined = refine_motion(poses[time_ns], seen, measured, sigma, rig, PRESET.refinement)
        for errors, T in ((before, poses[time_ns]), (after, refined.T_world_cam)):
            pixels = rig.project(se3.transform(se3.inverse(T), seen))[:, :2]
            errors[i] = np.mean(np.linalg.norm(pixels - tracks.pixels[mine], axis=1))
    return Reprojection(before, after, turn_rate_deg_s(result))


def _conclude_errors(results: Results) -> Finding:
    before, after, turn_deg_s, peaks = (
        np.concatenate([getattr(x, name) for x in _by_seed(results).values()])
        for name in ("before", "after", "turn_deg_s", "peaks")
    )
    if not peaks.any():
        return Verdict.FAILS, _without_peaks(before, after, turn_deg_s > FAST_DEG_S)
    removed = after[peaks] < PEAK * np.nanmedian(after[~peaks])
    gain = mean_interval(before[peaks] / after[peaks])
    return Verdict.of(gain.value > 1, removed.mean() > 0.5), (
        f"Of {len(removed)} frames whose error is more than {PEAK:g} times the median, refinement "
        f"of the motion alone brings {100 * removed.mean():.0f} % below that limit; it divides "
        f"their error by {gain.text(1)}. It cannot correct the matches, which have errors on a "
        "blurred frame."
    )


def _without_peaks(before: Array, after: Array, fast: Mask) -> str:
    return (
        "There is no peak: the threshold of RANSAC limits the errors of inliers, and of "
        f"{fast.sum()} frames that turn by more than {FAST_DEG_S:g} °/s "
        f"{np.isnan(before[fast]).sum()} have too few landmarks. In all other frames refinement "
        "of the motion lowers the error of the inliers, "
        f"from {np.nanmean(before):.2f} to {np.nanmean(after):.2f} px."
    )


def _errors_table(results: Results) -> Rows:
    def mean_px(errors: Array) -> str:
        return f"{np.nanmean(errors):.2f}" if len(errors) else "–"

    for seed, x in _by_seed(results).items():
        rate = f"{np.median(x.turn_deg_s[x.peaks]):.0f}" if x.peaks.any() else "–"
        yield {
            "seed": str(seed),
            "peaks, frames": str(x.peaks.sum()),
            "elsewhere before, px": mean_px(x.before[~x.peaks]),
            "elsewhere after, px": mean_px(x.after[~x.peaks]),
            "peaks before, px": mean_px(x.before[x.peaks]),
            "peaks after, px": mean_px(x.after[x.peaks]),
            "turn rate at peaks, °/s": rate,
        }


def _errors_data(results: Results) -> Data:
    return {
        f"seed {k}": {"before, px": x.before, "after, px": x.after, "turn rate, °/s": x.turn_deg_s}
        for k, x in _by_seed(results).items()
    }


def _draw_errors(figure: Figure, results: Results) -> None:
    found = _by_seed(results)
    seed, shown = max(found.items(), key=lambda item: np.nanmax(item[1].before, initial=0))
    panel = figure.subplots()
    top_deg_s = 2.5 * max(shown.turn_deg_s.max(), 1)
    draw_turn_rate(panel, np.arange(len(shown.turn_deg_s)), shown.turn_deg_s, top_deg_s)
    panel.plot(shown.before, color=BLUE, lw=1.0, label="before refinement of the pose")
    panel.plot(shown.after, color=RED, lw=1.0, label="after")
    panel.set_ylim(bottom=0)
    panel.legend(loc="lower right")
    tidy(panel, "frame", "mean reprojection error, px", f"turntable, seed {seed}")


E5 = Experiment(
    id="E5",
    title="Reprojection error before and after motion refinement",
    claim="Motion refinement removes a peak of the reprojection error at a blurred, fast turn.",
    source="section 4.3, figure 4.4",
    setup="The thesis preset without refinement on turntable (turns of up to 120 °/s, shutter "
    "open for 18 ms); then every pose is refined on the points of its map, as in figure 4.4.",
    caption="Mean reprojection error of every frame before and after refinement of the motion on "
    "fixed points; grey: turn rate of the camera.",
    size_in=(9.0, 3.2),
    recordings=lambda scale: scale.recordings(["turntable"], 3),
    variants=(UNREFINED,),
    steps=Steps(_conclude_errors, _errors_table, _draw_errors, _errors_data),
)


SHUTTERS_MS = (2.0, 18.0, 30.0)
BINS = ((0, 10), (10, 25), (25, 50), (50, 100), (100, 10_000))
"""Bins of the number of inliers."""


def _shutter(time_ms: float) -> str:
    return f"exposure.time_ms={time_ms:g}"


def _conclude_inliers(results: Results) -> Finding:
    inliers, failed = _pooled(results)
    few, many = inliers < BINS[0][1], inliers >= BINS[-2][0]
    of_few = failed[few].mean() if few.any() else np.nan
    of_many = failed[many].mean() if many.any() else np.nan
    by_shutter = {
        ms: np.concatenate([failures(x) for x in _at(results, ms, THESIS)]).mean()
        for ms in SHUTTERS_MS
    }
    default = np.concatenate([failures(x) for x in results.of(DEFAULT)]).mean()
    decided = failed.any() and few.any()
    verdict = Verdict.of(True, of_few > 0.5 and of_few > 5 * of_many)
    return verdict if decided else Verdict.OPEN, (
        f"Of frames with fewer than {BINS[0][1]} inliers {100 * of_few:.0f} % are lost or have a "
        f"step error above 5 cm, of those with 50 and more {100 * of_many:.1f} %. By exposure "
        "time, "
        + ", ".join(f"{100 * x:.1f} % fail at {ms:g} ms" for ms, x in by_shutter.items())
        + f"; with the default settings, over all exposure times, {100 * default:.1f} %."
    )


def _inliers_table(results: Results) -> Rows:
    inliers, failed = _pooled(results)
    for low, high in BINS:
        mine = failed[(inliers >= low) & (inliers < high)]
        yield {
            "inliers": f"{low} and more" if high == BINS[-1][1] else f"{low} to {high - 1}",
            "frames": str(len(mine)),
            "failed": str(mine.sum()),
            "ratio, %": f"{100 * mine.mean():.1f}" if len(mine) else "–",
        }


def _inliers_data(results: Results) -> Data:
    inliers, failed = _pooled(results)
    errors_m = np.concatenate([step_errors_m(x)[1:] for x in results.of(THESIS)])
    return {"frames": {"inliers": inliers, "lost or wrong": failed, "step error, m": errors_m}}


def _pooled(results: Results) -> tuple[Array, Mask]:
    """Return inliers and failures of the thesis preset, without the first frame of each run."""
    runs = results.of(THESIS)
    inliers = np.concatenate([np.nan_to_num(x.frames.counts["inliers"])[1:] for x in runs])
    return inliers, np.concatenate([failures(x)[1:] for x in runs])


def _at(results: Results, shutter_ms: float, variant: Variant) -> list[Result]:
    return [x for x in results.of(variant) if _shutter(shutter_ms) in x.job.recording.overrides]


def _draw_inliers(figure: Figure, results: Results) -> None:
    top, bottom = figure.subplots(2, 1, height_ratios=(1.2, 1))
    run, default = (_at(results, SHUTTERS_MS[-1], v)[0] for v in (THESIS, DEFAULT))
    draw_turn_rate(top, run.time_s, turn_rate_deg_s(run), 300)
    for one, colour, label in ((run, RED, "thesis"), (default, OCHRE, "default")):
        counts = np.nan_to_num(one.frames.counts["inliers"])
        top.plot(one.time_s, counts, color=colour, lw=1.0, label=label)
    failed, counts = failures(run), np.nan_to_num(run.frames.counts["inliers"])
    top.plot(run.time_s[failed], counts[failed], "x", color=BLUE, ms=5, label="thesis fails")
    top.set_ylim(bottom=-8)
    top.legend(ncols=3, loc="upper left")
    name = f"turntable, seed {run.job.recording.seed}, {SHUTTERS_MS[-1]:g} ms"
    tidy(top, "time, s", "inliers", name)
    inliers, _, errors_m = _inliers_data(results)["frames"].values()
    bottom.plot(np.maximum(inliers, 1), 1e3 * errors_m, ".", color=RED, ms=3, alpha=0.6)
    bottom.axhline(1e3 * FAILURE_M, color=BLUE, ls="--", lw=0.9)
    bottom.set(xscale="log", yscale="log")
    bottom.xaxis.set_major_formatter("{x:g}")
    tidy(bottom, "inliers of a frame", "step error, mm", "all drives, thesis preset")


E8 = Experiment(
    id="E8",
    title="Few inliers after a blurred turn",
    claim="Where a blurred, fast turn leaves only a few inliers, the pose is lost.",
    source="section 5.1.1, figure 5.1",
    setup="The thesis preset, which continues with three inliers, and the default settings on "
    "turntable with exposure times of 2, 18 and 30 ms. A frame fails if it is lost or its step "
    "error exceeds 5 cm.",
    caption="Top: inliers of the thesis preset and of the default settings on the first drive with "
    "the longest exposure time; crosses mark frames in which the thesis preset fails; grey: turn "
    "rate of the camera. Bottom: step error over inliers, all drives; dashed: the "
    f"{100 * FAILURE_M:g} cm above which a frame fails.",
    size_in=(9.0, 5.6),
    recordings=lambda scale: [
        scale.recording("turntable", seed, (_shutter(ms),))
        for ms in SHUTTERS_MS
        for seed in scale.seeds
    ],
    variants=(THESIS, DEFAULT),
    steps=Steps(_conclude_inliers, _inliers_table, _draw_inliers, _inliers_data),
)
