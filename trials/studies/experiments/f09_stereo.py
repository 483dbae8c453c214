"""F9: the effect of stereo accuracy on absolute orientation (thesis 5.2)."""

import numpy as np
from matplotlib.figure import Figure

from trials.evaluation.intervals import Interval, ratio_interval
from trials.execution.jobs import Results, Variant
from trials.report.figure import BLUE, GREY, RED, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import lost_text, mean_text

SCENES = ("office", "brick_court", "meadow")
NO_REFINEMENT = "refinement.mode=none"
STEREO = {
    "block matching": (),
    "block matching, sub-pixel": ("stereo.refine=true",),
    "semi-global": ("stereo.method=semi_global",),
    "semi-global, sub-pixel": ("stereo.method=semi_global", "stereo.refine=true"),
    "sparse ZNCC, sub-pixel": ("stereo.method=sparse", "stereo.refine=true"),
}
ABSOLUTE = ("motion.method=absolute", "motion.residual=distance")
PAIRS = {
    name: (
        Variant(f"relative, {name}", "thesis", (*stereo, NO_REFINEMENT)),
        Variant(f"absolute, {name}", "thesis", (*stereo, *ABSOLUTE, NO_REFINEMENT)),
    )
    for name, stereo in STEREO.items()
}
VARIANTS = [variant for pair in PAIRS.values() for variant in pair]
EQUAL = 1.1
"""Largest ratio of drifts at which absolute orientation is as accurate."""


def _ratios(results: Results) -> dict[str, Interval]:
    """Return the drift of absolute over that of relative orientation for every stereo method."""
    return {
        name: ratio_interval(results.drifts(absolute), results.drifts(relative))
        for name, (relative, absolute) in PAIRS.items()
    }


def _conclude(results: Results) -> Finding:
    found = _ratios(results)
    first, best = next(iter(found)), min(found, key=lambda name: found[name].value)
    better = found[best].value < found[first].value
    return Verdict.of(better, found[best].value <= EQUAL), (
        f"With the {first} of the thesis, absolute orientation has {found[first].text(2)} times "
        f"the drift of relative orientation; with {best} it has {found[best].text(2)} times."
    )


def _table(results: Results) -> Rows:
    found = _ratios(results)
    for name, (relative, absolute) in PAIRS.items():
        yield {
            "stereo": name,
            "relative: drift over 1 m, %": mean_text(results.drifts(relative), 2),
            "absolute: drift over 1 m, %": mean_text(results.drifts(absolute), 2),
            "absolute over relative": found[name].text(2),
            "frames lost, %": f"{lost_text(results, relative)} / {lost_text(results, absolute)}",
        }


def _data(results: Results) -> Data:
    return {"drift": {f"{v.label}, %": results.drifts(v) for v in VARIANTS}}


def _draw(figure: Figure, results: Results) -> None:
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
    recordings=lambda scale: scale.recordings(SCENES, 3),
    variants=VARIANTS,
    steps=Steps(_conclude, _table, _draw, _data),
)
