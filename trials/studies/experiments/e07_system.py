"""E7: the complete system indoors and outdoors, and over bricks (thesis 4.5)."""

from itertools import product

import numpy as np
from matplotlib.figure import Figure

from trials.execution.jobs import Recording, Result, Results, Variant
from trials.report.figure import OCHRE, RED, TRUTH, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import mean_text, paths_m
from trials.studies.experiments.variants import DEFAULT, THESIS
from vo.contract.arrays import Array

PLACES = {
    "office": ("office", ""),
    "meadow": ("meadow", ""),
    "brick_court": ("brick_court", ""),
    "brick_court, bumps": ("brick_court", "brick_bump"),
}
"""Label to scene and disturbance."""
SHOWN = {THESIS: (RED, "-"), DEFAULT: (OCHRE, "--")}
"""Variant to the colour and style of its line."""
ADEQUATE = 1.0
"""Drift, %, below which a rover can navigate."""


def _runs(results: Results, place: str, variant: Variant) -> list[Result]:
    recordings = [r for r in results.recordings if (r.scene, r.disturb) == PLACES[place]]
    return [results.at(r, variant) for r in recordings]


def _conclude(results: Results) -> Finding:
    runs = {place: _runs(results, place, THESIS) for place in PLACES}
    drift = {p: float(np.nanmean([x.drift_percent for x in some])) for p, some in runs.items()}
    lost = sum(x.lost_frames for some in runs.values() for x in some)
    adequate = max(drift.values()) < ADEQUATE and lost == 0
    return Verdict.HOLDS if adequate else Verdict.PARTLY, (
        f"The thesis preset drifts by {min(drift.values()):.2f} to {max(drift.values()):.2f} % of "
        f"the path, most on {max(drift, key=lambda p: drift[p])}; bumps multiply its drift on "
        f"bricks by {drift['brick_court, bumps'] / drift['brick_court']:.1f}."
    )


def _table(results: Results) -> Rows:
    for place, variant in product(PLACES, SHOWN):
        runs = _runs(results, place, variant)
        end_percent = [x.score.end_percent for x in runs if x.score]
        yield {
            "place": place,
            "variant": variant.label,
            "drift over 1 m, %": mean_text(np.array([x.drift_percent for x in runs])),
            "end point, % of path": mean_text(np.array(end_percent, dtype=float), 2),
            "frames lost, %": f"{100 * float(np.mean([x.lost_share for x in runs])):.1f}",
        }


def _data(results: Results) -> Data:
    paths: dict[str, dict[str, Array]] = {place: {} for place in PLACES}
    for place, variant in product(PLACES, SHOWN):
        truth, estimate = paths_m(_runs(results, place, variant)[0])
        for label, path in ((variant.label, estimate), ("truth", truth)):
            paths[place] |= {f"{label} x, m": path[:, 0], f"{label} y, m": path[:, 1]}
    return paths


def _draw(figure: Figure, results: Results) -> None:
    panels = figure.subplots(1, len(PLACES))
    for panel, place in zip(panels, PLACES, strict=True):
        truth, _ = paths_m(_runs(results, place, THESIS)[0])
        panel.plot(*truth[:, :2].T, label="truth", **TRUTH)
        for variant, (colour, style) in SHOWN.items():
            estimate = paths_m(_runs(results, place, variant)[0])[1]
            panel.plot(*estimate[:, :2].T, color=colour, ls=style, lw=1.3, label=variant.label)
        panel.set_aspect("equal", adjustable="datalim")
        tidy(panel, "x, m", "y, m", place)
    panels[0].legend()


E7 = Experiment(
    id="E7",
    title="The complete system indoors and outdoors",
    claim="The system works indoors and outdoors, even where bricks shake a robot on small wheels.",
    source="section 4.5, figures 4.7 to 4.10",
    setup="The thesis preset and the default settings in an office, on a meadow, on a brick court "
    f"and over loose bricks on it. It works if the drift is below {ADEQUATE:g} % and no frame is "
    "lost.",
    caption="Paths from above of the first seed, first poses aligned.",
    size_in=(11.0, 3.2),
    recordings=lambda scale: [
        Recording(scene, seed, scale.drive, disturb)
        for scene, disturb in PLACES.values()
        for seed in scale.seeds
    ],
    variants=SHOWN,
    steps=Steps(_conclude, _table, _draw, _data),
)
