"""Work on all cores: one process a core, each with one thread."""

import multiprocessing
import os
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any, TypeVar

PROCESSES = 2
"""At a time; figures in milliseconds are slower for it than those of `make bench`."""

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Of linear algebra, read when it is loaded: two processes with two threads each get in each
other's way more than they help."""

R = TypeVar("R")


def spread(
    function: Callable[..., R], calls: Sequence[tuple[Any, ...]]
) -> Generator[tuple[int, R]]:
    """Call a function with each of some tuples of arguments, PROCESSES at a time.

    Args:
        function: Importable by its name; whatever it gets and returns is pickled.
        calls: Arguments of each call.

    Yields:
        Row of the call and its result, in the order in which they finish.

    Raises:
        Exception: The first that a call raises; calls that have not begun are dropped.
    """
    spawn = multiprocessing.get_context("spawn")
    with _single_threaded(), ProcessPoolExecutor(PROCESSES, spawn, _end_with_parent) as pool:
        jobs = {pool.submit(function, *arguments): k for k, arguments in enumerate(calls)}
        try:
            for job in as_completed(jobs):
                yield jobs[job], job.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)  # the others would be for nothing
            raise


def _end_with_parent() -> None:
    """Let this process end when the one that made it does, however that ends."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        assert parent is not None
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _single_threaded() -> Generator[None]:
    """Let processes that are spawned meanwhile load their linear algebra with one thread."""
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
