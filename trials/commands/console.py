"""What the commands share on the terminal: progress bars and the score table."""

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager

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

from trials.score import Score

out = Console(highlight=False, soft_wrap=True)
err = Console(stderr=True, highlight=False)


class _RateColumn(ProgressColumn):
    """Items per second."""

    def render(self, task: Task) -> Text:
        return Text(f"{task.speed:.1f}/s" if task.speed else "–/s", style="progress.data.speed")


@contextmanager
def progress_bar(title: str) -> Generator[Callable[[int, int], None]]:
    """Show a bar on stderr; yields what to call with (done, in total)."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _RateColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err) as progress:
        task = progress.add_task(title, total=None)

        def update(done: int, total: int) -> None:
            progress.update(task, completed=done, total=total)

        yield update


def score_table(title: str, scores: Sequence[Score]) -> Table:
    """Lay out one row per run."""
    table = Table(title=title, title_justify="left", caption_justify="left")
    table.add_column("estimator")
    for heading in (
        "drift 1 m\n%",
        "rotation\n°/m",
        "end\nm",
        "end\n%",
        "ATE first\nm",
        "ATE SE(3)\nm",
        "ATE Sim(3)\nm",
        "weak\n",
        "lost\n",
        "ms per\nframe",
    ):
        table.add_column(heading, justify="right")
    for x in scores:
        ate = [x.ate_m[k].rmse if k in x.ate_m else None for k in ("first_pose", "se3", "sim3")]
        table.add_row(
            x.estimator,
            _number(x.drift_1m.mean_percent if x.drift_1m else None, 3),
            _number(x.drift_1m.mean_deg_per_m if x.drift_1m else None, 4),
            _number(x.end_m, 3),
            _number(x.end_percent, 2),
            *(_number(value, 4) for value in ate),
            str(x.statuses.get("weak", "–")),
            str(x.statuses.get("lost", "–")),
            _number(x.frame_ms, 1),
        )
    return table


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"
