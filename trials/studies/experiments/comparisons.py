"""F2 and F: changes of the default settings, compared pair by pair over the same recordings."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from trials.evaluation.intervals import Interval, ratio_interval
from trials.execution.jobs import Recording, Results, Variant
from trials.report.figure import GREY, INK, RED, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Scale, Steps, Verdict
from trials.studies.experiments.measures import lost_text, mean_text
from trials.studies.experiments.variants import DEFAULT, THESIS


@dataclass(frozen=True)
class Comparison:
    """Variants that are compared with a reference on some scenes; heading of their column."""

    heading: str
    scenes: tuple[str, ...]
    reference: Variant
    others: tuple[Variant, ...]

    @property
    def variants(self) -> tuple[Variant, ...]:
        """Reference and variants."""
        return (self.reference, *self.others)

    def recordings(self, scale: Scale) -> list[Recording]:
        """Return the drives at a scale."""
        return scale.recordings(self.scenes, 3)

    def steps(self, conclude: Callable[[Results], Finding]) -> Steps:
        """Return the functions of an experiment."""
        return Steps(conclude, self.table, self.draw, self.data)

    def ratios(self, results: Results) -> dict[Variant, Interval]:
        """Return the geometric mean of each variant's drift over that of the reference."""
        known = results.drifts(self.reference)
        return {v: ratio_interval(results.drifts(v), known) for v in self.others}

    def table(self, results: Results) -> Rows:
        """Return a row for the reference and each variant."""
        ratios = {self.reference: "1"} | {v: x.text(2) for v, x in self.ratios(results).items()}
        for v, ratio in ratios.items():
            ms = [np.median(x.frames.frame_ms) for x in results.of(v)]
            yield {
                self.heading: v.label,
                "drift over 1 m, %": mean_text(results.drifts(v)),
                "ratio": ratio,
                "frames lost, %": lost_text(results, v),
                "ms per frame": f"{np.mean(ms):.0f}",
            }

    def data(self, results: Results) -> Data:
        """Return the drifts of all runs, a column for each variant."""
        return {"drift": {f"{v.label}, %": results.drifts(v) for v in self.variants}}

    def draw(self, figure: Figure, results: Results) -> None:
        """Draw the ratio of every variant with its interval; dots are recordings."""
        panel = figure.subplots()
        known = results.drifts(self.reference)
        for row, (variant, found) in enumerate(self.ratios(results).items()):
            with np.errstate(divide="ignore", invalid="ignore"):
                each = results.drifts(variant) / known
            panel.plot(each, np.full(len(each), row), "o", color=GREY, ms=3, alpha=0.6)
            panel.plot([found.low, found.high], [row, row], color=RED, lw=2.0)
            panel.plot(found.value, row, "D", color=RED, ms=5)
        panel.axvline(1.0, color=INK, ls="--", lw=0.9)
        panel.set_xscale("log")
        panel.set_yticks(range(len(self.others)), [v.label for v in self.others])
        panel.set_ylim(len(self.others) - 0.5, -0.5)
        tidy(panel, f"drift, ratio to {self.reference.label} (1: equal; left is better)", "")
        panel.tick_params(axis="y", labelsize=8.5)
        panel.xaxis.set_major_formatter("{x:g}")


def _changed(label: str, *overrides: str) -> Variant:
    return Variant(label, "driftyard", overrides)


BOX = _changed("CenSurE, box", "features.kernel=box")
STAR = _changed("CenSurE, star", "features.kernel=star")
HARRIS = _changed("Harris corners", "features.detector=harris")
DETECTORS = Comparison(
    "detector",
    ("office", "brick_court", "meadow", "corridor", "turntable"),
    Variant("CenSurE, octagon"),
    (BOX, STAR, HARRIS),
)
CHANGES = Comparison(
    "change",
    ("office", "brick_court", "corridor", "crowded", "turntable"),
    DEFAULT,
    (
        _changed("F1 no new map after a loss", "patience_frames=1000000"),
        _changed("F2 Harris corners", "features.detector=harris"),
        _changed("F4 circular check over three frames", "matching.circular_check=true"),
        _changed("F5 without guided matching", "matching.guided=false"),
        _changed("F6 rotation from far points", "motion.method=decoupled"),
        _changed("F6 without points beyond 5 m", "stereo.min_disparity_px=8"),
        _changed("F7 map resets", "refinement.map_reset_keyframes=8"),
        _changed("F7 preemptive RANSAC", "motion.scheme=preemptive"),
        _changed("F8 refinement without RANSAC", "motion.method=graduated_nonconvexity"),
        _changed("landmark prior", "motion.landmark_prior=true"),
        _changed("F9 block matching", "stereo.method=block_matching", "stereo.downscale=1"),
        _changed("F9 semi-global stereo", "stereo.method=semi_global", "stereo.downscale=1"),
        _changed(
            "F10 equal noise for all observations",
            "refinement.sigma_px=0.5",
            "refinement.sigma_disparity_px=0.5",
            "refinement.learn_noise=false",
        ),
        _changed("F13 dropping slow frames", "refinement.max_keyframe_iterations=20"),
        _changed("without refinement of structure", "refinement.mode=motion"),
        _changed("without alignment of matches", "matching.align=false", "matching.guided=false"),
        THESIS,
    ),
)


def conclude_detectors(results: Results) -> Finding:
    """Compare the drift with each detector."""
    found = DETECTORS.ratios(results)
    harris = found[HARRIS]
    decided = harris.low > 1 or harris.high < 1
    verdict = Verdict.of(harris.low > 1, True) if decided else Verdict.OPEN
    return verdict, (
        f"With Harris corners the drift is {harris.text(2)} times that with CenSurE, with the same "
        f"matching, stereo and refinement; with box kernels {found[BOX].text(2)} times, with star "
        f"kernels {found[STAR].text(2)} times."
    )


def conclude_changes(results: Results) -> Finding:
    """Order the changes by their effect on the drift."""
    found = CHANGES.ratios(results)
    costly = sorted((v for v in found if found[v].low > 1), key=lambda v: -found[v].value)
    gains = [v for v in found if found[v].high < 1]
    worse, better = (
        ", ".join(f"{v.label} {found[v].value:.2f}" for v in some) for some in (costly[:5], gains)
    )
    sentence = "No change is significantly better."
    if gains:
        sentence = f"Better than the default settings: {better}."
    if costly:
        increases = "Largest increases of the drift (ratio to the default settings)"
        sentence = f"{increases}: {worse}. {sentence}"
    return Verdict.of(True, bool(costly and not gains)), sentence


F2 = Experiment(
    id="F2",
    title="CenSurE or Harris corners",
    claim="CenSurE serves visual odometry better than Harris corners (a comparison that the "
    "thesis left open).",
    source="section 6",
    setup="The default settings with each detector on five scenes.",
    caption="Drift with each detector over that with the default one: diamonds are geometric "
    "means, bars their 95 % intervals, dots drives.",
    size_in=(8.0, 2.4),
    recordings=DETECTORS.recordings,
    variants=DETECTORS.variants,
    steps=DETECTORS.steps(conclude_detectors),
)
F = Experiment(
    id="F",
    title="Effect of each method",
    claim="Each method in the default settings lowers the drift, and none that they leave out "
    "would.",
    source="sections 2.2, 5 and 6; items F1 to F13",
    setup="The default settings with one change each, on five scenes, and the thesis preset. Item "
    "F3, a reference to compare with, is the ground truth itself.",
    caption="Drift with one change over that of the default settings: diamonds are geometric "
    "means, bars their 95 % intervals, dots drives.",
    size_in=(8.5, 5.2),
    recordings=CHANGES.recordings,
    variants=CHANGES.variants,
    steps=CHANGES.steps(conclude_changes),
)
