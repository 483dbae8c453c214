"""`driftyard drive`: closed-loop navigation trials by source of localization."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar

from sim.batch import custom_fingerprint
from sim.camera_names import DEFAULT_CAMERA
from trials.cli import console
from trials.cli.options import Camera, Disturb, LiveViewOptions, SceneName, changes, option
from trials.cli.workers import WorkersOptions
from trials.execution.cache import source_digest
from trials.execution.executor import compute
from trials.execution.tasks import Task
from trials.gym.env.policies import NavigatorPolicy
from trials.gym.env.settings import NavSettings
from trials.gym.studies import planning as planned
from trials.gym.studies import trial_results as results
from trials.gym.studies.trial_runner import run_world
from trials.report.figure import save_figure
from trials.report.tables import text_table
from trials.view.target import Target, require_viewer, target_of
from vo.contract.errors import SettingsError
from vo.contract.files import write_text
from vo.contract.settings import parse_overrides, validated


@dataclass(frozen=True)
class WorldOptions:
    """The worlds, and what is driven in them."""

    PANEL: ClassVar[str] = "Worlds and trials"
    worlds: int = option(10, "Number of layouts of the scene.", min=1)
    runs: int = option(1, "Number of starts and goals in each.", min=1)
    seed: int = option(0, "Random seed of the first layout.", min=0)
    trial: list[str] = option(
        [],
        "Change a setting of `driftyard settings navigation`, or an option of the scene.",
        metavar="KEY=VALUE",
    )
    overrides: list[str] = changes("recording")
    camera: Camera = DEFAULT_CAMERA
    disturb: Disturb = ""

    @property
    def layouts(self) -> range:
        """Random seeds of the worlds."""
        return range(self.seed, self.seed + self.worlds)

    def options(self, scene: str) -> dict[str, Any]:
        """Options of the environment; keys that are none of its settings go to the scene."""
        given = parse_overrides(self.trial, "--trial")
        own = {key: value for key, value in given.items() if key in NavSettings.model_fields}
        return {
            "scene": scene,
            "rate_hz": 10.0,
            "camera": self.camera,
            "disturb": self.disturb,
            "settings": parse_overrides(self.overrides),
            **own,
            "scene_options": {key: value for key, value in given.items() if key not in own},
            "observe": NavigatorPolicy.NEEDS,
        }


@dataclass(frozen=True)
class PlanningOptions:
    """Static against dynamic planning."""

    PANEL: ClassVar[str] = "Planning with a floor plan, compared"
    planning: str | None = option(
        None, "Ways of planning: static, dynamic, or static,dynamic.", metavar="A,B"
    )
    ideal_depth: bool = option(
        False, "Measure depth by rays instead of the cameras.", "--ideal-depth"
    )


@dataclass(frozen=True)
class OutputOptions:
    """Files of the trials."""

    PANEL: ClassVar[str] = "Files"
    out: Path | None = option(None, "JSON lines, one a trial.", metavar="FILE")
    keep: Path | None = option(
        None, "Folder for a film and a dataset of every trial.", metavar="FOLDER"
    )
    figure: Path | None = option(None, "PNG of success and collisions over drift.", metavar="FILE")


@dataclass(frozen=True)
class TrialViewOptions(LiveViewOptions):
    """A view of every trial."""

    save: Path | None = option(
        None, "Folder for a file of every trial, for `rerun FILE.rrd`.", metavar="FOLDER"
    )
    view: bool = option(False, "Show every trial in Rerun's viewer while it is driven.", "--view")

    @property
    def target(self) -> Target | None:
        """The folder, or a viewer, which is started if none is there yet."""
        if self.live is False:
            return None
        if self.save:
            require_viewer()
            return Target(self.save)
        found = target_of(self.to)
        if found.url is None:
            from trials.view.stream import open_window

            found = Target(url=open_window())
        return found


def drive(
    scene: SceneName,
    worlds: WorldOptions,
    planning: PlanningOptions,
    files: OutputOptions,
    viewer: TrialViewOptions,
    workers: WorkersOptions,
    localization: str = option(
        "truth,wheels,vo",
        "Sources: truth, drift:PERCENT, wheels, vo, an estimator, or module:Class.",
        metavar="A,B,C",
    ),
) -> None:
    """Drive to goals in many worlds with each source of localization, and compare.

    Sources such as drift:5,drift:20,drift:80 add that drift, for a curve of sensitivity. With
    --planning, ways of planning are compared, as in worlds with --trial dynamics=blocked_aisles.
    """
    options = worlds.options(scene)
    sources = [word.strip() for word in localization.split(",") if word.strip()]
    if not sources:
        raise SettingsError("--localization: names no source")
    for source in sources:
        validated(NavSettings, {**options, "localization": source})
    validated(NavSettings, options).recorded(worlds.seed)  # refuses now what a worker would refuse
    title = f"{scene}, {worlds.worlds} worlds x {worlds.runs}"
    if planning.planning is not None:
        if files.keep or files.figure or viewer.live:
            raise SettingsError("--planning goes with neither --keep nor --figure nor a viewer")
        _drive_planned(title, options, sources, worlds, planning, files.out)
        return
    trials = _driven(options, sources, worlds, files, viewer.target)
    by_source = {x: [t for t in trials if t.localization == x] for x in sources}
    _print_summary(title, by_source, results.METRICS)
    if files.figure:
        save_figure(files.figure, (8.0, 3.4), lambda f: results.draw_sensitivity(f, by_source))


def _driven(
    options: Mapping[str, Any],
    sources: Sequence[str],
    worlds: WorldOptions,
    files: OutputOptions,
    view: Target | None,
) -> list[results.TrialResult]:
    """Drive what the cache does not hold yet; returns all trials by world."""
    kept = None if files.keep or view else list[results.TrialResult]
    causes = _causes(options, sources, worlds)
    tasks = [
        Task("trial", f"world {k}", run_world, x, kept, causes)
        for k in worlds.layouts
        for x in [(options, sources, k, worlds.runs, files.keep, view)]
    ]
    with console.counting_bar("worlds", len(tasks)) as count:
        trials = list(chain.from_iterable(compute(tasks, count)))
    if files.out:
        write_text(files.out, results.json_lines(trials))
    return trials


def _causes(
    options: Mapping[str, Any], sources: Sequence[str], worlds: WorldOptions
) -> tuple[str, ...]:
    """Return what decides trials beside options and our sources: a scene and plug-ins."""
    settings = validated(NavSettings, options)
    plugins = [source_digest((), x.partition(":")[0]) for x in sources if ":" in x]
    return custom_fingerprint(settings.scene, settings.recorded(worlds.seed)), *plugins


def _drive_planned(
    title: str,
    options: Mapping[str, Any],
    sources: Sequence[str],
    worlds: WorldOptions,
    planning: PlanningOptions,
    out: Path | None,
) -> None:
    """Drive the same trials with each way of planning, and print a table."""
    ways = planned.parse_planning(planning.planning or "")
    trials: list[planned.PlanningResult] = []
    layouts, runs, ideal = worlds.layouts, worlds.runs, planning.ideal_depth
    with console.counting_bar("worlds", len(layouts) * len(sources)) as count:
        for source in sources:
            with_source = {**options, "localization": source}
            calls = [(with_source, ways, k, runs, ideal) for k in layouts]
            kept, causes = list[planned.PlanningResult], _causes(options, [source], worlds)
            tasks = [
                Task("trial", f"world {x[2]}", planned.run_world, x, kept, causes) for x in calls
            ]
            trials += chain.from_iterable(compute(tasks, count))
    if out:
        write_text(out, results.json_lines(trials))
    columns = {
        f"{way}, {x}": [t for t in trials if (t.planning, t.localization) == (way, x)]
        for x in sources
        for way in ways
    }
    _print_summary(title, columns, planned.METRICS)


def _print_summary(
    title: str, columns: Mapping[str, Sequence[Any]], metrics: results.Metrics[Any]
) -> None:
    """Print one column for each group of trials."""
    found = {name: results.summarize(trials, metrics) for name, trials in columns.items()}
    rows = [(row, *(x[row] for x in found.values())) for row in next(iter(found.values()))]
    console.out.print(text_table((title, *found), rows))
