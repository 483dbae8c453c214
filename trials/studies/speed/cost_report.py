"""Report of costs: what was measured, the model and its errors, and drives on several workers."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

from rich.table import Table

from trials.execution.cluster import Workers
from trials.execution.executor import compute, using
from trials.execution.progress import ProgressBar, counted
from trials.execution.tasks import Task
from trials.report.tables import text_table
from trials.studies.speed.cost_model import CostModel, million_frames
from trials.studies.speed.costs import (
    BASE,
    CHECKS,
    DEFAULT_LABELS,
    IMAGES,
    LABELS,
    Conditions,
    Cost,
    design,
    measure_drives,
    measure_scene,
)
from trials.studies.speed.drive import on_cores

WORKER_COUNTS, DRIVES = (1, 2), 4
"""Numbers of workers that record so many equal drives each, to check the model."""


def measure_costs(
    cores: list[int], quick: bool, folder: Path, bar: ProgressBar
) -> Iterator[Table | str]:
    """Measure all rows, fit the model, check it; yield the report."""
    by_scene: dict[str, list[Conditions]] = {}
    for x in (*design(quick), *CHECKS):
        by_scene.setdefault(x.scene, []).append(x)
    costs: dict[Conditions, Cost] = {}
    with counted(bar, "scenes", len(by_scene)) as count:
        for scene, rows in by_scene.items():
            costs |= on_cores(cores[:1], measure_scene, rows, folder / f"cost_{scene}")
            count(None)
    yield _cost_table(costs)
    model = CostModel.fit({x: costs[x] for x in design(quick)})
    yield _scene_table(model)
    yield _label_table(model)
    yield _camera_table(model)
    yield _check_table(model, {x: costs[x] for x in CHECKS})
    yield _million_table(model)
    yield _worker_table(model)


def _cost_table(costs: Mapping[Conditions, Cost]) -> Table:
    rows = [
        (str(x), f"{cost.frame_ms:.1f}", f"{cost.frame_kb:.0f}", f"{cost.drive_s:.1f}",
         f"{cost.memory_gb:.2f}")
        for x, cost in costs.items()
    ]  # fmt: skip
    return text_table(("recording", "CPU ms a frame", "kB a frame", "CPU s a drive", "GB"), rows)


def _scene_table(model: CostModel) -> Table:
    """Tabulate what a scene costs by megapixels."""
    rows = [
        (scene, f"{x.images.fixed:.1f}", f"{x.images.per_mpx:.0f}", f"{x.labels.fixed:.1f}",
         f"{x.labels.per_mpx:.0f}", f"{x.drive_s:.1f}")
        for scene, x in model.scenes.items()
    ]  # fmt: skip
    header = (
        "a frame", "CPU ms of images", "and per Mpx", "of all labels", "and per Mpx",
        "CPU s a drive",
    )  # fmt: skip
    return text_table(header, rows)


def _label_table(model: CostModel) -> Table:
    """Tabulate the kilobytes of each part at one megapixel, and their exponents."""
    rows: list[tuple[str, ...]] = []
    for part in (IMAGES, *LABELS):
        found = {scene: x.kb[part] for scene, x in model.scenes.items()}
        least, most = (f(found, key=lambda x: found[x].per_mpx) for f in (min, max))
        exponents = sorted(x.exponent for x in found.values())
        rows.append(
            (
                part, f"{100 * model.shares[part]:.0f}" if part in model.shares else "",
                f"{found[BASE].per_mpx:.0f}", f"{found[least].per_mpx:.0f} ({least})",
                f"{found[most].per_mpx:.0f} ({most})",
                f"{exponents[0]:.2f} to {exponents[-1]:.2f}",
            )
        )  # fmt: skip
    header = ("part", "% of labels' CPU", f"kB at 1 Mpx, {BASE}", "least", "most", "exponent")
    return text_table(header, rows)


def _camera_table(model: CostModel) -> Table:
    rows = [
        (name, f"{x.fixed:.1f}", f"{x.per_mpx:.0f}", f"{model.image_kb[name]:.2f}")
        for name, x in model.cameras.items()
    ]
    return text_table(("camera", "CPU ms a frame", "and per Mpx", "kB of images, ratio"), rows)


def _check_table(model: CostModel, costs: Mapping[Conditions, Cost]) -> Table:
    """Tabulate predictions for rows that the model is not fitted to."""
    rows = [
        (str(x), f"{model.frame_ms(x):.1f}", f"{cost.frame_ms:.1f}",
         f"{100 * (model.frame_ms(x) / cost.frame_ms - 1):+.0f} %",
         f"{model.frame_kb(x):.0f}", f"{cost.frame_kb:.0f}",
         f"{100 * (model.frame_kb(x) / cost.frame_kb - 1):+.0f} %")
        for x, cost in costs.items()
    ]  # fmt: skip
    header = (
        "not fitted", "predicted ms", "measured", "error", "predicted kB", "measured", "error",
    )  # fmt: skip
    return text_table(header, rows)


def _million_table(model: CostModel) -> Table:
    """Tabulate a million frames of 640 x 480 pixels, with the default labels and with none."""
    rows: list[tuple[str, ...]] = []
    for scene in model.scenes:
        cells: list[str] = []
        for labels in ((), DEFAULT_LABELS, LABELS):
            hours, gb = million_frames(model, Conditions(scene, labels=labels))
            cells += [f"{hours:.1f}", f"{gb:.0f}"]
        rows.append((scene, *cells))
    header = (
        "a million frames of 640 × 480", "core-hours", "GB", "with depth and disparity", "GB",
        "with all labels", "GB",
    )  # fmt: skip
    return text_table(header, rows)


def _worker_table(model: CostModel) -> Table:
    """Record drives on one and on two workers; tabulate prediction and measurement."""
    conditions = Conditions(size_px=(320, 240), labels=DEFAULT_LABELS)
    rows: list[tuple[str, ...]] = []
    for workers in WORKER_COUNTS:
        with using(Workers(workers, pinned=True)), TemporaryDirectory() as folder:
            compute([_task(conditions, folder, -1 - k) for k in range(workers)])  # loads
            start_s = perf_counter()
            found = compute([_task(conditions, folder, k) for k in range(DRIVES)])
            wall_s = perf_counter() - start_s
        frames = sum(frames for frames, _ in found)
        used_s = sum(used_s for _, used_s in found)
        drives_s = DRIVES * model.scenes[BASE].drive_s
        predicted_s = drives_s + frames * model.frame_ms(conditions) / 1e3
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
    (cost,) = measure_drives([conditions], Path(folder) / f"{seed}", abs(seed))
    return cost.frames, process_time() - start_s
