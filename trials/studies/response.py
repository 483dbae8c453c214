"""Drift of the baseline under every disturbance and on every scene; `driftyard response`.

Each disturbance is applied with several strengths on one scene, and each scene is driven without
disturbance, all with the same seeds. Parameters of the disturbances were chosen on seed 100. All
of it takes hours, although drives are short and have at most twelve sub-frames per exposure.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.table import Table

from scenes import SCENES
from sim.disturbances import DISTURBANCES
from trials.execution.jobs import Recording, Variant, jobs_of
from trials.execution.runner import NO_LABELS, run_jobs
from trials.report.figure import GREY, INK, RED, grid_of_panels, save_figure, tidy
from trials.report.tables import text_table
from trials.studies.stress import Limits, Response
from vo.contract.errors import SettingsError

BASELINE = Variant("corner_flow", "corner_flow")
STRENGTHS = (0.5, 1.0, 2.0)
PLACE = "brick_court"
"""Scene of the disturbances."""
PLACES = {"collision": "office", "sill": "office", "slip": "office"}
"""Scene of the disturbances that need level ground."""
LIMITS = Limits(np.inf, 0.02)
"""A drive without a drift, or with more than 2 % of its frames lost, counts as lost."""
MIN_EFFECT = 2.0
"""Smallest ratio of drifts at strength 1 and 0 of an effective disturbance."""


@dataclass(frozen=True)
class Setting:
    """Scene of some drives, with the name of a disturbance, empty for none, and its strength."""

    scene: str
    disturbance: str = ""
    strength: float = 0.0

    def recording(self, seed: int, distance_m: float, camera: str) -> Recording:
        """Return the recording of a drive."""
        disturb = f"{self.disturbance}={self.strength}" if self.disturbance else ""
        overrides = (f"drive.distance_m={distance_m:g}", *NO_LABELS, "exposure.subframes_max=12")
        return Recording(self.scene, seed, overrides, disturb, camera)


Responses = Mapping[Setting, Response]


def settings_of(only: Sequence[str]) -> list[Setting]:
    """List disturbances at all strengths, and undisturbed scenes.

    Args:
        only: Names of disturbances and scenes; all if it is empty.

    Raises:
        SettingsError: If one is unknown.
    """
    valid = [*SCENES, *DISTURBANCES]
    if unknown := [name for name in only if name not in valid]:
        raise SettingsError(f"--only: unknown {unknown[0]}; valid: {', '.join(valid)}")
    places = {name: PLACES.get(name, PLACE) for name in DISTURBANCES if not only or name in only}
    scenes = dict.fromkeys([*places.values(), *(x for x in SCENES if not only or x in only)])
    disturbed = [Setting(place, name, s) for name, place in places.items() for s in STRENGTHS]
    return [*map(Setting, scenes), *disturbed]


def measure(
    settings: Sequence[Setting],
    seeds: Sequence[int],
    distance_m: float,
    camera: str,
    progress: Callable[[object], None],
) -> Responses:
    """Record or reuse a drive for each setting and seed, and run the baseline over it."""
    drives = {x: [x.recording(seed, distance_m, camera) for seed in seeds] for x in settings}
    jobs = jobs_of([y for some in drives.values() for y in some], [BASELINE])
    results = run_jobs(jobs, progress=progress)
    return {
        x: Response.of(x.strength, [results.at(y, BASELINE) for y in some])
        for x, some in drives.items()
    }


def drift_level(response: Response) -> float:
    """Return the median drift over drives, %; infinite if most of them are lost."""
    lost = response.failed(LIMITS)
    return float(np.median(np.where(lost, np.inf, response.drift_percent)))


def scene_table(found: Responses) -> Table:
    """Tabulate the undisturbed drift on every scene, in ascending order."""
    drift = {x.scene: drift_level(r) for x, r in found.items() if not x.disturbance}
    finite = [x for x in drift.values() if np.isfinite(x)]
    ratio = max(drift.values()) / min(finite) if finite else np.nan
    rows = [(name, _percent(drift[name])) for name in sorted(drift, key=lambda x: drift[x])]
    title = f"largest over smallest drift: {ratio:.1f}"
    return text_table(("scene, undisturbed", "drift over 1 m, %"), rows, title)


def disturbance_table(found: Responses) -> Table:
    """Tabulate the drift at every strength, and the ratio at strengths 1 and 0."""
    rows: list[tuple[str, ...]] = []
    for name in _disturbances(found):
        undisturbed, *levels = map(drift_level, _curve(found, name).values())
        ratio = levels[STRENGTHS.index(1.0)] / undisturbed
        effective = "yes" if ratio >= MIN_EFFECT else "no"
        growing = "" if levels == sorted(levels) else ", not monotone"
        cells = map(_percent, (undisturbed, *levels))
        rows.append((name, PLACES.get(name, PLACE), *cells, f"{ratio:.1f}", effective + growing))
    strengths = [f"{s:g}" for s in (0, *STRENGTHS)]
    return text_table(("disturbance", "scene", *strengths, "1 over 0", "effective"), rows)


def _percent(drift: float) -> str:
    return f"{drift:.3f}" if np.isfinite(drift) else "lost"


def _disturbances(found: Responses) -> list[str]:
    return list(dict.fromkeys(x.disturbance for x in found if x.disturbance))


def _curve(found: Responses, name: str) -> dict[float, Response]:
    """Strength to the response to a disturbance; 0 is undisturbed."""
    scene = PLACES.get(name, PLACE)
    disturbed = {s: found[Setting(scene, name, s)] for s in STRENGTHS}
    return {0.0: found[Setting(scene)], **disturbed}


def draw_responses(found: Responses, out: Path) -> None:
    """Draw a panel for each disturbance: drift over strength, drives as dots, lost ones on top."""
    names = _disturbances(found)
    if not names:
        return
    drifts = [
        drift
        for response in found.values()
        for drift, lost in zip(response.drift_percent, response.failed(LIMITS), strict=True)
        if not lost
    ]
    limits = 0.7 * min(drifts, default=0.1), 2.0 * max(drifts, default=1.0)

    def draw(figure: Figure) -> None:
        panels = grid_of_panels(figure, len(names), 4, sharex=True, sharey=True)
        for panel, name in zip(panels, names, strict=True):
            _draw_curve(panel, _curve(found, name), limits)
            tidy(panel, "", "", f"{name}, {PLACES.get(name, PLACE)}")
            panel.text(
                0.03, 0.94, DISTURBANCES[name].about, fontsize=6.5, color=GREY, va="top", wrap=True,
                transform=panel.transAxes,
            )  # fmt: skip
        label = "strength of the disturbance (dashed: twice the undisturbed drift; ×: lost)"
        figure.supxlabel(label, fontsize=10)
        figure.supylabel("drift of the baseline over 1 m, %", fontsize=10)

    save_figure(out, (3.4 * min(4, len(names)), 2.7 * -(-len(names) // 4)), draw)


def _draw_curve(panel: Axes, curve: Mapping[float, Response], limits: tuple[float, float]) -> None:
    bottom, top = limits
    medians = [min(drift_level(response), top) for response in curve.values()]
    panel.axhline(MIN_EFFECT * medians[0], color=GREY, linewidth=0.8, linestyle="--")
    panel.plot(list(curve), medians, color=RED, linewidth=1.6, zorder=2)
    for strength, response in curve.items():
        for drift, lost in zip(response.drift_percent, response.failed(LIMITS), strict=True):
            y, mark = (top, "x") if lost else (drift, "o")
            panel.plot(strength, y, mark, color=INK, markersize=4, zorder=3)
    panel.set_yscale("log")
    panel.set_ylim(bottom, 1.6 * top)
