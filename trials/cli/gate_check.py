"""`driftyard gate check`: an estimator against a baseline, with a verdict."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import typer

from trials.cli import console
from trials.cli.options import AnyEstimatorOptions, option
from trials.execution.cache import CACHE
from trials.gate.baseline import MISMATCHES, read_baseline
from trials.gate.comparison import Comparison, compare
from trials.gate.reports import write_reports
from trials.gate.tables import HEADER, headline, notes, rows
from vo.contract.errors import SettingsError

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
        """Run an estimator over the sequences of the baseline and decide.

        Raises:
            DriftyardError: If baseline, sequences, platform or estimator are wrong.
        """
        accepted = [name for name in self.accept.split(",") if name]
        for name in accepted:
            if name not in MISMATCHES:
                raise SettingsError(f"--accept: unknown {name}; valid: {', '.join(MISMATCHES)}")
        choice, known = estimator.choice, read_baseline(self.baseline)
        bar = console.counting_bar
        return compare(self.baseline, known, choice, accepted, self.cache, bar)


@dataclass(frozen=True)
class ReportOptions:
    """Files of the result."""

    PANEL: ClassVar[str] = "Files of the result"
    json_file: Path | None = option(None, "All figures as JSON.", "--json", metavar="FILE")
    markdown: Path | None = option(None, "Comment for a pull request.", metavar="FILE")
    junit: Path | None = option(None, "JUnit XML.", metavar="FILE")


def gate_check(
    baseline: ComparisonOptions, estimator: AnyEstimatorOptions, report: ReportOptions
) -> None:
    """Decide whether an estimator drifts more than the baseline over the same sequences.

    Exit status: 0 pass, 1 regress, 3 undecided, 2 bad input.
    """
    found = baseline.compare(estimator)
    files = {"json": report.json_file, "markdown": report.markdown, "junit": report.junit}
    write_reports(found, files)
    console.print_table(HEADER, rows(found))
    for line in [*notes(found), headline(found)]:
        console.out.print(line, markup=False)
    raise typer.Exit(EXIT[found.decision.verdict.value])
