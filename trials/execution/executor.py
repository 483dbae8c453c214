"""The executor of all studies: independent tasks in processes, on a cluster, or in this process.

A task is a call without side effects but complete files, so that it runs anywhere, again if its
worker is lost, and in any order. Tasks are sent as workers become free: none waits at a worker,
where the loss of the worker would count against it. Short ones are sent several at a time.
"""

import json
import pickle
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from statistics import median
from typing import Any, Generic, TypeVar

import cloudpickle

from sim.graphics import GraphicsError
from trials.execution.cluster import Pool, Workers, pool_of
from trials.execution.location import StoreError
from trials.execution.store import Store, sharing
from trials.execution.tasks import Reply, Report, Site, Task, UnusableWorkerError, WorkerError, work

R = TypeVar("R")

MEMORY_GB = {"recording": 1.5, "run": 1.0, "trial": 1.5, "check": 1.5}
"""Largest resident size of a worker by kind of task, as measured (docs/scale.md)."""
BATCH_S, MAX_BATCH = 1.0, 1000
"""Time of the short tasks that are sent at once, and their number."""


@dataclass(frozen=True)
class Outcome(Generic[R]):
    """Result of a task, or the error that it raised; time and largest size of its process."""

    row: int
    task: Task[R]
    value: R | None
    error: Exception | None
    seconds: float = 0.0
    memory_gb: float = 0.0
    worker: str = ""

    def result(self) -> R:
        """Return the result, or raise the error."""
        if self.error is not None:
            raise self.error
        return self.value  # type: ignore[return-value]


@dataclass
class _Started:
    """Processes that are started for the first task, and used by all until the command ends."""

    workers: Workers
    _stack: ExitStack = field(default_factory=ExitStack)
    _pool: Pool | None = None

    def pool(self, tasks: Sequence[Task[Any]]) -> Pool:
        """Return the processes, started now unless they are there."""
        if self._pool is None:
            memory_gb = max(MEMORY_GB.get(x.kind, 0.5) for x in tasks)
            self._pool = self._stack.enter_context(pool_of(self.workers, memory_gb))
        return self._pool

    def close(self) -> None:
        """End the processes."""
        self._pool = None
        self._stack.close()


DEFAULT = Workers()
_current: ContextVar[_Started | None] = ContextVar("started", default=None)


@contextmanager
def using(workers: Workers) -> Generator[None]:
    """Let all tasks of the block run there; processes start with the first task.

    Raises:
        StoreError: If the store cannot be used.
    """
    if workers.store:
        Store(workers.store).check()
    started = _Started(workers)
    token = _current.set(started)
    try:
        with sharing(workers.store):
            yield
    finally:
        _current.reset(token)
        started.close()


def compute(tasks: Sequence[Task[R]], progress: Callable[[R], object] | None = None) -> list[R]:
    """Run tasks and return their results in the order of the tasks, whichever ends first.

    Raises:
        WorkerError: If the worker of a task was lost in every try, after all others have ended; or
            as `perform`.
        Exception: The first that a task raises; tasks that have not begun are dropped.
    """
    found: dict[int, R] = {}
    lost: list[Exception] = []
    for outcome in perform(tasks):
        if isinstance(outcome.error, WorkerError):
            lost.append(outcome.error)
            continue
        found[outcome.row] = outcome.result()
        if progress:
            progress(found[outcome.row])
    if lost:
        raise WorkerError("; ".join(map(str, lost)))
    return [found[row] for row in range(len(tasks))]


def perform(tasks: Sequence[Task[R]], report: Report | None = None) -> Iterator[Outcome[R]]:
    """Run tasks; yield outcomes as they end.

    Args:
        tasks: Independent calls.
        report: Receives the name of a task and its progress, of those that call `report_steps`.

    Raises:
        WorkerError: If the scheduler does not answer, is lost, or has workers with other code.
        GraphicsError: If a worker has no OpenGL.
    """
    if not tasks:
        return
    started = _current.get()
    if started is None:
        with using(DEFAULT):
            yield from perform(tasks, report)
        return
    missing: list[tuple[int, Task[R]]] = []
    for row, task in enumerate(tasks):
        if (value := task.recall()) is None:
            missing.append((row, task))
        else:
            yield Outcome(row, task, value, None)
    if not missing:
        return
    pool = started.pool(tasks)
    if report is not None:
        pool.listen(report)
    site = pool.site if pool.site.topic else replace(pool.site, report=report)
    for outcome in _outcomes(missing, pool, site, started.workers.scheduler):
        _log(started.workers, outcome)
        if isinstance(outcome.error, UnusableWorkerError | GraphicsError | StoreError):
            raise outcome.error
        yield outcome


def _outcomes(
    tasks: Iterable[tuple[int, Task[R]]], pool: Pool, site: Site, scheduler: str
) -> Iterator[Outcome[R]]:
    """Send tasks as slots become free, and again one by one if several were lost at once."""
    waiting, alone = deque(tasks), deque[tuple[int, Task[R]]]()
    running: dict[Future[list[bytes]], list[tuple[int, Task[R]]]] = {}
    recent_s: deque[float] = deque(maxlen=20)
    try:
        while waiting or alone or running:
            slots = pool.slots(len(waiting) + len(alone) + len(running))
            while (waiting or alone) and len(running) < slots:
                size = 1 if alone else _batch_size(recent_s, len(waiting), slots)
                source = alone or waiting
                batch = [source.popleft() for _ in range(min(size, len(source)))]
                sent = [cloudpickle.dumps(task) for _, task in batch]
                call = pool.executor.submit(work, sent, site)
                running[call] = batch
            ended, _ = wait(running, return_when=FIRST_COMPLETED)
            for call in ended:
                batch = running.pop(call)
                try:
                    replies: list[Reply] = [pickle.loads(x) for x in call.result()]
                except CancelledError:
                    where = scheduler or "of the local cluster"
                    raise WorkerError(
                        f"scheduler {where}: lost; the same command continues from here"
                    ) from None
                except Exception as error:
                    pool.check()
                    if len(batch) > 1:
                        alone.extend(batch)
                    else:
                        yield Outcome(*batch[0], None, _stated(batch[0][1], error))
                    continue
                recent_s.extend(x.seconds for x in replies)
                for (row, task), reply in zip(batch, replies, strict=True):
                    yield Outcome(row, task, **vars(reply))
    finally:
        for call in running:
            call.cancel()


def _batch_size(recent_s: Sequence[float], waiting: int, slots: int) -> int:
    """Return how many tasks take about BATCH_S, at most a fair share of those that wait."""
    if len(recent_s) < slots:
        return 1
    fit = int(BATCH_S / max(median(recent_s), 1e-9))
    return max(1, min(fit, MAX_BATCH, waiting // (2 * slots)))


def _stated(task: Task[Any], error: Exception) -> Exception:
    """Return the error of a task whose worker was lost, or could not even read it."""
    from distributed import KilledWorker

    if isinstance(error, KilledWorker):
        return WorkerError(
            f"{task.name}: its worker was lost in each of {error.allowed_failures + 1} tries "
            "(killed, or out of memory?); the task is set aside"
        )
    return error


def _log(workers: Workers, outcome: Outcome[Any]) -> None:
    """Append a line of JSON about a task that has ended."""
    if workers.log is None:
        return
    entry = {
        "time": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "kind": outcome.task.kind,
        "task": outcome.task.name,
        "status": "failed" if outcome.error else "done",
        "reason": " ".join(str(outcome.error or "").split()),
        "seconds": round(outcome.seconds, 3),
        "memory_gb": round(outcome.memory_gb, 3),
        "worker": outcome.worker,
    }
    workers.log.parent.mkdir(parents=True, exist_ok=True)
    with workers.log.open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry) + "\n")
