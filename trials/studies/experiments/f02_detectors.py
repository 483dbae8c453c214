"""F2: CenSurE beside Harris corners, and its kernels beside each other (thesis 6)."""

from collections.abc import Sequence

from trials.execution.jobs import Job, Results, Variant, jobs_of
from trials.studies.experiments.compare import (
    comparison_data,
    comparison_table,
    draw_ratios,
    ratios,
)
from trials.studies.experiments.experiment import Experiment, Findings, Scale, Verdict

SCENES = ("office", "brick_court", "meadow", "corridor", "turntable")
REFERENCE = Variant("CenSurE, octagon")
HARRIS = Variant("Harris corners", "driftyard", ("features.detector=harris",))
OTHERS = (
    Variant("CenSurE, box", "driftyard", ("features.kernel=box",)),
    Variant("CenSurE, star", "driftyard", ("features.kernel=star",)),
    HARRIS,
)


def jobs(scale: Scale) -> Sequence[Job]:
    """Every detector on scenes with much and little texture."""
    return jobs_of(scale.recordings(SCENES, 3), (REFERENCE, *OTHERS))


def analyse(results: Results) -> Findings:
    """Compare the drift that each leads to."""
    found = ratios(results, OTHERS, REFERENCE)
    harris = found[HARRIS]
    verdict = Verdict.OPEN
    if harris.low > 1:
        verdict = Verdict.HOLDS
    elif harris.high < 1:
        verdict = Verdict.FAILS
    return Findings(
        verdict,
        f"Harris corners have {harris.text(2)} times the drift of CenSurE with the same matching, "
        "stereo and refinement; box kernels "
        f"{found[OTHERS[0]].text(2)} times, star kernels {found[OTHERS[1]].text(2)} times.",
        comparison_table(results, OTHERS, REFERENCE, "detector"),
        "Drift with each detector over that with the default one: diamonds are geometric means, "
        "bars their 95 % intervals, dots drives.",
        lambda figure: draw_ratios(figure, results, OTHERS, REFERENCE),
        {"drift": comparison_data(results, OTHERS, REFERENCE)},
    )


EXPERIMENT = Experiment(
    id="F2",
    title="CenSurE or Harris corners",
    claim="CenSurE serves visual odometry better than Harris corners (a comparison that the "
    "thesis left open).",
    source="section 6",
    setup="The default settings with each detector on five scenes.",
    size_in=(8.0, 2.4),
    jobs=jobs,
    analyse=analyse,
)
