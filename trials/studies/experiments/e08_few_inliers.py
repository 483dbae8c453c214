"""E8: the pose is lost with few inliers after a blurred, fast turn (thesis 5.1.1, fig. 5.1)."""

import numpy as np
from matplotlib.figure import Figure

from trials.execution.jobs import Recording, Result, Results, Variant
from trials.report.figure import BLUE, OCHRE, RED, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import (
    FAILURE_M,
    draw_turn_rate,
    failures,
    step_errors_m,
    turn_rate_deg_s,
)
from trials.studies.experiments.variants import DEFAULT, THESIS
from vo.contract.arrays import Array, Mask

SHUTTERS_MS = (2.0, 18.0, 30.0)
BINS = ((0, 10), (10, 25), (25, 50), (50, 100), (100, 10_000))
"""Bins of the number of inliers."""


def _shutter(time_ms: float) -> str:
    return f"exposure.time_ms={time_ms:g}"


def _conclude(results: Results) -> Finding:
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


def _table(results: Results) -> Rows:
    inliers, failed = _pooled(results)
    for low, high in BINS:
        mine = failed[(inliers >= low) & (inliers < high)]
        yield {
            "inliers": f"{low} and more" if high == BINS[-1][1] else f"{low} to {high - 1}",
            "frames": str(len(mine)),
            "failed": str(mine.sum()),
            "ratio, %": f"{100 * mine.mean():.1f}" if len(mine) else "–",
        }


def _data(results: Results) -> Data:
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


def _draw(figure: Figure, results: Results) -> None:
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
    inliers, _, errors_m = _data(results)["frames"].values()
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
        Recording("turntable", seed, (*scale.drive, _shutter(ms)))
        for ms in SHUTTERS_MS
        for seed in scale.seeds
    ],
    variants=(THESIS, DEFAULT),
    steps=Steps(_conclude, _table, _draw, _data),
)
