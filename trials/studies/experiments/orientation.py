"""E1 and F9: relative and absolute orientation, and the effect of stereo (thesis 4.1 and 5.2)."""

from itertools import product

import numpy as np
from matplotlib.figure import Figure

from trials.evaluation.intervals import Interval, mean_interval, ratio_interval
from trials.execution.jobs import Recording, Result, Results, Variant
from trials.report.figure import BLUE, GREY, RED, TRUTH, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import (
    first_failure,
    lost_text,
    mean_text,
    paths_m,
    tracked_fraction,
)
from vo.contract.arrays import Array

SCENES = ("office", "brick_court", "turntable")
UNREFINED = "refinement.mode=none"
BY_DISTANCE = ("motion.method=absolute", "motion.residual=distance")
RELATIVE = Variant("relative", "thesis", (UNREFINED,))
ABSOLUTE = Variant("absolute", "thesis", (UNREFINED, *BY_DISTANCE))
REFINED = Variant("absolute, refined", "thesis", BY_DISTANCE)
VARIANTS = (RELATIVE, ABSOLUTE, REFINED)
STAGE = "consensus"
AROUND = 5
"""Number of frames on either side of a failure over which inliers are compared."""
RISE = 1.1
"""Ratio of inliers above which they have risen."""
STEREO_SCENES = ("office", "brick_court", "meadow")
STEREO = {
    "block matching": (),
    "block matching, sub-pixel": ("stereo.refine=true",),
    "semi-global": ("stereo.method=semi_global",),
    "semi-global, sub-pixel": ("stereo.method=semi_global", "stereo.refine=true"),
    "sparse ZNCC, sub-pixel": ("stereo.method=sparse", "stereo.refine=true"),
}
PAIRS = {
    name: (
        Variant(f"relative, {name}", "thesis", (*stereo, UNREFINED)),
        Variant(f"absolute, {name}", "thesis", (*stereo, *BY_DISTANCE, UNREFINED)),
    )
    for name, stereo in STEREO.items()
}
STEREO_VARIANTS = [variant for pair in PAIRS.values() for variant in pair]
EQUAL = 1.1
"""Largest ratio of drifts at which absolute orientation is as accurate."""


def _conclude_orientation(results: Results) -> Finding:
    relative, absolute, refined = (
        np.array([tracked_fraction(x) for x in results.of(v)]) for v in VARIANTS
    )
    rises = [x for run in results.of(ABSOLUTE) if (x := inlier_rise(run)) is not None]
    rose = sum(x > RISE for x in rises)
    worse = np.nanmedian(results.drifts(ABSOLUTE) / results.drifts(RELATIVE))
    longer = relative.mean() > absolute.mean()
    always = longer and (relative >= absolute).all() and rose > len(rises) / 2
    return Verdict.of(longer or worse > 1, always), (
        f"Relative orientation tracks {100 * relative.mean():.0f} % of the drives before the first "
        f"failure, absolute orientation {100 * absolute.mean():.0f} %; the drift of absolute "
        f"orientation is {worse:.1f} times as large (median of pairs). At its first failure, the "
        f"number of inliers rises by more than {100 * (RISE - 1):.0f} % in {rose} of {len(rises)} "
        f"cases. With refinement of the motion, absolute orientation tracks "
        f"{100 * refined.mean():.0f} %."
    )


def _orientation_table(results: Results) -> Rows:
    scenes = dict.fromkeys(r.scene for r in results.recordings)
    for scene, variant in product(scenes, VARIANTS):
        runs = results.of(variant, scene)
        fractions = np.array([tracked_fraction(x) for x in runs])
        tracked = mean_interval(100 * fractions, minimum=0, maximum=100)
        inliers = np.array([np.nanmedian(x.frames.counts[STAGE]) for x in runs])
        yield {
            "scene": scene,
            "orientation": variant.label,
            "drives without a failure": f"{(fractions == 1).sum()} of {len(runs)}",
            "tracked before the first failure, % of the drive": tracked.text(0),
            "inliers, median of a drive": mean_text(inliers, 0),
            "drift over 1 m, %": mean_text(results.drifts(variant, scene), 2),
        }


def inlier_rise(run: Result) -> float | None:
    """Return the ratio of inliers from the first failure on to those before; None without one."""
    at = first_failure(run)
    inliers = np.nan_to_num(run.frames.counts[STAGE])
    if at is None or at < 2:
        return None
    before = float(np.mean(inliers[max(at - AROUND, 1) : at]))
    return float(np.mean(inliers[at : at + AROUND])) / before if before > 0 else None


def _shown(results: Results) -> Recording:
    """Return the drive on which absolute orientation fails first."""
    return min(results.recordings, key=lambda r: tracked_fraction(results.at(r, ABSOLUTE)))


def _orientation_data(results: Results) -> Data:
    runs = [results.at(_shown(results), v) for v in (RELATIVE, ABSOLUTE)]
    paths: dict[str, Array] = {}
    for run in runs:
        if len(run.run.trajectory) > 1:
            x_m, y_m, _ = paths_m(run)[1].T
            paths |= {f"{run.job.variant.label} x, m": x_m, f"{run.job.variant.label} y, m": y_m}
    return {"inliers": {x.job.variant.label: x.frames.counts[STAGE] for x in runs}, "paths": paths}


def _draw_orientation(figure: Figure, results: Results) -> None:
    shown = _shown(results)
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1))
    for variant, colour in ((RELATIVE, RED), (ABSOLUTE, BLUE)):
        run = results.at(shown, variant)
        left.plot(run.frames.counts[STAGE], color=colour, lw=1.0, label=variant.label)
        if len(run.run.trajectory) > 1:
            right.plot(*paths_m(run)[1][:, :2].T, color=colour, lw=1.2, label=variant.label)
    truth = results.at(shown, RELATIVE).truth.T_ref_frame[:, :2, 3]
    right.plot(*truth.T, **TRUTH, label="truth")
    if (at := first_failure(results.at(shown, ABSOLUTE))) is not None:
        left.axvline(at, color=BLUE, ls="--", lw=0.9)
    tidy(left, "frame", "inliers", f"{shown.scene}, seed {shown.seed}")
    tidy(right, "x, m", "y, m", "from above")
    right.set_aspect("equal", adjustable="datalim")
    left.legend()
    right.legend()


E1 = Experiment(
    id="E1",
    title="Relative or absolute orientation",
    claim="Relative orientation tracks longer than absolute orientation, whose inliers rise where "
    "it fails.",
    source="section 4.1, figure 4.1",
    setup="The thesis preset without refinement, with relative orientation (P3P) and with absolute "
    "orientation of stereo points (within 5 cm), and the latter with refinement, on office, "
    "brick_court, and the blurred turns of turntable. A drive fails at the first frame that is "
    "lost or whose step error exceeds 5 cm.",
    caption="Left: inliers of RANSAC in every frame of the drive on which absolute orientation "
    "fails first; the dashed line marks its failure. Right: both paths and the truth from above, "
    "first poses aligned.",
    size_in=(9.5, 3.6),
    recordings=lambda scale: scale.recordings(SCENES),
    variants=VARIANTS,
    steps=Steps(_conclude_orientation, _orientation_table, _draw_orientation, _orientation_data),
)


def _ratios(results: Results) -> dict[str, Interval]:
    """Return the drift of absolute over that of relative orientation for every stereo method."""
    return {
        name: ratio_interval(results.drifts(absolute), results.drifts(relative))
        for name, (relative, absolute) in PAIRS.items()
    }


def _conclude_stereo(results: Results) -> Finding:
    found = _ratios(results)
    first, best = next(iter(found)), min(found, key=lambda name: found[name].value)
    better = found[best].value < found[first].value
    return Verdict.of(better, found[best].value <= EQUAL), (
        f"With the {first} of the thesis, absolute orientation has {found[first].text(2)} times "
        f"the drift of relative orientation; with {best} it has {found[best].text(2)} times."
    )


def _stereo_table(results: Results) -> Rows:
    found = _ratios(results)
    for name, (relative, absolute) in PAIRS.items():
        yield {
            "stereo": name,
            "relative: drift over 1 m, %": mean_text(results.drifts(relative), 2),
            "absolute: drift over 1 m, %": mean_text(results.drifts(absolute), 2),
            "absolute over relative": found[name].text(2),
            "frames lost, %": f"{lost_text(results, relative)} / {lost_text(results, absolute)}",
        }


def _stereo_data(results: Results) -> Data:
    return {"drift": {f"{v.label}, %": results.drifts(v) for v in STEREO_VARIANTS}}


def _draw_stereo(figure: Figure, results: Results) -> None:
    panel = figure.subplots()
    for k, pair in enumerate(PAIRS.values()):
        for side, (variant, colour) in enumerate(zip(pair, (RED, BLUE), strict=True)):
            at = k + 0.4 * (side - 0.5)
            drifts = results.drifts(variant)
            label = ("relative", "absolute")[side] if k == 0 else None
            panel.bar(at, np.nanmean(drifts), 0.36, color=colour, alpha=0.75, label=label)
            panel.plot(np.full(len(drifts), at), drifts, "o", color=GREY, ms=3)
    panel.set_xticks(range(len(PAIRS)), [name.replace(", ", ",\n") for name in PAIRS])
    panel.legend()
    tidy(panel, "", "drift over 1 m, %")


F9 = Experiment(
    id="F9",
    title="Better stereo for absolute orientation",
    claim="With stereo of sufficient accuracy, absolute orientation is as accurate as relative "
    "orientation.",
    source="section 5.2",
    setup="The thesis preset without refinement on three scenes, with relative orientation and "
    "with absolute orientation, with five stereo methods. As accurate: at most "
    f"{EQUAL:g} times the drift.",
    caption="Drift of relative and of absolute orientation with every stereo method, without "
    "refinement: bars are means, dots drives.",
    size_in=(8.5, 3.4),
    recordings=lambda scale: scale.recordings(STEREO_SCENES, 3),
    variants=STEREO_VARIANTS,
    steps=Steps(_conclude_stereo, _stereo_table, _draw_stereo, _stereo_data),
)
