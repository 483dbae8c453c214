"""What the commands share on the terminal: progress bars and the score table."""

import itertools
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from trials.evaluation.alignment import Alignment
from trials.evaluation.score import Score

out = Console(highlight=False, soft_wrap=True)
err = Console(stderr=True, highlight=False)


class _RateColumn(ProgressColumn):
    """Items per second."""

    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:.1f}/s" if task.speed else "–/s", style="progress.data.speed")


@contextmanager
def progress_bar(title: str) -> Generator[Callable[[int, int], None]]:
    """Show a bar on stderr if that is a terminal; yields what to call with (done, in total)."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _RateColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err, disable=not err.is_terminal) as progress:
        task = progress.add_task(title, total=None)

        def update(done: int, total: int) -> None:
            progress.update(task, completed=done, total=total)

        yield update


@contextmanager
def counting_bar(label: str, total: int) -> Generator[Callable[[object], None]]:
    """Show a progress bar that advances by one with every call, whatever it is called with."""
    done = itertools.count(1)
    with progress_bar(label) as progress:
        yield lambda _: progress(next(done), total)


@contextmanager
def fleet_bar(
    datasets: int,
) -> Generator[tuple[Callable[[Path, int, int], None], Callable[[Path], None]]]:
    """Show one bar for many datasets that are made at once: datasets, frames, rate, time left.

    Yields:
        What to call with (dataset, frames done, frames in total), and with a finished dataset.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("frames"),
        _RateColumn(),
        TimeRemainingColumn(),
    )
    done: dict[Path, int] = {}
    total: dict[Path, int] = {}
    finished: set[Path] = set()
    with Progress(*columns, console=err, disable=not err.is_terminal) as progress:
        task = progress.add_task("", total=None)

        def show() -> None:
            mean = sum(total.values()) / len(total) if total else 0
            expected = round(sum(total.values()) + mean * (datasets - len(total)))
            label = f"{len(finished)}/{datasets} datasets"
            frames = sum(done.values())
            progress.update(task, description=label, completed=frames, total=expected or None)

        def advance(dataset: Path, frames: int, of: int) -> None:
            done[dataset], total[dataset] = frames, of
            show()

        def finish(dataset: Path) -> None:
            finished.add(dataset)
            done[dataset] = total.get(dataset, 0)
            show()

        yield advance, finish


def score_table(title: str, scores: Sequence[Score]) -> Table:
    """Lay out one column per run, so that the table fits a narrow terminal."""
    table = Table("", *(x.estimator for x in scores), title=title, title_justify="left")
    for column in table.columns[1:]:
        column.justify = "right"
    for label, figure in FIGURES.items():
        table.add_row(label, *(figure(x) for x in scores))
    return table


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _ate(score: Score, alignment: Alignment) -> str:
    spread = score.ate_m.get(alignment.value)
    return _number(spread.rmse if spread else None, 4)


FIGURES: dict[str, Callable[[Score], str]] = {
    "drift over 1 m, mean, %": lambda x: _number(x.drift_1m and x.drift_1m.mean_percent, 3),
    "drift over 1 m, median, %": lambda x: _number(x.drift_1m and x.drift_1m.median_percent, 3),
    "rotation over 1 m, °/m": lambda x: _number(x.drift_1m and x.drift_1m.mean_deg_per_m, 4),
    "end point, m": lambda x: _number(x.end_m, 3),
    "end point, % of path": lambda x: _number(x.end_percent, 2),
    "ATE, first pose, m": lambda x: _ate(x, Alignment.FIRST_POSE),
    "ATE, SE(3), m": lambda x: _ate(x, Alignment.SE3),
    "ATE, Sim(3), m": lambda x: _ate(x, Alignment.SIM3),
    "path, m": lambda x: _number(x.path_m, 2),
    "frames": lambda x: str(x.frames),
    "weak": lambda x: str(x.statuses.get("weak", "–")),
    "lost": lambda x: str(x.statuses.get("lost", "–")),
    "ms per frame, median": lambda x: _number(x.frame_ms, 1),
}
"""The rows of the score table."""
