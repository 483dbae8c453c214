"""`driftyard stress`: a disturbance that is raised until an estimator fails."""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from sim.camera_names import DEFAULT_CAMERA
from trials.cli import console
from trials.cli.options import Camera, Distance, argument, changes, option
from trials.cli.workers import WorkersOptions
from trials.estimators.plugins.command import Command
from trials.execution.jobs import Recording, Variant, scene_label
from trials.execution.runner import NO_LABELS
from trials.report.tables import text_table
from trials.studies.stress import AXES, MAIN, Axis, Curve, Limits, Response, describe, run_drives
from trials.studies.stress import stress as find_limit
from trials.studies.stress_report import write_curves, write_page
from vo.contract.errors import SettingsError


@dataclass(frozen=True)
class SearchOptions:
    """The drives, and the search for the strength at which an estimator fails."""

    PANEL: ClassVar[str] = "Search"
    scene: str | None = option(None, "Scene of all drives.", show_default="suits the axis")
    most: float | None = option(
        None, "Largest strength.", "--max", min=0, show_default="of the axis"
    )
    points: int = option(5, "Number of strengths to begin with.", min=2)
    rounds: int = option(4, "Number of bisections after that.", min=0)
    seeds: int = option(3, "Number of drives at each strength.", min=1)
    distance: Distance = 4.0
    drift: float = option(2.0, "Drift over 1 m above which a drive fails, %.", min=0)
    lost: float = option(5.0, "Lost frames above which a drive fails, %.", min=0)
    camera: Camera = DEFAULT_CAMERA
    record: list[str] = changes("recording", "")


@dataclass(frozen=True)
class EstimatorsOptions:
    """Estimators to compare."""

    PANEL: ClassVar[str] = "Estimators"
    estimator: str = option(
        "driftyard", "driftyard, thesis, corner_flow, module:Class; several as a,b.", metavar="NAME"
    )
    command: str = option("", "Program instead, as for `driftyard run`.", metavar="CMD")
    overrides: list[str] = changes("estimator")

    @property
    def variants(self) -> list[Variant]:
        """One for each estimator, or for the program."""
        settings = tuple(self.overrides)
        if self.command:
            return [Variant(Command(self.command).name, self.estimator, settings, self.command)]
        return [Variant(name, name, settings) for name in self.estimator.split(",")]


def stress(
    search: SearchOptions,
    estimators: EstimatorsOptions,
    workers: WorkersOptions,
    axis: str = argument(
        ...,
        f"Axis: {', '.join(MAIN)}, all of these, or a disturbance; several as a,b.",
        metavar="AXIS",
    ),
    out: Path = option(Path("build/stress"), "Folder of figures and data."),
    page: Path | None = option(None, "Markdown page of all axes.", metavar="FILE"),
) -> None:
    """Raise a disturbance step by step, and find the strength at which an estimator fails."""
    studies: dict[str, dict[str, Curve]] = {}
    figures: dict[str, Path] = {}
    variants = estimators.variants
    for name, chosen in _axes(axis, search.most).items():
        studies[name] = {x.label: _search(name, chosen, x, search) for x in variants}
        figures[name] = write_curves(name, studies[name], out)
        console.out.print(f"{figures[name]}, .csv, .json\n")
    if page:
        write_page(studies, figures, shlex.join(["driftyard", *sys.argv[1:]]), page)
        console.out.print(f"{page}")


def _search(name: str, axis: Axis, variant: Variant, search: SearchOptions) -> Curve:
    scene = search.scene or axis.scene
    title = f"{variant.label}: {name} on {scene}"
    fixed = (f"drive.distance_m={search.distance:g}", *NO_LABELS)
    shared = (*fixed, *search.record)
    limits = Limits(search.drift, search.lost / 100)

    def drives(strength: float) -> list[Recording]:
        overrides, disturb = (*shared, *axis.overrides(strength)), axis.disturb(strength)
        seeds, camera = range(search.seeds), search.camera
        return [Recording(scene, seed, overrides, disturb, camera) for seed in seeds]

    with console.counting_bar(title, search.seeds * (search.points + search.rounds)) as count:

        def respond(strengths: Sequence[float]) -> list[Response]:
            found = run_drives({x: drives(x) for x in strengths}, variant, count)
            return [Response.of(x, results) for x, results in found.items()]

        curve = find_limit(axis, scene_label(scene), respond, search.points, search.rounds, limits)
    _print(curve, title)
    return curve


def _axes(names: str, most: float | None) -> dict[str, Axis]:
    chosen = list(MAIN) if names == "all" else names.split(",")
    for name in chosen:
        if name not in AXES:
            raise SettingsError(f"unknown axis {name}; valid: all, {', '.join(AXES)}")
    return {x: AXES[x] if most is None else replace(AXES[x], maximum=most) for x in chosen}


def _print(curve: Curve, title: str) -> None:
    rows: list[tuple[str, ...]] = []
    for x in curve.responses:
        drifts = " ".join("–" if np.isnan(d) else f"{d:.3f}" for d in x.drift_percent)
        failed = f"{sum(x.failed(curve.limits))} of {len(x.seeds)}"
        lost = f"{100 * np.mean(x.lost_share):.1f}"
        rows.append((f"{x.strength:.4g}", drifts, lost, failed))
    header = (curve.axis.label, "drift over 1 m, %, by drive", "lost, %", "failed")
    console.out.print(text_table(header, rows, title))
    limits = curve.limits
    console.out.print(
        f"{describe(curve)} Failed: drift over {limits.drift_percent:g} % or more than "
        f"{100 * limits.lost_share:g} % of the frames lost; the estimator fails with most drives."
    )
