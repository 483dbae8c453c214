"""F9: whether better stereo lets absolute orientation catch up (thesis 5.2)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trials.evaluation.intervals import Interval, mean_interval, ratio_interval
from trials.execution.jobs import Job, Results, Variant, jobs_of
from trials.report.figure import BLUE, GREY, RED, tidy
from trials.studies.experiments.experiment import Experiment, Findings, Scale, TableOf, Verdict
from trials.studies.experiments.sweep import lost_percent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
CAUGHT_UP = 1.1


def jobs(scale: Scale) -> Sequence[Job]:
    """Both orientations on every stereo, without refinement, which would hide the difference."""
    return jobs_of(scale.recordings(SCENES, 3), [v for pair in PAIRS.values() for v in pair])


def gaps(results: Results) -> dict[str, Interval]:
    """Drift of absolute over that of relative orientation for every stereo."""
    return {
        name: ratio_interval(results.drifts(absolute), results.drifts(relative))
        for name, (relative, absolute) in PAIRS.items()
    }


def analyse(results: Results) -> Findings:
    """Follow the gap between the two from stereo to stereo."""
    found = gaps(results)
    rows = [
        (
            name,
            mean_interval(results.drifts(relative), least=0).text(2),
            mean_interval(results.drifts(absolute), least=0).text(2),
            found[name].text(2),
            f"{lost_percent(results, relative):.1f} / {lost_percent(results, absolute):.1f}",
        )
        for name, (relative, absolute) in PAIRS.items()
    ]
    first, best = next(iter(found)), min(found, key=lambda name: found[name].value)
    verdict = Verdict.FAILS
    if found[best].value < found[first].value:
        verdict = Verdict.HOLDS if found[best].value <= CAUGHT_UP else Verdict.PARTLY
    return Findings(
        verdict,
        f"With the thesis' {first}, absolute orientation has {found[first].text(2)} times the "
        f"drift of relative orientation; with {best} it has {found[best].text(2)} times.",
        TableOf(
            (
                "stereo",
                "relative: drift over 1 m, %",
                "absolute: drift over 1 m, %",
                "absolute over relative",
                "frames lost, %",
            ),
            tuple(rows),
        ),
        "Drift of relative and of absolute orientation with every stereo, without refinement: "
        "bars are means, dots drives.",
        lambda figure: _draw(figure, results),
        {"drift": {f"{v.label}, %": results.drifts(v) for pair in PAIRS.values() for v in pair}},
    )


def _draw(figure: "Figure", results: Results) -> None:
    panel = figure.subplots()
    for k, pair in enumerate(PAIRS.values()):
        for side, (variant, colour) in enumerate(zip(pair, (RED, BLUE), strict=True)):
            at = k + 0.4 * (side - 0.5)
            drifts = results.drifts(variant)
            label = ("relative", "absolute")[side] if k == 0 else None
            panel.bar(at, np.nanmean(drifts), 0.36, color=colour, alpha=0.75, label=label)
            panel.plot(np.full(len(drifts), at), drifts, "o", color=GREY, ms=3)
    panel.set_xticks(range(len(PAIRS)), [name.replace(", ", ",\n") for name in PAIRS])
    panel.legend(fontsize=8, frameon=False)
    tidy(panel, "", "drift over 1 m, %")


EXPERIMENT = Experiment(
    id="F9",
    title="Better stereo for absolute orientation",
    claim="With stereo that is accurate enough, absolute orientation catches up with relative "
    "orientation.",
    source="section 5.2",
    setup="The thesis preset without refinement on three scenes, with relative orientation and "
    "with absolute orientation, on five kinds of stereo. Caught up: at most "
    f"{CAUGHT_UP:g} times the drift.",
    size_in=(8.5, 3.4),
    jobs=jobs,
    analyse=analyse,
)
