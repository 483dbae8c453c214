"""Tasks, and what a worker does with them."""

import json
import os
import pickle
import platform
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
from pydantic import TypeAdapter

from sim.graphics import GraphicsError, explain_fault, is_graphics_fault
from trials.execution.cache import CACHE, cache_path, code_digest
from trials.execution.devices import choose_gpu
from trials.execution.store import present, publish, sharing
from vo.contract.errors import DatasetError, DriftyardError
from vo.contract.files import write_text
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
        kept: Type of a result that the cache keeps as JSON; None for one that is not kept, or
            that consists of files with names of their own.
        causes: What decides the result beside arguments and sources, such as a scene of the user's.
    """

    kind: str
    name: str
    function: Callable[..., R]
    arguments: tuple[Any, ...] = ()
    kept: Any = None
    causes: tuple[str, ...] = ()

    @property
    def file(self) -> Path:
        """File in the cache of a result that is kept; its name holds a digest of all causes."""
        called = f"{self.function.__module__}.{self.function.__qualname__}"
        given = json.dumps(self.arguments, sort_keys=True, default=repr)
        label = f"{self.kind}-{self.name.replace(' ', '_').replace('/', '_')}"
        path = cache_path(CACHE, "results", label, called, given, code_digest(), *self.causes)
        return path.with_suffix(".json")

    def recall(self) -> R | None:
        """Return the result that the cache or the shared store keeps; None if there is none."""
        if self.kept is None or not present(self.file).is_file():
            return None
        content = json.loads(self.file.read_text(encoding="utf-8"))
        return TypeAdapter(self.kept).validate_python(content["result"])

    def keep(self, value: R, seconds: float) -> None:
        """Keep a result, and how it was made, in the cache and the shared store."""
        about = {
            "kind": self.kind,
            "task": self.name,
            "arguments": json.loads(json.dumps(self.arguments, default=repr)),
            "code": code_digest(),
            "host": platform.node(),
            "seconds": round(seconds, 3),
            "result": TypeAdapter(self.kept).dump_python(value, mode="json"),
        }
        write_text(self.file, json.dumps(about, indent=1) + "\n")
        publish(self.file)


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
        choose_gpu()
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
        if read.kept is not None:
            read.keep(value, monotonic() - start_s)
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
