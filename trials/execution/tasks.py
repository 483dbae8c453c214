"""Tasks, and what a worker does with them."""

import os
import pickle
import resource
import socket
import threading
import traceback
from collections.abc import Callable, Sequence
from contextlib import chdir, nullcontext
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any, Generic, TypeVar

import cloudpickle

from sim.graphics import GraphicsError, explain_fault, is_graphics_fault
from trials.execution.cache import code_digest
from trials.execution.store import sharing
from vo.contract.errors import DatasetError, DriftyardError
from vo.contract.remarks import print_remarks

R = TypeVar("R")

Report = Callable[[str, int, int], None]
"""Takes the name of a task, its steps done and all its steps."""


class WorkerError(DriftyardError):
    """A scheduler or worker that is missing, lost or of another version."""


@dataclass(frozen=True)
class Site:
    """What a task needs to know of the command that sent it.

    Attributes:
        folder: Working directory.
        code: Digest of the sources that a worker must have; empty for local ones.
        pinned: Whether the worker is confined to a core.
        store: Location where results are shared; workers elsewhere then stay in their own folder.
        topic: Of Dask's events for reports of progress; empty in the process of the command.
    """

    folder: Path
    code: str = ""
    topic: str = ""
    pinned: bool = False
    store: str = ""
    report: Report | None = None


REPORT_PERIOD_S = 0.5

_reporting = ("", Site(Path()))
"""Name and site of the task that this process runs."""
_one_at_a_time = threading.Lock()
"""OpenGL and the working directory belong to the process, whose worker may have more threads."""


@dataclass(frozen=True)
class Task(Generic[R]):
    """A call of a function that is importable by its name; arguments and result are pickled.

    Attributes:
        kind: Of MEMORY_GB.
        name: In errors, reports and logs.
    """

    kind: str
    name: str
    function: Callable[..., R]
    arguments: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Reply:
    """What a worker returns for a task: the fields of its Outcome."""

    value: Any
    error: Exception | None
    seconds: float
    memory_gb: float
    worker: str


class UnusableWorkerError(WorkerError):
    """A worker that no task should run on."""


def work(tasks: Sequence[bytes], site: Site) -> list[bytes]:
    """Run pickled tasks in a worker, in the command's folder; return their pickled replies.

    Dask itself would wait forever for what cannot be pickled or unpickled.
    """
    address = socket.gethostname()
    if site.topic:
        from distributed import get_worker

        print_remarks()
        address = get_worker().address
        if site.code and site.code != code_digest():
            error = UnusableWorkerError(f"worker {address}: has other code; install this version")
            return [pickle.dumps(Reply(None, error, 0.0, 0.0, address))] * len(tasks)
        if site.pinned:
            cores = sorted(os.sched_getaffinity(0))
            if len(cores) > 1:
                os.sched_setaffinity(0, {cores[int(get_worker().name) % len(cores)]})
    elsewhere = site.code and site.store
    with _one_at_a_time, nullcontext() if elsewhere else chdir(site.folder), sharing(site.store):
        return [_reply(task, site, address) for task in tasks]


def _reply(task: bytes, site: Site, address: str) -> bytes:
    """Run a pickled task; return its pickled result or error."""
    global _reporting
    start_s, value, error = monotonic(), None, None
    try:
        read: Task[Any] = pickle.loads(task)
        _reporting = (read.name, site)
        value = read.function(*read.arguments)
    except Exception as raised:
        error = _portable(raised, address)
    memory_gb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    costs = (monotonic() - start_s, memory_gb, address)
    try:
        reply = cloudpickle.dumps(Reply(value, error, *costs))
        pickle.loads(reply)
    except Exception as problem:  # whatever its class makes of it
        error = RuntimeError(f"{error or 'the result cannot be pickled'} ({problem})")
        reply = pickle.dumps(Reply(None, error, *costs))
    return reply


def _portable(error: Exception, address: str) -> Exception:
    """Return an error for another process; a defect keeps its traceback as a note."""
    if is_graphics_fault(error):
        return GraphicsError(f"{address}: no OpenGL: {explain_fault(error)}")
    if isinstance(error, OSError) and error.filename is not None:
        return DatasetError(f"{error.filename}: {error.strerror}")
    if isinstance(error, ModuleNotFoundError):
        return WorkerError(f"{address}: cannot import {error.name}, which the task needs")
    if not isinstance(error, DriftyardError):
        error.add_note(f"on {address}:\n{''.join(traceback.format_exception(error))}")
    return error


def report_steps() -> Callable[[int, int], None]:
    """Return what the running task may call with the number of its steps done and of all."""
    name, site = _reporting
    reported_s = -REPORT_PERIOD_S

    def report(done: int, total: int) -> None:
        nonlocal reported_s
        if done != total and monotonic() - reported_s < REPORT_PERIOD_S:
            return
        reported_s = monotonic()
        if site.report:
            site.report(name, done, total)
        elif site.topic:
            from distributed import get_worker

            get_worker().log_event(site.topic, (name, done, total))

    return report
