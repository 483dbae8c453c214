"""E9 and E10: inliers and drift over one setting of the thesis preset (thesis 5.4 and 5.1.1)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from trials.evaluation.intervals import mean_interval, ratio_interval
from trials.execution.jobs import Results, Variant
from trials.report.figure import BLUE, RED, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import draw_means, lost_text, mean_text
from vo.contract.arrays import Array

SCENES = ("office", "brick_court")
DRIFT = "drift over 1 m, %"
THESIS_THRESHOLD = 0.005


@dataclass(frozen=True)
class Sweep:
    """One setting with a variant for each value; items that remain after a stage are counted."""

    axis: str
    column: str
    variants: Mapping[float, Variant]
    stage: str
    counted: str

    def steps(self, conclude: Callable[[Results], Finding]) -> Steps:
        """Return the functions of an experiment."""
        return Steps(conclude, self.table, self.draw, self.data)

    def counts(self, results: Results, variant: Variant) -> Array:
        """Return the median over frames of the items after the stage, for each run (N,)."""
        return np.array([np.nanmedian(x.frames.counts[self.stage]) for x in results.of(variant)])

    def means(self, results: Results) -> dict[float, tuple[float, float]]:
        """Return the mean count and the mean drift at every value."""
        return {
            x: (
                mean_interval(self.counts(results, v)).value,
                mean_interval(results.drifts(v)).value,
            )
            for x, v in self.variants.items()
        }

    def table(self, results: Results) -> Rows:
        """Return a row for every value."""
        for x, v in self.variants.items():
            yield {
                self.column: f"{x:g}",
                self.counted: mean_text(self.counts(results, v), 0),
                DRIFT: mean_text(results.drifts(v)),
                "frames lost, %": lost_text(results, v),
            }

    def data(self, results: Results) -> Data:
        """Return value, count and drift of every run."""
        variants = self.variants.values()
        columns = {
            self.column: np.repeat(list(self.variants), len(results.recordings)),
            self.stage: np.concatenate([self.counts(results, v) for v in variants]),
            DRIFT: np.concatenate([results.drifts(v) for v in variants]),
        }
        return {self.column.partition(",")[0]: columns}

    def draw(self, figure: Figure, results: Results) -> None:
        """Draw counts (left) and drift (right) over the value; lines are means, dots are runs."""
        left, right = figure.subplots(1, 2)
        draw_means(left, {x: self.counts(results, v) for x, v in self.variants.items()}, BLUE)
        draw_means(right, {x: results.drifts(v) for x, v in self.variants.items()}, RED)
        left.set(xscale="log", ylim=(0, None))
        right.set(xscale="log", yscale="log")
        tidy(left, self.axis, self.counted)
        tidy(right, self.axis, DRIFT)
        right.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        right.yaxis.set_major_formatter("{x:g}")
        right.yaxis.set_minor_locator(NullLocator())


THRESHOLD = Sweep(
    "inlier threshold, normalised image coordinates",
    "threshold, normalised",
    {
        x: Variant(f"threshold {x:g}", "thesis", (f"motion.threshold={x:g}",))
        for x in (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05)
    },
    "consensus",
    "inliers of RANSAC",
)
FEATURES = Sweep(
    "features per image",
    "features",
    {
        float(n): Variant(f"{n} features", "thesis", (f"features.count={n}",))
        for n in (50, 100, 200, 500, 1000)
    },
    "inliers",
    "inliers",
)
FEW, MANY = FEATURES.variants[100.0], FEATURES.variants[1000.0]


def conclude_threshold(results: Results) -> Finding:
    """Determine the thresholds below and above which accuracy decreases."""
    means = THRESHOLD.means(results)
    inliers = [count for count, _ in means.values()]
    drift = {x: level for x, (_, level) in means.items()}
    best, low, high = min(drift, key=lambda x: drift[x]), min(drift), max(drift)
    grows = all(a <= b for a, b in pairwise(inliers))
    hurts = drift[high] > 1.1 * drift[best]
    strict = drift[low] <= 1.1 * drift[best]
    low_ratio, thesis_ratio, high_ratio = (
        f"{drift[x] / drift[best]:.2f}" for x in (low, THESIS_THRESHOLD, high)
    )
    return Verdict.of(grows or hurts, grows and hurts and strict), (
        f"Inliers {'increase' if grows else 'do not always increase'} with the threshold, from "
        f"{inliers[0]:.0f} to {inliers[-1]:.0f}. The drift is smallest at {best:g} "
        f"({drift[best]:.3f} %); it is {low_ratio} times as large at the smallest threshold, "
        f"{thesis_ratio} times at the {THESIS_THRESHOLD:g} of the thesis, and {high_ratio} times "
        "at the largest. (The thesis calls the relation of inliers and threshold "
        "counter-proportional; its text states that a strict threshold accepts fewer.)"
    )


def conclude_features(results: Results) -> Finding:
    """Compare 100 features with 1000, pair by pair."""
    means = FEATURES.means(results)
    ratio = ratio_interval(results.drifts(FEW), results.drifts(MANY))
    inliers = ratio_interval(FEATURES.counts(results, FEW), FEATURES.counts(results, MANY))
    return Verdict.of(ratio.value > 1, ratio.low > 1), (
        f"With 100 features the drift is {ratio.text(2)} times that with 1000, and "
        f"{lost_text(results, FEW)} % of the frames are lost against "
        f"{lost_text(results, MANY)} %. Ten times the features give "
        f"{1 / inliers.value:.1f} times the inliers, {means[100.0][0]:.0f} and "
        f"{means[1000.0][0]:.0f}: weaker features are matched less often."
    )


E9 = Experiment(
    id="E9",
    title="The inlier threshold",
    claim="A strict threshold gives accuracy and few inliers, a loose one many inliers that reduce "
    "accuracy.",
    source="section 5.4, figure 5.2",
    setup="The thesis preset with thresholds from 0.0005 to 0.05 on office and brick_court.",
    caption="Inliers (left) and drift (right) over the inlier threshold: lines are means over all "
    "drives, dots are drives.",
    size_in=(9.0, 3.4),
    recordings=lambda scale: scale.recordings(SCENES, 3),
    variants=THRESHOLD.variants.values(),
    steps=THRESHOLD.steps(conclude_threshold),
)
E10 = Experiment(
    id="E10",
    title="The number of features",
    claim="More features help: 1000 serve RANSAC better than 100 at the same inlier ratio.",
    source="section 5.1.1",
    setup="The thesis preset with 50 to 1000 features on office and brick_court.",
    caption="Inliers (left) and drift (right) over the number of features: lines are means over "
    "all drives, dots are drives.",
    size_in=(9.0, 3.4),
    recordings=lambda scale: scale.recordings(SCENES, 3),
    variants=FEATURES.variants.values(),
    steps=FEATURES.steps(conclude_features),
)
