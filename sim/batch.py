"""Many datasets: pure tasks, spread over the cores or a cluster by Dask.

A task is (scene, settings) to a dataset folder and depends on nothing else, so that it may run
anywhere that sees the folder, and again if its worker was lost. A folder that is there and was
made with the same settings is finished work; it is not done again. Until it is finished it has a
hidden name beside the final one, which whoever makes the dataset next removes.
"""

import logging
import os
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import chdir, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenes import build_scene
from scenes.scene import Scene
from sim.progress import Progress
from sim.record import Recording, record
from sim.settings import RecordSettings, recorded_settings
from sim.world.random_streams import stream
from vo.contract.dataset import MANIFEST, read_manifest
from vo.contract.errors import DatasetError, DriftyardError

if TYPE_CHECKING:
    from distributed import Client

TOPIC = "driftyard-frames"
REPORT_PERIOD_S = 0.5
RETRIES = 2
"""How often a local cluster tries a dataset again after its worker was lost."""
LOST = "its worker was lost, and so was every other that tried (killed, or out of memory?)"

_turn = threading.Lock()
"""Held by who makes a dataset: GL is bound to a process, and so is the working directory."""


@dataclass(frozen=True)
class Task:
    """One dataset to make.

    Attributes:
        scene: Name in the registry, MJCF file or `module:function`.
        settings: Resolved.
        out: Folder.
    """

    scene: str
    settings: RecordSettings
    out: Path

    @property
    def is_done(self) -> bool:
        """Whether the folder is a dataset of this task already.

        Raises:
            DatasetError: If something else is in its place.
        """
        if not self.out.exists():
            return False
        if not (self.out / MANIFEST).is_file():
            raise DatasetError(f"{self.out}: in the way, and not a dataset")
        made = read_manifest(self.out)
        same = recorded_settings(made["settings"]) == self.settings
        if not same or made["scene"]["source"] != self.scene:
            raise DatasetError(f"{self.out}: a dataset made with other settings is in the way")
        return True


@dataclass(frozen=True)
class Outcome:
    """What became of a task.

    Attributes:
        task: The task.
        recording: What was recorded; None if that failed.
        problem: Why it failed, or why the recording ended early; empty if all is well.
    """

    task: Task
    recording: Recording | None
    problem: str


def build(scene: str, settings: RecordSettings) -> Scene:
    """Build a scene from its own stream of random numbers.

    Raises:
        SettingsError: If there is no such scene or option.
    """
    return build_scene(scene, stream(settings.seed, "scene"), settings.scene)


def perform(task: Task, progress: Progress | None = None) -> Outcome:
    """Make one dataset; what is wrong with it is in the outcome, other errors are raised.

    It may be there already, if a worker was lost between finishing and saying so.
    """
    try:
        if task.is_done:
            made = read_manifest(task.out)
            recording = Recording(made["certificate"], made["ended"])
        else:
            scene = build(task.scene, task.settings)
            recording = record(scene, task.settings, task.out, progress=progress)
    except DriftyardError as error:
        return Outcome(task, None, str(error).removeprefix(f"{task.out}: "))
    except OSError as error:
        if error.filename is None:
            raise
        return Outcome(task, None, f"{error.filename}: {error.strerror}")
    return Outcome(task, recording, recording.ended)


def perform_all(
    tasks: Sequence[Task],
    scheduler: str | None,
    workers: int | None,
    progress: Callable[[Path, int, int], None],
) -> Iterator[Outcome]:
    """Make datasets, each on one core of its own; yields them as they are finished.

    Args:
        tasks: None of them done.
        scheduler: Address of a running Dask scheduler; None for a cluster of local processes.
        workers: Of the local cluster; None for one a core.
        progress: Called with a dataset's folder, its frames done and its frames in total.

    Raises:
        DatasetError: If no scheduler answers at the address, or it is lost.
    """
    from distributed import KilledWorker, as_completed

    def hear(event: tuple[Any, tuple[str, int, int]]) -> None:
        out, done, total = event[1]
        progress(Path(out), done, total)

    with _client(scheduler, workers) as client:
        client.subscribe_topic(TOPIC, hear)
        here = Path.cwd()
        futures = [client.submit(_perform_remotely, t, here, pure=False) for t in tasks]
        task_of = dict(zip(futures, tasks, strict=True))
        for future in as_completed(futures):
            try:
                outcome = future.result()
            except KilledWorker:
                outcome = Outcome(task_of[future], None, LOST)
            except CancelledError:
                address = scheduler or "of the local cluster"
                raise DatasetError(
                    f"scheduler {address}: lost; the same command goes on from here"
                ) from None
            except Exception as error:  # the other datasets do not suffer
                outcome = Outcome(task_of[future], None, f"{type(error).__name__}: {error}")
            yield outcome
            future.release()


def _perform_remotely(task: Task, folder: Path) -> Outcome:
    """Run in a Dask worker: as `perform`, and tell the client how far it is, now and then.

    Args:
        task: Its paths are relative to `folder`.
        folder: Where the command was given; a worker of another's cluster started elsewhere.
    """
    from distributed import get_worker

    worker, told_s = get_worker(), -REPORT_PERIOD_S

    def tell(done: int, total: int) -> None:
        nonlocal told_s
        if done == total or time.monotonic() - told_s > REPORT_PERIOD_S:
            told_s = time.monotonic()
            worker.log_event(TOPIC, (str(task.out), done, total))

    with _turn, chdir(folder):
        return perform(task, tell)


@contextmanager
def _client(scheduler: str | None, workers: int | None) -> "Generator[Client]":
    """Connect, or start one process a core, each with a single-threaded renderer.

    Raises:
        DatasetError: If no scheduler answers at the address.
    """
    import dask.config as dask_config
    from distributed import Client, LocalCluster

    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # we say it ourselves
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout="10s")
        except (OSError, TimeoutError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise DatasetError(f"scheduler {scheduler}: does not answer ({reason})") from None
        with client:
            yield client
        return
    count = workers or len(os.sched_getaffinity(0))
    alone = {"LP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    # Of any port: that of None is 8787, where a second command would be warned of the first.
    quiet: dict[str, Any] = {"dashboard_address": "127.0.0.1:0", "silence_logs": 50}
    orders: dict[str, Any] = {
        "distributed.nanny.pre-spawn-environ": alone,
        "distributed.scheduler.allowed-failures": RETRIES,
        # No task waits at a worker: one that is lost would take the blame for its death too.
        "distributed.scheduler.worker-saturation": 1.0,
    }
    with (
        dask_config.set(orders),
        LocalCluster(n_workers=count, threads_per_worker=1, **quiet) as cluster,
        Client(cluster) as client,
    ):
        yield client
