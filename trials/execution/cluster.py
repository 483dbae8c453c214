"""Processes that run tasks: one for each core, the workers of a Dask cluster, or this process."""

import importlib.util
import logging
import os
from collections.abc import Callable, Generator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar
from uuid import uuid4

from trials.execution.cache import code_digest
from trials.execution.devices import gpus
from trials.execution.queues import OURS, started_cluster
from trials.execution.tasks import Report, Site, WorkerError

if TYPE_CHECKING:
    from distributed import Client

CONNECT_S, WORKER_S, COUNT_S = 10, 30, 5.0
"""Time that a scheduler has to answer, and to have a worker; period of counting its workers."""
LOUD = "distributed.client", "distributed.deploy", "tornado.application"
ENOUGH = 0.99
"""Ratio of the memory for a task that a worker must have: limits are rounded."""
RESERVED = 0.9
"""Ratio of the available memory that local workers may use."""
HAS_PACKAGE = (
    "any(__import__('pathlib').Path(place, 'execution/tasks.py').is_file() for found in "
    "[__import__('importlib.util').util.find_spec('trials')] if found for place in "
    "found.submodule_search_locations or ())"
)
"""Expression that a process without this package can evaluate."""
DASHBOARD = importlib.util.find_spec("bokeh") is not None

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class Workers:
    """Where tasks run.

    Attributes:
        count: Number of local processes, or of workers that a queue is asked for; None for as many
            as cores and memory allow, 0 to run tasks in this process.
        scheduler: Address of a Dask scheduler, `slurm`, `kubernetes`, or `ssh:HOST,HOST`; empty for
            this machine.
        pinned: Whether each local process, and what it starts, is confined to a core of its own.
        store: Location of fsspec where workers with caches of their own share results; empty if all
            share the folder of the command.
        log: File of JSON lines, one for each task; None for none.
        per_gpu: Most local processes for each GPU, if there are GPUs; None for no limit.
        announce: Called with the address of Dask's dashboard.
    """

    count: int | None = None
    scheduler: str = ""
    pinned: bool = False
    store: str = ""
    log: Path | None = None
    per_gpu: int | None = None
    announce: Callable[[str], None] = lambda _: None


@dataclass(frozen=True)
class Pool:
    """Executor of calls, the number of calls that it runs at once, and the site of its tasks.

    `check` raises a WorkerError if a worker, which may have joined later, cannot run tasks.
    """

    executor: Executor
    slots: Callable[[int], int]
    site: Site
    listen: Callable[[Report], None] = field(default=lambda _: None)
    check: Callable[[], None] = field(default=lambda: None)


class InThisProcess(Executor):
    """Runs calls at once."""

    def submit(
        self, function: Callable[P, R], /, *arguments: P.args, **words: P.kwargs
    ) -> Future[R]:
        """Run a call."""
        call = Future[R]()
        try:
            call.set_result(function(*arguments, **words))
        except Exception as error:
            call.set_exception(error)
        return call


def usable_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


@contextmanager
def pool_of(workers: Workers, memory_gb: float) -> Generator[Pool]:
    """Start or reach the processes that run tasks of at most so much memory each.

    Raises:
        WorkerError: If a scheduler does not answer, or has no worker with that memory.
        SettingsError: If there is no such kind of scheduler.
    """
    folder, cores = Path.cwd(), usable_cores()
    if not workers.scheduler and 0 in (workers.count, cores):
        yield Pool(InThisProcess(), lambda _: 1, Site(folder, store=workers.store))
        return
    import distributed  # noqa: F401  # sets the levels of its loggers

    for source in LOUD:  # what they log is raised below
        logging.getLogger(source).setLevel(logging.CRITICAL)
    topic = f"driftyard-{uuid4().hex}"  # other commands may use the same scheduler
    if workers.scheduler:
        with _reached(workers, memory_gb) as client:
            site = Site(folder, code_digest(), topic, store=workers.store)
            checked = client, workers.scheduler, memory_gb
            slots, check = _counted(*checked), partial(_check, *checked)
            yield replace(_pool(client, slots, workers, site), check=check)
        return
    with _local(workers, memory_gb) as (client, slots):
        yield _pool(client, slots, workers, Site(folder, "", topic, workers.pinned, workers.store))


def _pool(client: "Client", slots: Callable[[int], int], workers: Workers, site: Site) -> Pool:
    def listen(report: Report) -> None:
        client.subscribe_topic(site.topic, lambda event: report(*event[1]))

    if DASHBOARD:
        workers.announce(str(client.dashboard_link))
    return Pool(client.get_executor(pure=False), slots, site, listen)


@contextmanager
def _local(workers: Workers, memory_gb: float) -> "Generator[tuple[Client, Callable[[int], int]]]":
    """Start a cluster in this machine; its processes grow in number with the tasks."""
    import dask.config
    import psutil
    from distributed import Client, LocalCluster

    available_gb = RESERVED * psutil.virtual_memory().available / 2**30
    room = max(1, int(available_gb / memory_gb))
    most = min(usable_cores(), room, workers.count or room)
    if workers.count and not workers.pinned:
        most = workers.count
    if workers.per_gpu and gpus():
        most = min(most, workers.per_gpu * len(gpus()))
    quiet: dict[str, Any] = {
        "dashboard_address": "127.0.0.1:0",  # any free port
        "silence_logs": logging.CRITICAL,
        "threads_per_worker": 1,
        "memory_limit": round(max(available_gb, memory_gb) / most * 2**30),
    }
    with (
        dask.config.set(OURS),
        LocalCluster(n_workers=0, **quiet) as cluster,
        Client(cluster) as client,
    ):
        started = 0

        def slots(tasks: int) -> int:
            nonlocal started
            if min(most, tasks) > started:
                started = min(most, tasks)
                cluster.scale(started)
            return started

        yield client, slots


@contextmanager
def _reached(workers: Workers, memory_gb: float) -> "Generator[Client]":
    """Connect to a scheduler, or ask a queue for workers."""
    from distributed import Client
    from distributed import __version__ as version

    name = workers.scheduler
    reached = nullcontext(name)
    if "://" not in name:
        reached = started_cluster(name, workers.count or 1, memory_gb)
    with reached as target:
        try:
            client = Client(target, timeout=CONNECT_S)
        except Exception as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            said = "does not answer"
            if not isinstance(error, OSError | ValueError):
                said = f"does not answer as Dask {version} does; install the same there"
            raise WorkerError(f"scheduler {name}: {said} ({reason})") from None
        with client:
            if target is name:
                try:
                    client.wait_for_workers(1, timeout=WORKER_S)
                except TimeoutError:
                    raise WorkerError(f"scheduler {name}: has no workers") from None
                _check(client, name, memory_gb)
            yield client


def _check(
    client: "Client", name: str, memory_gb: float, addresses: list[str] | None = None
) -> None:
    """Raise a WorkerError if a scheduler or its workers lack this package, or the memory."""
    places = {"the scheduler": client.run_on_scheduler(eval, HAS_PACKAGE)}
    workers = client.run(eval, HAS_PACKAGE, workers=addresses)
    for place, found in (places | workers).items():
        if not found:
            raise WorkerError(f"scheduler {name}: {place} has no driftyard; install it there")
    known = client.scheduler_info()["workers"].values()
    limits = [x["memory_limit"] / 2**30 or float("inf") for x in known]
    if max(limits) < ENOUGH * memory_gb:
        raise WorkerError(
            f"scheduler {name}: its workers have at most {max(limits):.1f} GB each; these tasks "
            f"need {memory_gb:g} GB (`dask worker --memory-limit`)"
        )


def _counted(client: "Client", name: str, memory_gb: float) -> Callable[[int], int]:
    """Return a function that counts the workers of a cluster, and checks new ones, every COUNT_S.

    A worker without this package ends with its first task, and its nanny starts it again.
    """
    known, counted_s = set[str](), -COUNT_S

    def slots(_: int) -> int:
        nonlocal known, counted_s
        if monotonic() - counted_s > COUNT_S:
            with suppress(OSError):  # a lost scheduler is noticed by its tasks
                found = set(client.nthreads())
                if new := sorted(found - known):
                    _check(client, name, memory_gb, new)
                known, counted_s = found, monotonic()
        return max(1, len(known))

    return slots
