"""Report of costs: what was measured, the model and its errors, and drives on several workers."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import numpy as np
from rich.table import Table

from scenes import SCENES
from trials.execution.cluster import Workers
from trials.execution.executor import compute, using
from trials.execution.progress import ProgressBar, counted
from trials.execution.tasks import Task
from trials.report.tables import text_table
from trials.studies.speed.costs import (
    BASE,
    CHECKS,
    DEFAULT_LABELS,
    Conditions,
    Cost,
    CostModel,
    design,
    measure_cost,
    million_frames,
    relative_errors,
)
from trials.studies.speed.drive import on_cores

WORKER_COUNTS, DRIVES = (1, 2), 4
"""Numbers of workers that record so many equal drives each, to check the model."""


@dataclass(frozen=True)
class Models:
    """Models of milliseconds, of kilobytes of a frame, and the mean of seconds before the first."""

    cpu: CostModel
    size: CostModel
    drive_s: float


def measure_costs(
    cores: list[int], quick: bool, folder: Path, bar: ProgressBar
) -> Iterator[Table | str]:
    """Measure all rows, fit the models, check them; yield the report."""
    rows = [*design(quick), *CHECKS]
    costs: dict[Conditions, Cost] = {}
    with counted(bar, "costs", len(rows)) as count:
        for number, x in enumerate(rows):
            costs[x] = on_cores(cores[:1], measure_cost, x, folder / f"cost_{number}")
            count(None)
    yield _cost_table(costs)
    fitted = {x: costs[x] for x in design(quick)}
    models = Models(
        CostModel.fit({x: cost.frame_ms for x, cost in fitted.items()}),
        CostModel.fit({x: cost.frame_kb for x, cost in fitted.items()}),
        float(np.mean([x.drive_s for x in costs.values()])),
    )
    yield _line_table(models)
    yield _check_table(models, {x: costs[x] for x in CHECKS})
    yield _million_table(models, [x for x in SCENES if x in models.cpu.scenes])
    yield _worker_table(models)


def _cost_table(costs: Mapping[Conditions, Cost]) -> Table:
    rows = [
        (str(x), f"{cost.frame_ms:.1f}", f"{cost.frame_kb:.0f}", f"{cost.drive_s:.1f}",
         f"{cost.memory_gb:.2f}")
        for x, cost in costs.items()
    ]  # fmt: skip
    return text_table(("recording", "CPU ms a frame", "kB a frame", "CPU s a drive", "GB"), rows)


def _line_table(models: Models) -> Table:
    """Tabulate the lines of the models."""
    rows = [
        (name, f"{cpu.fixed:.1f}", f"{cpu.per_mpx:.0f}", f"{size.fixed:.0f}", f"{size.per_mpx:.0f}")
        for of_cpu, of_size in (
            (models.cpu.scenes, models.size.scenes),
            (models.cpu.extra, models.size.extra),
        )
        for (name, cpu), size in zip(of_cpu.items(), of_size.values(), strict=True)
    ]
    return text_table(("a frame", "CPU ms", "and per Mpx", "kB", "and per Mpx"), rows)


def _check_table(models: Models, costs: Mapping[Conditions, Cost]) -> Table:
    """Tabulate predictions for rows that the models are not fitted to."""
    times = {x: cost.frame_ms for x, cost in costs.items()}
    sizes = {x: cost.frame_kb for x, cost in costs.items()}
    errors = zip(
        times, relative_errors(models.cpu, times), relative_errors(models.size, sizes), strict=True
    )
    rows = [
        (str(x), f"{models.cpu.of(x):.1f}", f"{times[x]:.1f}", f"{100 * time:+.0f} %",
         f"{100 * size:+.0f} %")
        for x, time, size in errors
    ]  # fmt: skip
    header = ("not fitted", "predicted ms", "measured ms", "error", "error of bytes")
    return text_table(header, rows)


def _million_table(models: Models, scenes: list[str]) -> Table:
    """Tabulate a million frames of 640 x 480 pixels, with the default labels and with none."""
    rows: list[tuple[str, ...]] = []
    for scene in scenes:
        cells: list[str] = []
        for labels in ((), DEFAULT_LABELS):
            conditions = Conditions(scene, (640, 480), labels)
            hours, gb = million_frames(models.cpu, models.size, conditions)
            cells += [f"{hours:.1f}", f"{gb:.0f}"]
        rows.append((scene, *cells))
    header = (
        "a million frames of 640 × 480", "core-hours", "GB", "with depth and disparity", "GB",
    )  # fmt: skip
    return text_table(header, rows)


def _worker_table(models: Models) -> Table:
    """Record drives on one and on two workers; tabulate prediction and measurement."""
    conditions = Conditions(BASE, labels=DEFAULT_LABELS)
    rows: list[tuple[str, ...]] = []
    for workers in WORKER_COUNTS:
        with using(Workers(workers, pinned=True)), TemporaryDirectory() as folder:
            compute([_task(conditions, folder, -1 - k) for k in range(workers)])  # loads
            start_s = perf_counter()
            found = compute([_task(conditions, folder, k) for k in range(DRIVES)])
            wall_s = perf_counter() - start_s
        frames = sum(frames for frames, _ in found)
        used_s = sum(used_s for _, used_s in found)
        predicted_s = DRIVES * models.drive_s + frames * models.cpu.of(conditions) / 1e3
        rows.append(
            (
                str(workers), f"{predicted_s:.1f}", f"{used_s:.1f}",
                f"{100 * (predicted_s / used_s - 1):+.0f} %", f"{predicted_s / workers:.1f}",
                f"{wall_s:.1f}",
            )
        )  # fmt: skip
    header = ("workers", "predicted CPU s", "measured", "error", "predicted wall s", "measured")
    return text_table(header, rows)


def _task(conditions: Conditions, folder: str, seed: int) -> Task[tuple[int, float]]:
    return Task("recording", f"drive {seed}", record_timed, (conditions, folder, seed))


def record_timed(conditions: Conditions, folder: str, seed: int) -> tuple[int, float]:
    """Record a drive; return its frames and the processor time."""
    start_s = process_time()
    cost = measure_cost(conditions, Path(folder) / f"{seed}", abs(seed))
    return cost.frames, process_time() - start_s
