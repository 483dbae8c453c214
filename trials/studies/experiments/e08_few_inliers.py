"""E8: few inliers after a blurred, fast turn lose the pose (thesis 5.1.1, fig. 5.1)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trials.execution.jobs import Job, Recording, Result, Results, Variant, jobs_of
from trials.report.figure import BLUE, GREY, OCHRE, RED, tidy
from trials.studies.experiments.experiment import (
    Experiment,
    Findings,
    Scale,
    TableOf,
    Verdict,
    ragged,
)
from trials.studies.experiments.measures import BROKEN_M, step_errors_m, turn_rate_deg_s
from trials.studies.experiments.variants import DEFAULT, THESIS
from vo.contract.estimator import Status

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHUTTERS_MS = (2.0, 18.0, 30.0)
BINS = ((0, 10), (10, 25), (25, 50), (50, 100), (100, 10_000))
"""Of the number of inliers."""


def jobs(scale: Scale) -> Sequence[Job]:
    """Fast turns with a shutter that is open shorter and longer."""
    recordings = [
        Recording("turntable", seed, (*scale.drive, f"exposure.time_ms={ms:g}"))
        for ms in SHUTTERS_MS
        for seed in scale.seeds
    ]
    return jobs_of(recordings, (THESIS, DEFAULT))


def wrong(run: Result) -> np.ndarray:
    """Which frames (N,) are lost, or have a step that is wrong beyond drift."""
    lost = np.array([status is Status.LOST for status in run.frames.status])
    with np.errstate(invalid="ignore"):
        return lost | (step_errors_m(run) > BROKEN_M)


def analyse(results: Results) -> Findings:
    """Relate wrong frames to the number of inliers, and both to the blur."""
    inliers, bad = _pooled(results, THESIS)
    rows: list[tuple[str, ...]] = []
    for low, high in BINS:
        mine = (inliers >= low) & (inliers < high)
        share = f"{100 * bad[mine].mean():.1f}" if mine.any() else "–"
        label = f"{low} and more" if high == BINS[-1][1] else f"{low} to {high - 1}"
        rows.append((label, str(int(mine.sum())), str(int(bad[mine].sum())), share))
    few, many = inliers < BINS[0][1], inliers >= BINS[-2][0]
    of_few = bad[few].mean() if few.any() else np.nan
    of_many = bad[many].mean() if many.any() else np.nan
    by_shutter = {
        ms: np.concatenate([wrong(x) for x in _at(results, ms, THESIS)]).mean()
        for ms in SHUTTERS_MS
    }
    default = np.concatenate([wrong(x) for x in results.of(DEFAULT)]).mean()
    verdict = Verdict.OPEN
    if bad.any() and few.any():
        verdict = Verdict.HOLDS if of_few > 0.5 and of_few > 5 * of_many else Verdict.PARTLY
    return Findings(
        verdict,
        f"Of frames with fewer than {BINS[0][1]} inliers {100 * of_few:.0f} % are lost or wrong by "
        f"more than 5 cm, of those with 50 and more {100 * of_many:.1f} %. By shutter: "
        + ", ".join(f"{100 * x:.1f} % wrong at {ms:g} ms" for ms, x in by_shutter.items())
        + f"; with the default settings, over all shutters, {100 * default:.1f} %.",
        TableOf(("inliers", "frames", "lost or wrong", "share, %"), tuple(rows)),
        "Top: inliers of the thesis preset and of the default settings on the first drive with the "
        "longest shutter; crosses mark frames of the thesis preset that are lost or wrong; grey: "
        "how fast the camera turns. Bottom: error of every step over its inliers, all drives; "
        f"dashed: the {100 * BROKEN_M:g} cm beyond which a step is wrong.",
        lambda figure: _draw(figure, results),
        {
            "frames": ragged(
                **{"inliers": inliers, "lost or wrong": bad,
                   "step error, m": np.concatenate([step_errors_m(x)[1:]
                                                    for x in results.of(THESIS)])}
            )
        },
    )  # fmt: skip


def _pooled(results: Results, variant: Variant) -> tuple[np.ndarray, np.ndarray]:
    """Inliers and wrongness of all frames but the first of each run."""
    runs = results.of(variant)
    inliers = np.concatenate([np.nan_to_num(x.frames.counts["inliers"])[1:] for x in runs])
    return inliers, np.concatenate([wrong(x)[1:] for x in runs])


def _at(results: Results, shutter_ms: float, variant: Variant) -> list[Result]:
    wanted = f"exposure.time_ms={shutter_ms:g}"
    return [x for x in results.of(variant) if wanted in x.job.recording.overrides]


def _draw(figure: "Figure", results: Results) -> None:
    top, bottom = figure.subplots(2, 1, height_ratios=(1.2, 1))
    run, ours = (_at(results, SHUTTERS_MS[-1], v)[0] for v in (THESIS, DEFAULT))
    turning = top.twinx()
    turning.fill_between(run.time_s, turn_rate_deg_s(run), color=GREY, alpha=0.25)
    turning.set_ylim(0, 300)
    turning.set_ylabel("turn rate, °/s", fontsize=9, color=GREY)
    turning.tick_params(labelsize=8, colors=GREY)
    inliers = np.nan_to_num(run.frames.counts["inliers"])
    top.plot(run.time_s, inliers, color=RED, lw=1.0, label="thesis")
    top.plot(
        ours.time_s,
        np.nan_to_num(ours.frames.counts["inliers"]),
        color=OCHRE,
        lw=1.0,
        label="default",
    )
    top.plot(
        run.time_s[wrong(run)], inliers[wrong(run)], "x", color=BLUE, ms=5, label="thesis is wrong"
    )
    top.set_ylim(bottom=-8)
    top.legend(fontsize=8, frameon=False, ncols=3, loc="upper left")
    name = f"turntable, seed {run.job.recording.seed}, {SHUTTERS_MS[-1]:g} ms"
    tidy(top, "time, s", "inliers", name)
    pooled, _ = _pooled(results, THESIS)
    errors_mm = np.concatenate([1e3 * step_errors_m(x)[1:] for x in results.of(THESIS)])
    bottom.plot(np.maximum(pooled, 1), errors_mm, ".", color=RED, ms=3, alpha=0.6)
    bottom.axhline(1e3 * BROKEN_M, color=BLUE, ls="--", lw=0.9)
    bottom.set_xscale("log")
    bottom.set_yscale("log")
    bottom.xaxis.set_major_formatter("{x:g}")
    tidy(bottom, "inliers of a frame", "error of its step, mm", "all drives, thesis preset")


EXPERIMENT = Experiment(
    id="E8",
    title="Few inliers after a blurred turn",
    claim="Where a blurred, fast turn leaves only a few inliers, the pose is lost.",
    source="section 5.1.1, figure 5.1",
    setup="The thesis preset, which goes on with three inliers, and the default settings on "
    "turntable with shutters of 2, 18 and 30 ms. A frame is wrong if it is lost or its step is "
    "off by more than 5 cm.",
    size_in=(9.0, 5.6),
    jobs=jobs,
    analyse=analyse,
)
