"""What many workers cost the command and the scheduler in it, by simulated workers that sleep.

The workers are real ones of Dask with a thread each, many in one process, so that a thousand fit
into one machine. They register, beat and answer over TCP as others do, but render nothing.
"""

import asyncio
import logging
from collections.abc import Generator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from multiprocessing.context import SpawnProcess
from tempfile import TemporaryDirectory
from time import perf_counter, process_time, sleep
from typing import Any

import psutil
from distributed import Client, LocalCluster, Worker
from rich.table import Table

from trials.report.tables import text_table
from trials.studies.speed.drive import SPAWN

WORKERS, QUICK_WORKERS = (1, 100, 1000), (1, 50)
EACH = 125
"""Workers in a process."""
TASK_S, ROUNDS, IDLE_S = 10.0, 2, 5.0
PER_WORKER_S = 0.02
"""Least time of a task for each worker, so that they do not ask for more than two cores give."""


@dataclass(frozen=True)
class SchedulerLoad:
    """Processor time of the command with the scheduler in it.

    Attributes:
        task_ms: For each task.
        idle: Ratio of a core that idle workers take.
        wall_s: Wall time of ROUNDS tasks of `task_s` for each worker.
        memory_gb: Largest size seen.
    """

    workers: int
    task_s: float
    task_ms: float
    idle: float
    wall_s: float
    memory_gb: float

    @property
    def most(self) -> float:
        """Workers that one command serves with tasks of 10 s, from the processor time alone."""
        each = self.task_ms / 1e3 / 10 + self.idle / self.workers
        return 1 / each


def _serve(address: str, count: int, folder: str) -> None:
    """Run workers until their scheduler ends; what they write goes to a folder."""
    rules: dict[str, Any] = {"nthreads": 1, "memory_limit": 0, "dashboard": False}

    async def run() -> None:
        made = [Worker(address, local_directory=folder, **rules) for _ in range(count)]
        await asyncio.gather(*made)
        await asyncio.gather(*(x.finished() for x in made))

    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    asyncio.run(run())


@contextmanager
def _workers(count: int) -> Generator[Client]:
    with (
        TemporaryDirectory(prefix="driftyard-bench-") as folder,
        ExitStack() as stack,
        LocalCluster(n_workers=0, dashboard_address=None, silence_logs=logging.CRITICAL) as cluster,
        Client(cluster) as client,
    ):
        for first in range(0, count, EACH):
            process = SPAWN.Process(
                target=_serve,
                args=(cluster.scheduler_address, min(EACH, count - first), folder),
            )
            process.start()
            stack.callback(_end, process)
        client.wait_for_workers(count, timeout=300)
        yield client


def _end(process: SpawnProcess) -> None:
    process.join(10)  # its workers end with the scheduler
    process.kill()
    process.join()


def measure_load(count: int) -> SchedulerLoad:
    """Send tasks that sleep to simulated workers, as many at once as there are workers."""
    task_s = max(1.0, min(TASK_S, PER_WORKER_S * count))
    with _workers(count) as client:
        start_s = process_time()
        sleep(IDLE_S)
        idle = (process_time() - start_s) / IDLE_S
        executor = client.get_executor(pure=False)
        wall_s, start_s, left = perf_counter(), process_time(), ROUNDS * count
        running: set[Future[None]] = set()
        while left or running:
            while left and len(running) < count:
                running.add(executor.submit(sleep, task_s))
                left -= 1
            _, running = wait(running, return_when=FIRST_COMPLETED)
        used_s = process_time() - start_s
        wall_s = perf_counter() - wall_s
        memory_gb = psutil.Process().memory_info().rss / 2**30
    task_ms = 1e3 * max(used_s - idle * wall_s, 0.0) / (ROUNDS * count)
    return SchedulerLoad(count, task_s, task_ms, idle, wall_s, memory_gb)


def load_table(loads: list[SchedulerLoad]) -> Table:
    """Tabulate the load by the number of workers."""
    rows = [
        (
            str(x.workers), f"{x.task_s:g}", f"{x.wall_s:.1f}", f"{ROUNDS * x.task_s:g}",
            f"{x.task_ms:.1f}", f"{100 * x.idle:.1f}", f"{x.memory_gb:.2f}", f"{x.most:.0f}",
        )
        for x in loads
    ]  # fmt: skip
    header = (
        "workers", "task, s", "wall, s", "ideal", "CPU ms a task", "idle, % of a core", "GB",
        "most workers at 10 s a task",
    )  # fmt: skip
    return text_table(header, rows)
