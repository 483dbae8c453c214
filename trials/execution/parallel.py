"""Parallel map over processes: one for each usable core, each with one thread."""

import multiprocessing
import os
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any, TypeVar

from vo.contract.remarks import print_remarks

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables of the linear algebra libraries, which read them when they are loaded.
Processes on all cores with several threads each would be slower than with one."""

R = TypeVar("R")


def usable_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


def map_parallel(
    function: Callable[..., R], calls: Sequence[tuple[Any, ...]], processes: int | None = None
) -> Generator[tuple[int, R]]:
    """Call a function with each of several tuples of arguments, in processes of one thread each.

    The function is importable by its name; arguments and results are pickled. If a number of
    processes is given, each of them, and what it starts, is confined to a core of its own.

    Yields:
        Row of the call and its result, in the order in which they finish.

    Raises:
        Exception: The first that a call raises; calls that have not begun are dropped.
    """
    spawn = multiprocessing.get_context("spawn")
    count = max(1, min(usable_cores(), len(calls), processes or len(calls)))
    started = (spawn.Value("i", 0),) if processes else ()
    with _single_threaded(), ProcessPoolExecutor(count, spawn, _prepare, started) as pool:
        jobs = {pool.submit(function, *arguments): k for k, arguments in enumerate(calls)}
        try:
            for job in as_completed(jobs):
                yield jobs[job], job.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)  # the other results would not be used
            raise


def _prepare(started: Any = None) -> None:
    """Make this process print remarks, and end when its parent does, even if that is killed.

    A counter of the processes confines each to one core.
    """
    print_remarks()
    if started is not None:
        with started.get_lock():
            os.sched_setaffinity(0, {sorted(os.sched_getaffinity(0))[started.value]})
            started.value += 1

    def watch() -> None:
        parent = multiprocessing.parent_process()
        assert parent is not None
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _single_threaded() -> Generator[None]:
    """Make processes that are spawned meanwhile use one thread for linear algebra."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
