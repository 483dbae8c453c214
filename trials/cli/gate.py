"""`driftyard gate`: check an estimator, update the baseline, plan its size, show the history."""

from dataclasses import asdict, dataclass
from math import inf, log1p
from pathlib import Path
from typing import ClassVar

import typer

from sim.camera_names import DEFAULT_CAMERA
from trials.cli import console
from trials.cli.options import (
    AnyEstimatorOptions,
    Camera,
    Distance,
    Disturb,
    argument,
    changes,
    option,
)
from trials.cli.workers import WorkersOptions
from trials.execution.cache import CACHE
from trials.execution.recording_settings import parse_scenes
from trials.gate import reports, trends
from trials.gate.baseline import Design, Rules, write_baseline
from trials.gate.comparison import Comparison, compare, make_baseline
from trials.gate.drive_table import write_checked_drives
from trials.gate.history import append_record, check_history, read_history, record_of
from trials.gate.statistics import MIN_DEGREES, degrees_of_freedom
from trials.report.columns import check_columns
from trials.report.figure import save_figure
from trials.studies.gate_power import CASES, TESTS, resampled, simulate
from vo.contract.errors import SettingsError
from vo.contract.files import known_suffix, write_text
from vo.contract.settings import validated

EXIT = {"pass": 0, "regress": 1, "undecided": 3}
"""Exit status of each verdict; 2 is bad input, as for every command."""


@dataclass(frozen=True)
class BaselineOptions:
    """A baseline, and how its sequences are obtained."""

    PANEL: ClassVar[str] = "Baseline"
    baseline: Path = option(..., "JSON file of the baseline.", metavar="FILE")
    cache: Path = option(CACHE, "Folder of recordings.")


@dataclass(frozen=True)
class ComparisonOptions(BaselineOptions):
    """A baseline to compare with."""

    accept: str = option("", "Differences from the baseline to accept: datasets, platform or both.")

    def compare(self, estimator: AnyEstimatorOptions) -> Comparison:
        """Run an estimator over the sequences of the baseline and decide, as `compare`."""
        accepted = [name for name in self.accept.split(",") if name]
        choice = estimator.choice
        return compare(self.baseline, choice, accepted, self.cache, console.counting_bar)


@dataclass(frozen=True)
class ReportOptions:
    """Files of the result."""

    PANEL: ClassVar[str] = "Files of the result"
    json_file: Path | None = option(None, "All figures as JSON.", "--json", metavar="FILE")
    markdown: Path | None = option(None, "Comment for a pull request.", metavar="FILE")
    junit: Path | None = option(None, "JUnit XML.", metavar="FILE")
    drive_table: Path | None = option(
        None, "Table of one row for each drive, .parquet or .csv.", metavar="FILE"
    )
    history: Path | None = option(
        None, "History that the check is appended to, for `gate history`.", metavar="FILE.jsonl"
    )
    commit: str = option(
        "", "Commit of this check in the history.", metavar="REV", show_default="HEAD of Git here"
    )

    def check(self) -> None:
        """Raise DriftyardError for files that cannot be written, before the estimator runs."""
        if self.history is not None:
            check_history(self.history)
        elif self.commit:
            raise SettingsError(f"--commit {self.commit}: needs --history")
        if self.drive_table is not None:
            check_columns(self.drive_table)


def gate_check(
    baseline: ComparisonOptions,
    estimator: AnyEstimatorOptions,
    report: ReportOptions,
    workers: WorkersOptions,
) -> None:
    """Decide whether an estimator drifts more than the baseline over the same sequences.

    Exit status: 0 pass, 1 regress, 3 undecided, 2 bad input.
    """
    report.check()
    found = baseline.compare(estimator)
    for file, written in (
        (report.json_file, reports.as_json),
        (report.markdown, reports.as_markdown),
        (report.junit, reports.as_junit),
    ):
        if file is not None:
            write_text(file, written(found))
    if report.drive_table is not None:
        write_checked_drives(report.drive_table, found)
    if report.history is not None:
        append_record(report.history, record_of(found, report.commit))
    console.print_table(reports.HEADER, reports.rows(found))
    if by_scene := reports.scene_rows(found):
        console.print_table(reports.SCENE_HEADER, by_scene)
    for line in [*reports.notes(found), reports.headline(found)]:
        console.out.print(line, markup=False)
    raise typer.Exit(EXIT[found.decision.verdict.value])


def gate_history(
    files: list[Path] = argument(
        ..., "Files that `gate check --history` wrote, or folders of them.", metavar="FILE..."
    ),
    last: int | None = option(None, "Number of the newest checks.", show_default="all", min=1),
    figure: Path | None = option(None, "Figure of all figures and scenes, PNG.", metavar="FILE"),
) -> None:
    """Print and draw the checks of a gate over its commits, with trends.

    A trend is the median change of a figure from one check to the next, over the newest checks of
    the same sequences and estimator; those of scenes are printed if drift rises or falls there.
    Scenes in the table are those that regressed.
    """
    if figure is not None:
        known_suffix(figure, (".png",))
    records = read_history(files)
    records = records if last is None else records[-last:]
    console.print_table(trends.HEADER, trends.rows(records))
    console.out.print(trends.NOTE, markup=False)
    found = [*trends.trends(records), *trends.scene_trends(records)]
    for line in found or [f"no trend: fewer than {trends.MIN_CHECKS} checks of the same sequences"]:
        console.out.print(str(line), markup=False)
    if figure is not None:
        save_figure(figure, trends.figure_size_in(records), lambda x: trends.draw(x, records))
        console.out.print(f"{figure}", markup=False)


def gate_plan(
    baseline: ComparisonOptions,
    estimator: AnyEstimatorOptions,
    workers: WorkersOptions,
    change: str = argument(..., "Increase of drift to find, such as 5%.", metavar="PERCENT"),
) -> None:
    """Compute how many scenes or seeds it takes to find an increase of drift.

    The estimator runs over the sequences of the baseline; the answer follows from how much the
    differences vary between and within scenes.
    """
    try:
        percent = float(change.strip().removesuffix("%"))
    except ValueError:
        percent = inf
    if not 0.1 <= percent <= 1000:
        raise SettingsError(f"PERCENT {change}: expected a change from 0.1 % to 1000 %, such as 5%")
    line = reports.plan_line(baseline.compare(estimator), log1p(percent / 100))
    console.out.print(line, markup=False)


@dataclass(frozen=True)
class DesignOptions:
    """The sequences of a baseline."""

    PANEL: ClassVar[str] = "Sequences"
    scenes: str = option(
        "", "Scenes to drive through, or all; required without recordings.", metavar="A,B,C"
    )
    recording: list[Path] = option(
        [], "Recording with true poses, which stands for a scene; may be repeated.", metavar="PATH"
    )
    seeds: int = option(2, "Number of sequences of each scene.", min=1)
    first_seed: int = option(0, "Random seed of the first.", min=0)
    distance: Distance = 4.0
    camera: Camera = DEFAULT_CAMERA
    disturb: Disturb = ""
    record: list[str] = changes("recording", "")

    @property
    def design(self) -> Design:
        """The sequences as the baseline stores them; SettingsError if a scene is unknown."""
        content = {
            "scenes": parse_scenes(self.scenes) if self.scenes or not self.recording else [],
            "recordings": list(map(str, self.recording)),
            "seeds": self.seeds,
            "first_seed": self.first_seed,
            "camera": self.camera,
            "disturb": self.disturb,
            "overrides": [f"drive.distance_m={self.distance:g}", *self.record],
        }
        return validated(Design, content)


@dataclass(frozen=True)
class RuleOptions:
    """The rules of the decision."""

    PANEL: ClassVar[str] = "Rules of the decision"
    reference: str = option(
        "corner_flow", "Estimator that frame times are divided by, so that machines compare."
    )
    level: float = option(0.05, "False alarm rate, and error rate of each confidence bound.")
    drift_tolerance: float = option(
        0.005,
        "Regress if the lower bound of the relative increase of drift exceeds this.",
        "--tolerance",
    )
    drift_margin: float = option(
        0.1, "Pass if the upper bound of the relative increase of drift is below.", "--margin"
    )
    time_margin: float = option(
        0.25, "The same for frame time, as tolerance and margin; 0 disables it."
    )
    nees_margin: float = option(0.5, "The same for the NEES of covariances; 0 disables it.")

    @property
    def rules(self) -> Rules:
        """The rules as the baseline stores them; SettingsError if a value is not accepted."""
        content = asdict(self)
        del content["reference"]
        return validated(Rules, content)


def gate_update(
    baseline: BaselineOptions,
    estimator: AnyEstimatorOptions,
    design: DesignOptions,
    rules: RuleOptions,
    workers: WorkersOptions,
) -> None:
    """Run an estimator over many sequences and write its results as the baseline."""
    path, bar = baseline.baseline, console.counting_bar
    choice, sequences, limits = estimator.choice, design.design, rules.rules
    made = make_baseline(choice, rules.reference, limits, sequences, baseline.cache, bar)
    write_baseline(path, made)
    lost = sum(x.is_lost for x in made.measured)
    console.out.print(
        f"{path}: {made.estimator} on {len(made.sequences)} sequences, {lost} of them lost",
        markup=False,
    )
    if degrees_of_freedom(made.scenes) < MIN_DEGREES:
        console.err.print(f"{path}: too few sequences to decide anything; see docs/gate.md")


def gate_power(
    repetitions: int = option(200, "Number for each case.", min=20),
    seed: int = option(0, "Random seed of all draws.", min=0),
    result: list[Path] = option(
        [], "Also draw from a JSON result of `gate check`; may be repeated.", metavar="FILE"
    ),
    tests: bool = option(False, "Also print the rates of other statistical tests."),
) -> None:
    """Simulate how often the gate raises a false alarm, and how often it finds +10 % of drift.

    A false alarm is a regression for a candidate whose drift grew by exactly the tolerance. A
    weakened estimator drifts 60 % more and loses one sequence more.
    """
    cases = [*CASES, *(resampled(path) for path in result)]
    with console.counting_bar("simulating", 3 * repetitions * len(cases)) as count:
        found = simulate(cases, repetitions, seed, TESTS if tests else {}, count)
    header = (
        "case",
        "seeds",
        "false alarms, %",
        "10 % found, %",
        "promised, %",
        "weakened found, %",
    )
    rows = [
        (x.case.name, str(x.case.seeds), x.alarms, x.found, f"{100 * x.case.power:.0f}", x.weakened)
        for x in found
    ]
    console.out.print(f"{repetitions} repetitions (95 % interval)")
    console.print_table(header, rows)
    if tests:
        console.out.print("other tests: false alarms / found, %")
        console.print_table(("case", *TESTS), [(x.case.name, *x.others) for x in found])
