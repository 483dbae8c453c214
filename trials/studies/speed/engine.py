"""Cost of the executor, and gain of a second worker; `driftyard bench --engine`.

Workers that run busy loops show what the machine gives to a second process: two cores twice as
much, two hyperthreads of one core much less.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter, sleep
from typing import Any

import psutil
from rich.table import Table

from trials.execution.cluster import Workers, usable_cores
from trials.execution.executor import compute, perform, using
from trials.execution.jobs import Recording, jobs_of
from trials.execution.progress import ProgressBar, counted
from trials.execution.runner import NO_LABELS, run_jobs
from trials.execution.tasks import Task
from trials.report.tables import text_table
from trials.studies.accuracy import VARIANTS

NOTHING, MANY, SLEEP_S = 10_000, 100_000, 10.0
LOOPS, DRIVES = 10_000_000, 4
SMALL = ("drive.distance_m=1.5", "rig.width_px=320", "rig.height_px=240", "rig.rate_hz=10")


def measure_engine(scene: str, bar: ProgressBar) -> Iterator[Table | str]:
    """Measure the executor on all cores; yield the report."""
    cores = usable_cores()
    yield f"{cores} logical cores; load of the machine before: {psutil.getloadavg()[0]:.1f}"
    with using(Workers(cores)), counted(bar, "executor", 3) as count:
        compute([Task("nothing", "start", sleep, (0.1,))] * cores)
        nothing_s, _ = _tasks_of_nothing(NOTHING)
        count(None)
        many_s, memory_gb = _tasks_of_nothing(MANY)
        count(None)
        sleep_s = _time(Task("nothing", "sleep", sleep, (SLEEP_S,)), 2 * cores)
        count(None)
    overhead = sleep_s / (2 * SLEEP_S) - 1
    rows = [
        (f"{NOTHING} tasks of nothing, s", f"{nothing_s:.1f}", "≤ 60"),
        (f"{MANY} tasks of nothing, s", f"{many_s:.1f}", ""),
        (f"memory of command and scheduler at {MANY} tasks, GB", f"{memory_gb:.2f}", "≤ 1"),
        (f"overhead on tasks of {SLEEP_S:g} s, %", f"{100 * overhead:.2f}", "≤ 2"),
    ]
    yield text_table(("executor", "found", "required"), rows)
    gains: dict[int, tuple[float, float]] = {}
    with counted(bar, "workers", 2) as count:
        for workers in (1, 2):
            with using(Workers(workers, pinned=True)):
                busy_s = _time(Task("nothing", "busy", _loop, (LOOPS,)), 8)
                gains[workers] = busy_s, _accuracy_s(scene)
            count(None)
    busy, accuracy = (a / b for a, b in zip(gains[1], gains[2], strict=True))
    rows = [
        ("busy loops", f"{busy:.2f}", ""),
        ("drives of `accuracy`", f"{accuracy:.2f}", "≥ 1.8 on two cores"),
        ("the latter over the former", f"{accuracy / busy:.2f}", "≥ 0.9"),
    ]
    yield text_table(("two workers over one", "found", "required"), rows)


def _tasks_of_nothing(number: int) -> tuple[float, float]:
    """Return the time of so many tasks, and the largest size of this process meanwhile, GB."""
    process, start_s, peak = psutil.Process(), perf_counter(), 0
    tasks = [Task("nothing", f"{x}", divmod, (x, 7)) for x in range(number)]
    for k, _ in enumerate(perform(tasks)):
        if k % 1000 == 0:
            peak = max(peak, process.memory_info().rss)
    return perf_counter() - start_s, peak / 2**30


def _time(task: Task[Any], number: int) -> float:
    """Return the time of equal tasks."""
    start_s = perf_counter()
    compute([task] * number)
    return perf_counter() - start_s


def _loop(count: int) -> int:
    return sum(range(count))


def _accuracy_s(scene: str) -> float:
    """Return the time of short drives that are recorded and run as by `accuracy`."""
    with tempfile.TemporaryDirectory(prefix="driftyard-bench-") as name:
        drives = [Recording(scene, seed, (*SMALL, *NO_LABELS)) for seed in range(DRIVES + 2)]
        run_jobs(jobs_of(drives[DRIVES:], VARIANTS), Path(name))  # loads, compiles
        start_s = perf_counter()
        run_jobs(jobs_of(drives[:DRIVES], VARIANTS), Path(name))
        return perf_counter() - start_s
