"""E10: more features help RANSAC (thesis 5.1.1)."""

from collections.abc import Sequence

from trials.evaluation.intervals import ratio_interval
from trials.execution.jobs import Job, Results, Variant, jobs_of
from trials.studies.experiments.experiment import Experiment, Findings, Scale, Verdict
from trials.studies.experiments.sweep import (
    draw_sweep,
    levels,
    lost_percent,
    median_count,
    sweep_data,
    sweep_table,
)

SCENES = ("office", "brick_court")
COUNTS = (50, 100, 200, 500, 1000)
SWEEP = {float(n): Variant(f"{n} features", "thesis", (f"features.count={n}",)) for n in COUNTS}
FEW, MANY = SWEEP[100.0], SWEEP[1000.0]
SETTING, STAGE, LABEL = "features kept in an image", "inliers", "inliers"


def jobs(scale: Scale) -> Sequence[Job]:
    """From 50 to 1000 features."""
    return jobs_of(scale.recordings(SCENES, 3), SWEEP.values())


def analyse(results: Results) -> Findings:
    """Compare 100 features with 1000, pair by pair."""
    found = levels(results, SWEEP, STAGE)
    times = ratio_interval(results.drifts(FEW), results.drifts(MANY))
    inliers = ratio_interval(median_count(results, FEW, STAGE), median_count(results, MANY, STAGE))
    verdict = Verdict.FAILS
    if times.value > 1:
        verdict = Verdict.HOLDS if times.low > 1 else Verdict.PARTLY
    return Findings(
        verdict,
        f"With 100 features the drift is {times.text(2)} times that with 1000, and "
        f"{lost_percent(results, FEW):.1f} % of the frames are lost against "
        f"{lost_percent(results, MANY):.1f} %. Ten times the features leave "
        f"{1 / inliers.value:.1f} times the inliers, {found[100.0][0].value:.0f} and "
        f"{found[1000.0][0].value:.0f}: the weaker ones are found again less often.",
        sweep_table(results, SWEEP, "features", STAGE, LABEL),
        "Inliers (left) and drift (right) over the number of features: lines are means over all "
        "drives, dots are drives.",
        lambda figure: draw_sweep(figure, results, SWEEP, SETTING, STAGE, LABEL),
        {"features": sweep_data(results, SWEEP, "features", STAGE)},
    )


EXPERIMENT = Experiment(
    id="E10",
    title="The number of features",
    claim="More features help: 1000 serve RANSAC better than 100 at the same rate of inliers.",
    source="section 5.1.1",
    setup="The thesis preset with 50 to 1000 features on office and brick_court.",
    size_in=(9.0, 3.4),
    jobs=jobs,
    analyse=analyse,
)
