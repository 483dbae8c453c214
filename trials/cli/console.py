"""Terminal output that commands share: progress bars and tables."""

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import contextmanager
from functools import partial

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

from trials.execution.progress import Update, counted

out = Console(highlight=False, soft_wrap=True)
wrapped = Console(highlight=False)
"""Breaks long lines at the width of the terminal; `out` leaves that to the terminal."""
err = Console(stderr=True, highlight=False)


class _RateColumn(ProgressColumn):
    """Items per second."""

    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:.1f}/s" if task.speed else "–/s", style="progress.data.speed")


def _progress(*unit: ProgressColumn) -> Progress:
    first = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    columns = (*first, *unit, _RateColumn(), TimeRemainingColumn())
    return Progress(*columns, console=err, disable=not err.is_terminal)


@contextmanager
def progress_bar(label: str) -> Generator[Update]:
    """Show a bar on stderr if that is a terminal; yields its update (done, total)."""
    with _progress() as progress:
        task = progress.add_task(label, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)


@contextmanager
def stage_bar() -> Generator[Callable[[str, int, int], None]]:
    """Show a bar of what is being done; yields its update (what, done, total)."""
    with _progress() as progress:
        task = progress.add_task("", total=None)
        yield lambda what, done, total: progress.update(
            task, description=what, completed=done, total=total
        )


counting_bar = partial(counted, progress_bar)
"""Shows a bar of (label, total) that advances by one with every call of what it yields."""


@contextmanager
def batch_bar(
    datasets: int,
) -> Generator[tuple[Callable[[str, int, int], None], Callable[[str, int], None]]]:
    """Show one bar for many datasets that are recorded at once: datasets, frames, rate, time left.

    Yields:
        Functions to call with (dataset, frames done, frames in total), and with a finished dataset
        and the number of failures.
    """
    done: dict[str, int] = {}
    total: dict[str, int] = {}
    finished: set[str] = set()
    failures = 0
    with _progress(TextColumn("frames")) as progress:
        task = progress.add_task("", total=None)

        def show() -> None:
            mean = sum(total.values()) / len(total) if total else 0
            expected = round(sum(total.values()) + mean * (datasets - len(total)))
            label = f"{len(finished)}/{datasets} datasets" + f", {failures} failed" * bool(failures)
            frames = sum(done.values())
            progress.update(task, description=label, completed=frames, total=expected or None)

        def advance(dataset: str, frames: int, of: int) -> None:
            done[dataset], total[dataset] = frames, of
            show()

        def finish(dataset: str, failed: int) -> None:
            nonlocal failures
            failures = failed
            finished.add(dataset)
            done[dataset] = total.get(dataset, 0)
            show()

        yield advance, finish


def print_table(
    header: Sequence[str], rows: Iterable[Sequence[str]], title: str | None = None
) -> None:
    """Print rows of text without a frame, all columns to the left."""
    made = Table(*header, box=None, title=title, title_justify="left")
    for row in rows:
        made.add_row(*row)
    out.print(made)
