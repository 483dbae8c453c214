"""E7: the complete system indoors and outdoors, and over bricks (thesis 4.5)."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from trials.execution.jobs import Job, Recording, Result, Results, Variant, jobs_of
from trials.report.figure import OCHRE, RED, TRUTH, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Scale, Steps, Table, Verdict
from trials.studies.experiments.measures import mean_text, paths_m, ragged
from trials.studies.experiments.variants import DEFAULT, THESIS

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


def _jobs(scale: Scale) -> Sequence[Job]:
    recordings = [
        Recording(scene, seed, scale.drive, disturb)
        for scene, disturb in PLACES.values()
        for seed in scale.seeds
    ]
    return jobs_of(recordings, SHOWN)


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


def _table(results: Results) -> Table:
    rows: list[tuple[str, ...]] = []
    for place in PLACES:
        for variant in SHOWN:
            runs = _runs(results, place, variant)
            drift = mean_text(np.array([x.drift_percent for x in runs]))
            end = [x.score.end_percent for x in runs if x.score]
            lost = f"{100 * float(np.mean([x.lost_share for x in runs])):.1f}"
            end_text = mean_text(np.array(end, dtype=float), 2)
            rows.append((place, variant.label, drift, end_text, lost))
    return Table.of(
        "place | variant | drift over 1 m, % | end point, % of path | frames lost, %", rows
    )


def _data(results: Results) -> Data:
    paths: dict[str, dict[str, np.ndarray]] = {}
    for place in PLACES:
        columns: dict[str, np.ndarray] = {}
        for variant in SHOWN:
            truth, estimate = paths_m(_runs(results, place, variant)[0])
            columns |= {f"{variant.label} x, m": estimate[:, 0]}
            columns |= {f"{variant.label} y, m": estimate[:, 1]}
            columns |= {"truth x, m": truth[:, 0], "truth y, m": truth[:, 1]}
        paths[place] = ragged(**columns)
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
    panels[0].legend(fontsize=8, frameon=False)


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
    steps=Steps(_jobs, _conclude, _table, _draw, _data),
)
