"""Speed of generator, estimators, start and environments on this machine; `driftyard bench`.

The estimators run on a single core, the generator on all of them. The generator is compared with a
plain loop over `mujoco.Renderer` that makes the same left image, right image and depth of the same
drive, by the ideal camera, with the same quality. The two renderers alternate every few frames, and
the recording is timed before and after them, so that all have the same load of the machine. A drive
of 300 m is compared with one of 30 m. The estimators run in turn over five recordings, and the
default one over a long sequence. `--over DATASET` times the estimators alone, at the start and at
the end of an existing recording, and the backends of bundle adjustment on its windows.
"""

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from scenes import SCENES
from trials.estimators.choice import COMPARED
from trials.execution.progress import ProgressBar, no_progress
from trials.report.tables import text_table
from trials.studies.speed import generator
from trials.studies.speed.backends import backend_table, measure_windows
from trials.studies.speed.cameras import camera_table
from trials.studies.speed.comparison import RECORDINGS, ROUNDS, comparison_table, measure_rounds
from trials.studies.speed.cost_report import measure_costs
from trials.studies.speed.devices import device_table, measure_devices
from trials.studies.speed.drive import TimedDrive, on_cores
from trials.studies.speed.engines import engine_tables
from trials.studies.speed.environment import QUICK_STEPS, STEPS, environment_table
from trials.studies.speed.estimator import EstimatorSpeed, measure_estimator
from trials.studies.speed.generator_report import generator_tables
from trials.studies.speed.renderers import measure_renderers
from trials.studies.speed.scheduler_load import (
    QUICK_WORKERS,
    WORKERS,
    load_table,
    measure_load,
)
from trials.studies.speed.start import start_table
from vo.contract.errors import SettingsError
from vo.recordings.readers import recording_name

DISTANCE_M, FRAMES = 5.0, 40
QUICK_DISTANCE_M, QUICK_FRAMES = 1.5, 8
"""Length of the drive, and number of its frames that both renderers draw."""
LONG_SCENE, LENGTHS_M, QUICK_LENGTHS_M = "long_haul", (30.0, 300.0), (3.0, 30.0)
"""Scene and lengths of the drives that are compared by length."""
ENDURANCE_FRAMES, QUICK_ENDURANCE_FRAMES = 15_000, 600
MAX_GROWTH = "≤ 1.1"
"""Required ratio of the time of a frame in the last tenth to that in the first."""
QUANTILES = {"median": 0.5, "95th percentile": 0.95}


@dataclass(frozen=True)
class Bench:
    """What all parts of the measurement share: scene, seed, lengths, cores and a folder for files.

    The progress bar is a function that is importable by its name.
    """

    scene: str
    seed: int
    quick: bool
    cores: list[int]
    folder: Path
    bar: ProgressBar

    @property
    def drive(self) -> TimedDrive:
        """The drive that is recorded and rendered."""
        return TimedDrive(self.scene, self.seed, QUICK_DISTANCE_M if self.quick else DISTANCE_M)

    @property
    def frames(self) -> int:
        """Number of its frames that both renderers draw."""
        return QUICK_FRAMES if self.quick else FRAMES

    def recorded(self, label: str) -> Path:
        """Dataset of RECORDINGS, recorded once."""
        out = self.folder / f"recording_{list(RECORDINGS).index(label)}"
        if not out.exists():
            arguments = self.seed, self.drive.distance_m, out
            on_cores(self.cores, RECORDINGS[label].write, *arguments)
        return out


def _generation(bench: Bench) -> Iterator[Table | str]:
    cores, drive, folder, bar = bench.cores, bench.drive, bench.folder, bench.bar
    before = on_cores(cores, generator.measure_generator, drive, folder / "before", bar)
    turns = [cores[:1], cores] if len(cores) > 1 else [cores]
    rendered = {
        len(some): on_cores(some, measure_renderers, drive, bench.frames, folder, bar)
        for some in turns
    }
    after = on_cores(cores, generator.measure_generator, drive, folder / "after", bar)
    scaling = generator.measure_scaling(drive, cores[:2], folder)
    yield f"{bench.scene}, seed {bench.seed}, {drive.distance_m:g} m, camera ideal; {before.gl}"
    yield from generator_tables((before, after), rendered, scaling)
    yield (
        f"{before.frames} frames in {before.whole_s:.1f} s with scene, drive and map; left "
        f"images of both renderers differ by {rendered[1].different_grey:.2f} grey levels"
    )


def _lengths(bench: Bench) -> Iterator[Table | str]:
    lengths_m = QUICK_LENGTHS_M if bench.quick else LENGTHS_M
    drives = (TimedDrive(LONG_SCENE, bench.seed, x) for x in lengths_m)
    yield length_table(
        on_cores(bench.cores, generator.measure_lengths, *drives, bench.frames, bench.bar)
    )


def _estimators(bench: Bench) -> Iterator[Table | str]:
    measured: dict[str, dict[str, list[EstimatorSpeed]]] = {}
    for label in RECORDINGS:
        dataset = bench.recorded(label)
        measured[label] = on_cores(bench.cores[:1], measure_rounds, dataset, ROUNDS, bench.bar)
    label = next(iter(RECORDINGS))
    yield label
    yield estimator_table({name: speeds[-1] for name, speeds in measured[label].items()})
    yield comparison_table(measured)


def _endurance(bench: Bench) -> Iterator[Table | str]:
    dataset = bench.recorded(next(iter(RECORDINGS)))
    frames = QUICK_ENDURANCE_FRAMES if bench.quick else ENDURANCE_FRAMES
    name = COMPARED[0]
    measured = on_cores(bench.cores[:1], measure_estimator, name, dataset, bench.bar, frames)
    yield f"{next(iter(RECORDINGS))}, to and fro"
    yield endurance_table({name: measured})


def _start(bench: Bench) -> Iterator[Table | str]:
    dataset = bench.folder / "short"
    recording = next(iter(RECORDINGS.values()))
    on_cores(bench.cores, recording.write, bench.seed, QUICK_DISTANCE_M, dataset)
    yield start_table(dataset, bench.folder, bench.quick)


def _environments(bench: Bench) -> Iterator[Table | str]:
    yield environment_table(bench.cores, QUICK_STEPS if bench.quick else STEPS)


def _devices(bench: Bench) -> Iterator[Table | str]:
    drive = TimedDrive(bench.scene, bench.seed, QUICK_DISTANCE_M)
    yield device_table(measure_devices(drive, len(bench.cores), bench.folder / "devices"))


def _costs(bench: Bench) -> Iterator[Table | str]:
    yield from measure_costs(bench.cores, bench.quick, bench.folder, bench.bar)


def _scheduler(bench: Bench) -> Iterator[Table | str]:
    yield load_table([measure_load(x) for x in (QUICK_WORKERS if bench.quick else WORKERS)])


def _engines(bench: Bench) -> Iterator[Table | str]:
    scenes = [bench.scene] if bench.quick else list(SCENES)
    yield from engine_tables(scenes, bench.seed, bench.cores)


def _cameras(bench: Bench) -> Iterator[Table | str]:
    yield camera_table(bench.scene, bench.seed, bench.quick, bench.cores, bench.bar)


PARTS: dict[str, Callable[[Bench], Iterator[Table | str]]] = {
    "generation": _generation,
    "lengths": _lengths,
    "estimators": _estimators,
    "endurance": _endurance,
    "start": _start,
    "environments": _environments,
    "devices": _devices,
    "costs": _costs,
    "scheduler": _scheduler,
    "engines": _engines,
    "cameras": _cameras,
}
"""Parts of the measurement by name."""
ON_REQUEST = ("devices", "costs", "scheduler", "engines", "cameras")
"""Parts that are measured only if they are named: they concern many machines, GPUs or engines."""


def bench_parts(
    scene: str, seed: int, quick: bool, names: Sequence[str] = (), bar: ProgressBar = no_progress
) -> Iterator[Table | str]:
    """Measure some parts of PARTS, by default all but ON_REQUEST, or quickly; yield the report.

    The load of the machine, which others may use, stands before each part.

    Raises:
        SettingsError: If there is no such part.
    """
    if unknown := [name for name in names if name not in PARTS]:
        raise SettingsError(f"--only: unknown {', '.join(unknown)}; valid: {', '.join(PARTS)}")
    cores = sorted(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory(prefix="driftyard-bench-") as folder:
        bench = Bench(scene, seed, quick, cores, Path(folder), bar)
        for name in names or [x for x in PARTS if x not in ON_REQUEST]:
            yield f"{name}; load of the machine {os.getloadavg()[0]:.1f} on {len(cores)} cores"
            yield from PARTS[name](bench)


def bench_over(dataset: Path, bar: ProgressBar = no_progress) -> Iterator[Table | str]:
    """Measure the estimators over a dataset, on a single core; yield the report."""
    estimated = _measure_estimators(dataset, bar)
    yield recording_name(dataset)
    yield estimator_table(estimated)
    yield endurance_table(estimated)
    yield backend_table(measure_windows(dataset))


def _measure_estimators(dataset: Path, bar: ProgressBar) -> dict[str, EstimatorSpeed]:
    core = min(os.sched_getaffinity(0))
    return {x: on_cores([core], measure_estimator, x, dataset, bar) for x in COMPARED}


def length_table(cost: generator.LengthCost) -> Table:
    """Tabulate the time per frame of a short and of a long drive, and their ratio."""
    short, long = cost.short, cost.long
    part = f"images and depth, on the first {short.distance_m:g} m"
    times = (
        ("physics", short.physics_ms, long.physics_ms, ""),
        ("images with noise, and depth", short.picture_ms, long.picture_ms, ""),
        (part, short.picture_ms, cost.again_ms, ""),
        ("all", short.frame_ms, long.frame_ms, "≤ 1"),
    )
    rows = [(x, f"{a:.1f}", f"{b:.1f}", f"{b / a:.2f}", limit) for x, a, b, limit in times]
    rows.append(("frames", str(short.frames), str(long.frames), "", ""))
    a, b = (f"{x.memory_mb / 1024:.2f}" for x in (short, long))
    rows.append(("peak memory, GB", a, b, "", "< 1.5"))
    lengths = (f"{x.distance_m:g} m" for x in (short, long))
    return text_table((f"{LONG_SCENE}, CPU ms per frame", *lengths, "ratio", "required"), rows)


def estimator_table(estimated: dict[str, EstimatorSpeed]) -> Table:
    """Tabulate milliseconds by stage, with a column for each estimator."""
    speeds = list(estimated.values())
    rows = [
        (stage, *(f"{x.stage_ms[stage]:.1f}" if stage in x.stage_ms else "–" for x in speeds))
        for stage in dict.fromkeys(stage for x in speeds for stage in x.stage_ms)
    ]
    rows.append(("all, mean", *(f"{np.mean(x.frame_ms):.1f}" for x in speeds)))
    for label, q in QUANTILES.items():
        rows.append((f"all, {label}", *(f"{np.quantile(x.frame_ms, q):.1f}" for x in speeds)))
    rows.append(("frames/s, median", *(f"{1e3 / np.median(x.frame_ms):.1f}" for x in speeds)))
    return text_table(("estimation, 1 core, ms per frame", *estimated), rows)


def endurance_table(estimated: dict[str, EstimatorSpeed]) -> Table:
    """Tabulate time per frame in the first and last tenth of the sequence, and memory."""
    speeds = list(estimated.values())
    frames = len(speeds[0].frame_ms)
    tenth = max(1, frames // 10)
    rows: list[tuple[str, ...]] = []
    for label, q in QUANTILES.items():
        first, last = (
            [np.quantile(x.frame_ms[part], q) for x in speeds]
            for part in (slice(None, tenth), slice(-tenth, None))
        )
        rows.append((f"first tenth, {label}, ms", *(f"{x:.1f}" for x in first)))
        rows.append((f"last tenth, {label}, ms", *(f"{x:.1f}" for x in last)))
        ratios = (f"{b / a:.2f}" for a, b in zip(first, last, strict=True))
        rows.append((f"ratio, {MAX_GROWTH} required", *ratios))
    for label, k in (("after a tenth", tenth - 1), ("at the end", -1)):
        rows.append((f"memory {label}, GB", *(f"{x.memory_mb[k] / 1024:.2f}" for x in speeds)))
    return text_table((f"{frames} frames, by tenths", *estimated), rows)
