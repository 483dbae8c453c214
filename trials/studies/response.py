"""Drift of the baseline under every disturbance and on every scene; `driftyard response`.

Each disturbance is tried at several strengths on one scene, each scene undisturbed, all with
the same seeds; parameters of the disturbances were chosen on seed 100. It takes hours, though the
drives are short, with at most twelve sub-frames.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from trials.execution.jobs import Recording, Result, Variant
from trials.execution.runner import NO_LABELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BASELINE = Variant("corner_flow", "corner_flow")
STRENGTHS = (0.5, 1.0, 2.0)
PLACES = {"collision": "office", "sill": "office", "slip": "office"}
"""Where a disturbance is tried, if not on PLACE: these want level ground."""
PLACE = "brick_court"
QUICKER = ("exposure.subframes_max=12",)
LOST_SHARE = 0.02
"""A drive with more frames lost than this counts as lost."""


@dataclass(frozen=True)
class Response:
    """What one drive cost the baseline.

    Attributes:
        seed: Of the drive.
        drift_percent: Mean drift over 1 m; NaN if it could not be measured.
        lost_share: Of the frames.
    """

    seed: int
    drift_percent: float
    lost_share: float

    @property
    def is_lost(self) -> bool:
        """Whether there is no drift worth speaking of."""
        return self.lost_share > LOST_SHARE or not np.isfinite(self.drift_percent)


@dataclass(frozen=True)
class Setting:
    """A setting whose response is wanted.

    Attributes:
        scene: Name.
        disturbance: Name; empty for none.
        strength: Of the disturbance.
    """

    scene: str
    disturbance: str
    strength: float


def settings_of(only: Sequence[str]) -> list[Setting]:
    """List disturbances at all strengths, and undisturbed scenes.

    Args:
        only: Names of disturbances and scenes; all if it is empty.

    Raises:
        SettingsError: If one is unknown.
    """
    from scenes import SCENES
    from sim.disturbances import DISTURBANCES
    from vo.contract.errors import SettingsError

    unknown = [name for name in only if name not in SCENES and name not in DISTURBANCES]
    if unknown:
        valid = ", ".join([*SCENES, *DISTURBANCES])
        raise SettingsError(f"--only: unknown {unknown[0]}; valid: {valid}")
    wanted = [name for name in DISTURBANCES if not only or name in only]
    places = dict.fromkeys(PLACES.get(name, PLACE) for name in wanted)
    scenes = dict.fromkeys([*places, *(name for name in SCENES if not only or name in only)])
    disturbed = [Setting(PLACES.get(n, PLACE), n, s) for n in wanted for s in STRENGTHS]
    return [*(Setting(name, "", 0.0) for name in scenes), *disturbed]


def drive(setting: Setting, seed: int, distance_m: float) -> Recording:
    """Describe the recording of a setting."""
    disturb = f"{setting.disturbance}={setting.strength}" if setting.disturbance else ""
    overrides = (f"drive.distance_m={distance_m:g}", *NO_LABELS, *QUICKER)
    return Recording(setting.scene, seed, overrides, disturb)


def respond(result: Result) -> Response:
    """Summarize the result of one drive."""
    return Response(result.job.recording.seed, result.drift_percent, result.lost_share)


def level(responses: Sequence[Response]) -> float:
    """Median drift over drives, %; infinite if most of them are lost."""
    return float(np.median([np.inf if r.is_lost else r.drift_percent for r in responses]))


def scene_table(found: Mapping[Setting, Sequence[Response]]) -> Table:
    """Lay out the undisturbed drift on every scene, and its spread."""
    rows = {t.scene: level(r) for t, r in found.items() if not t.disturbance}
    finite = [x for x in rows.values() if np.isfinite(x)]
    spread = max(rows.values()) / min(finite) if finite else np.nan
    table = Table("scene, undisturbed", "drift over 1 m, %", title=f"spread {spread:.1f}-fold")
    for name, drift in sorted(rows.items(), key=lambda item: item[1]):
        table.add_row(name, _percent(drift))
    return table


def disturbance_table(found: Mapping[Setting, Sequence[Response]]) -> Table:
    """Lay out the drift at every strength, and how many times the undisturbed it is at 1."""
    table = Table("disturbance", "on", "0", *(f"{s:g}" for s in STRENGTHS), "1 over 0", "bites")
    for name in dict.fromkeys(t.disturbance for t in found if t.disturbance):
        scene = PLACES.get(name, PLACE)
        calm = level(found[Setting(scene, "", 0.0)])
        levels = [level(found[Setting(scene, name, s)]) for s in STRENGTHS]
        ratio = levels[STRENGTHS.index(1.0)] / calm
        bites = "yes" if ratio >= 2 else "no"
        grows = "" if levels == sorted(levels) else ", not monotone"
        cells = [_percent(calm), *map(_percent, levels), f"{ratio:.1f}", bites + grows]
        table.add_row(name, scene, *cells)
    return table


def _percent(drift: float) -> str:
    return f"{drift:.3f}" if np.isfinite(drift) else "lost"


def draw(found: Mapping[Setting, Sequence[Response]], out: Path) -> None:
    """Draw one panel for each disturbance: drift over strength, drives as dots, losses on top."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from sim.disturbances import DISTURBANCES
    from vo.contract.files import replacing

    names = list(dict.fromkeys(t.disturbance for t in found if t.disturbance))
    if not names:
        return
    columns = min(4, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(3.4 * columns, 2.7 * rows), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    drifts = [r.drift_percent for rs in found.values() for r in rs if not r.is_lost]
    top, bottom = 2.0 * max(drifts, default=1.0), 0.7 * min(drifts, default=0.1)
    for panel, name in zip(panels, names, strict=False):
        scene = PLACES.get(name, PLACE)
        curve = {0.0: found[Setting(scene, "", 0.0)]}
        curve |= {s: found[Setting(scene, name, s)] for s in STRENGTHS}
        _draw_curve(panel, curve, (bottom, top))
        panel.set_title(f"{name}, {scene}", fontsize=9, weight="bold", loc="left")
        panel.text(
            0.03,
            0.94,
            DISTURBANCES[name].about,
            fontsize=6.5,
            color="#555555",
            transform=panel.transAxes,
            va="top",
            wrap=True,
        )
    for panel in panels[len(names) :]:
        panel.set_axis_off()
    figure.supxlabel(
        "strength of the disturbance (dashed: twice the undisturbed drift; ×: lost)", fontsize=10
    )
    figure.supylabel("drift of the baseline over 1 m, %", fontsize=10)
    with replacing(out) as partial:
        figure.savefig(partial, format="png")


def _draw_curve(
    panel: "Axes", curve: Mapping[float, Sequence[Response]], limits: tuple[float, float]
) -> None:
    bottom, top = limits
    strengths = list(curve)
    medians = [min(level(responses), top) for responses in curve.values()]
    panel.axhline(2 * medians[0], color="#bbbbbb", linewidth=0.8, linestyle="--")
    panel.plot(strengths, medians, color="#d9541e", linewidth=1.6, zorder=2)
    for strength, responses in curve.items():
        for r in responses:
            y, mark = (top, "x") if r.is_lost else (r.drift_percent, "o")
            panel.plot(strength, y, mark, color="#2b3036", markersize=4, zorder=3)
    panel.set_yscale("log")
    panel.set_ylim(bottom, 1.6 * top)
    panel.grid(which="both", color="#eeeeee", linewidth=0.6)
    panel.tick_params(labelsize=7)
