"""E9: RANSAC's inliers against its acceptance threshold (thesis 5.4, fig. 5.2)."""

from collections.abc import Sequence
from itertools import pairwise

from trials.execution.jobs import Job, Results, Variant, jobs_of
from trials.studies.experiments.experiment import Experiment, Findings, Scale, Verdict
from trials.studies.experiments.sweep import draw_sweep, levels, sweep_data, sweep_table

SCENES = ("office", "brick_court")
THRESHOLDS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05)
SWEEP = {x: Variant(f"threshold {x:g}", "thesis", (f"motion.threshold={x:g}",)) for x in THRESHOLDS}
SETTING = "acceptance threshold, normalised image coordinates"
STAGE = "consensus"
LABEL = "inliers of RANSAC"
THEIRS = 0.005


def jobs(scale: Scale) -> Sequence[Job]:
    """Thresholds over two decades."""
    return jobs_of(scale.recordings(SCENES, 3), SWEEP.values())


def analyse(results: Results) -> Findings:
    """Look for the threshold below which accuracy falls, and that above which it does."""
    found = levels(results, SWEEP, STAGE)
    inliers = [count.value for count, _ in found.values()]
    drift = {x: level.value for x, (_, level) in found.items()}
    best = min(drift, key=lambda x: drift[x])
    grows = all(a <= b for a, b in pairwise(inliers))
    hurts = drift[THRESHOLDS[-1]] > 1.1 * drift[best]
    strict = drift[THRESHOLDS[0]] <= 1.1 * drift[best]
    verdict = Verdict.PARTLY
    if grows and hurts and strict:
        verdict = Verdict.HOLDS
    elif not grows and not hurts:
        verdict = Verdict.FAILS
    return Findings(
        verdict,
        f"Inliers {'grow' if grows else 'do not always grow'} with the threshold, from "
        f"{inliers[0]:.0f} to {inliers[-1]:.0f}. Drift is least at {best:g} "
        f"({drift[best]:.3f} %); the strictest has {drift[THRESHOLDS[0]] / drift[best]:.2f} times "
        f"that, the thesis' {THEIRS:g} has {drift[THEIRS] / drift[best]:.2f} times, the loosest "
        f"{drift[THRESHOLDS[-1]] / drift[best]:.2f} times. (The thesis calls the relation of "
        "inliers and threshold counter-proportional; its text says that a strict one accepts "
        "fewer.)",
        sweep_table(results, SWEEP, "threshold, normalised", STAGE, LABEL),
        "Inliers (left) and drift (right) over the acceptance threshold: lines are means over all "
        "drives, dots are drives.",
        lambda figure: draw_sweep(figure, results, SWEEP, SETTING, STAGE, LABEL),
        {"threshold": sweep_data(results, SWEEP, "threshold, normalised", STAGE)},
    )


EXPERIMENT = Experiment(
    id="E9",
    title="The acceptance threshold",
    claim="A strict threshold keeps accuracy and few inliers, a loose one many inliers that hurt.",
    source="section 5.4, figure 5.2",
    setup="The thesis preset with thresholds from 0.0005 to 0.05 on office and brick_court.",
    size_in=(9.0, 3.4),
    jobs=jobs,
    analyse=analyse,
)
