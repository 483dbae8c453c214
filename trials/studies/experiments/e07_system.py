"""E7: the complete system indoors and outdoors, with bricks under the wheels (thesis 4.5)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from trials.evaluation.intervals import mean_interval
from trials.execution.jobs import Job, Recording, Results, jobs_of
from trials.report.figure import OCHRE, RED, TRUTH, tidy
from trials.studies.experiments.experiment import (
    Experiment,
    Findings,
    Scale,
    TableOf,
    Verdict,
    ragged,
)
from trials.studies.experiments.measures import paths_m
from trials.studies.experiments.variants import DEFAULT, THESIS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLACES = {
    "office": ("office", ""),
    "meadow": ("meadow", ""),
    "brick_court": ("brick_court", ""),
    "brick_court, bumps": ("brick_court", "brick_bump"),
}
SHOWN = ((THESIS, RED), (DEFAULT, OCHRE))
ADEQUATE = 1.0
"""Drift, %, with which a rover can navigate."""


def jobs(scale: Scale) -> Sequence[Job]:
    """Indoors, on grass, on bricks, and over loose ones."""
    recordings = [
        Recording(scene, seed, scale.drive, disturb)
        for scene, disturb in PLACES.values()
        for seed in scale.seeds
    ]
    return jobs_of(recordings, [v for v, _ in SHOWN])


def _recordings(results: Results, place: str) -> list[Recording]:
    scene, disturb = PLACES[place]
    return [r for r in results.recordings if (r.scene, r.disturb) == (scene, disturb)]


def analyse(results: Results) -> Findings:
    """Score the thesis preset and the default settings at every place."""
    rows: list[tuple[str, ...]] = []
    worst: dict[str, float] = {}
    lost = 0.0
    for place in PLACES:
        for variant, _ in SHOWN:
            runs = [results.at(r, variant) for r in _recordings(results, place)]
            drift = np.array([x.drift_percent for x in runs])
            end = [x.score.end_percent for x in runs if x.score]
            share = float(np.mean([x.lost_share for x in runs]))
            rows.append(
                (
                    place,
                    variant.label,
                    mean_interval(drift, least=0).text(3),
                    mean_interval(np.array(end, dtype=float), least=0).text(2),
                    f"{100 * share:.1f}",
                )
            )
            if variant == THESIS:
                worst[place] = float(np.nanmean(drift))
                lost += share
    bumped, calm = worst["brick_court, bumps"], worst["brick_court"]
    adequate = max(worst.values()) < ADEQUATE and lost == 0
    return Findings(
        Verdict.HOLDS if adequate else Verdict.PARTLY,
        f"The thesis preset drifts by {min(worst.values()):.2f} to {max(worst.values()):.2f} % of "
        f"the path, worst on {max(worst, key=lambda p: worst[p])}; bumps multiply its drift on "
        f"bricks by {bumped / calm:.1f}.",
        TableOf(
            ("place", "variant", "drift over 1 m, %", "end point, % of path", "frames lost, %"),
            tuple(rows),
        ),
        "Paths from above of the first seed, first poses aligned.",
        lambda figure: _draw(figure, results),
        {
            place: ragged(**_paths(results, _recordings(results, place)[0]))
            for place in PLACES
        },
    )  # fmt: skip


def _paths(results: Results, recording: Recording) -> dict[str, np.ndarray]:
    columns: dict[str, np.ndarray] = {}
    for variant, _ in SHOWN:
        truth, estimate = paths_m(results.at(recording, variant))
        columns |= {
            f"{variant.label} x, m": estimate[:, 0],
            f"{variant.label} y, m": estimate[:, 1],
        }
        columns |= {"truth x, m": truth[:, 0], "truth y, m": truth[:, 1]}
    return columns


def _draw(figure: "Figure", results: Results) -> None:
    panels = figure.subplots(1, len(PLACES))
    for panel, place in zip(panels, PLACES, strict=True):
        first = _recordings(results, place)[0]
        truth, _ = paths_m(results.at(first, THESIS))
        panel.plot(*truth[:, :2].T, label="truth", **TRUTH)
        for (variant, colour), style in zip(SHOWN, ("-", "--"), strict=True):
            estimate = paths_m(results.at(first, variant))[1]
            panel.plot(*estimate[:, :2].T, color=colour, ls=style, lw=1.3, label=variant.label)
        panel.set_aspect("equal", adjustable="datalim")
        tidy(panel, "x, m", "y, m", place)
    panels[0].legend(fontsize=8, frameon=False)


EXPERIMENT = Experiment(
    id="E7",
    title="The complete system indoors and outdoors",
    claim="The system works indoors and outdoors, even where bricks jolt a robot on small wheels.",
    source="section 4.5, figures 4.7 to 4.10",
    setup="The thesis preset and the default settings in an office, on a meadow, on a brick court "
    f"and over loose bricks on it. It works if the drift stays below {ADEQUATE:g} % and no frame "
    "is lost.",
    size_in=(11.0, 3.2),
    jobs=jobs,
    analyse=analyse,
)
