"""Batches: many independent recordings on all cores or a cluster, by Dask.

A task depends on nothing but a scene and settings: it runs anywhere that has the folder, and again
if its worker is lost. A dataset that exists with the same settings is kept.
"""

import json
import logging
import os
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import chdir, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenes import build_scene, find_scene
from scenes.custom import is_custom
from scenes.scene import Scene
from sim.progress import Progress
from sim.record import Recording, record
from sim.settings import RecordSettings, recorded_settings
from sim.world.fingerprint import changes_since, fingerprint
from sim.world.random_streams import stream
from sim.world.world import build_world
from vo.contract.dataset import MANIFEST, DatasetWriter, read_manifest
from vo.contract.errors import DatasetError, DriftyardError
from vo.contract.remarks import print_remarks
from vo.contract.settings import with_defaults

if TYPE_CHECKING:
    from distributed import Client

TOPIC = "driftyard-frames"
REPORT_PERIOD_S = 0.5
RETRIES = 2
"""Attempts of a local cluster at a dataset after its worker was lost."""
LOST = "its worker was lost in every attempt (killed, or out of memory?)"

_process_lock = threading.Lock()
"""Lock for one dataset at a time: OpenGL and the working directory belong to the process."""


@dataclass(frozen=True)
class Task:
    """A dataset to record: a scene (name, MJCF file or `module:function`), settings, folder."""

    scene: str
    settings: RecordSettings
    out: Path

    @property
    def is_done(self) -> bool:
        """Whether the folder is a dataset of this task already.

        Raises:
            DatasetError: If the folder holds something else.
        """
        if not self.out.exists():
            return False
        if not (self.out / MANIFEST).is_file():
            raise DatasetError(f"{self.out}: exists and is not a dataset; choose another folder")
        made = read_manifest(self.out)
        wanted = with_defaults(self.settings, find_scene(self.scene).defaults)
        same = recorded_settings(made["settings"]) == wanted
        if not same or made["scene"]["source"] != self.scene:
            raise DatasetError(f"{self.out}: exists with other settings; choose another folder")
        if is_custom(self.scene) and "world" in made:
            world = build_world(build(self.scene, self.settings), self.settings)
            if problem := changes_since(made["world"], world):
                raise DatasetError(
                    f"{self.out}: exists, and {problem} since; choose another folder"
                )
        return True


@dataclass(frozen=True)
class Outcome:
    """Result of a task: its recording, None if it failed, and why it failed or ended early."""

    task: Task
    recording: Recording | None
    problem: str


def build(scene: str, settings: RecordSettings) -> Scene:
    """Build a scene from its own random stream.

    Raises:
        SettingsError: If there is no such scene or option.
    """
    return build_scene(scene, stream(settings.seed, "scene"), settings.scene)


def record_scene(
    task: Task,
    overwrite: bool = False,
    progress: Progress | None = None,
    recorded: Mapping[str, Any] | None = None,
) -> Recording:
    """Build the scene of a task and record it; arguments and errors are those of `record`.

    An existing folder is refused before the scene is built.
    """
    DatasetWriter(task.out, overwrite)
    scene = build(task.scene, task.settings)
    return record(scene, task.settings, task.out, overwrite, progress, recorded)


def custom_fingerprint(scene: str, settings: RecordSettings) -> str:
    """Return the `fingerprint` of a custom scene as JSON, "" of another, which its name tells.

    Raises:
        SettingsError: If the scene cannot be built.
    """
    if not is_custom(scene):
        return ""
    return json.dumps(fingerprint(build_world(build(scene, settings), settings)))


def perform(task: Task, progress: Progress | None = None) -> Outcome:
    """Record one dataset, or read it if it exists; return expected errors in the outcome."""
    try:
        if task.is_done:
            made = read_manifest(task.out)
            recording = Recording(made["certificate"], made["ended"])
        else:
            recording = record_scene(task, progress=progress)
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
    """Record datasets, each on a core of its own; yield outcomes as they are finished.

    The cluster is that of a scheduler's address, or `workers` local processes (None: one per core).
    `progress` receives a dataset's folder, its frames done and its frames in total.

    Raises:
        DatasetError: If no scheduler answers at the address, or it is lost.
    """
    from distributed import KilledWorker, as_completed

    def report(event: tuple[Any, tuple[str, int, int]]) -> None:
        out, done, total = event[1]
        progress(Path(out), done, total)

    with _client(scheduler, workers) as client:
        client.subscribe_topic(TOPIC, report)
        # All in one call: tasks that come one by one wait at a worker, not at the scheduler.
        futures = client.map(_perform_remotely, tasks, folder=Path.cwd(), pure=False)
        task_of = dict(zip(futures, tasks, strict=True))
        for future in as_completed(futures):
            try:
                outcome = future.result()
            except KilledWorker:
                outcome = Outcome(task_of[future], None, LOST)
            except CancelledError:
                address = scheduler or "of the local cluster"
                raise DatasetError(
                    f"scheduler {address}: lost; the same command continues from here"
                ) from None
            except Exception as error:  # the other datasets go on
                outcome = Outcome(task_of[future], None, f"{type(error).__name__}: {error}")
            yield outcome
            future.release()


def _perform_remotely(task: Task, folder: Path) -> Outcome:
    """Run `perform` in a Dask worker, in the client's `folder`, and report its progress."""
    from distributed import get_worker

    print_remarks()
    worker, reported_s = get_worker(), -REPORT_PERIOD_S

    def report(done: int, total: int) -> None:
        nonlocal reported_s
        if done == total or time.monotonic() - reported_s > REPORT_PERIOD_S:
            reported_s = time.monotonic()
            worker.log_event(TOPIC, (str(task.out), done, total))

    with _process_lock, chdir(folder):
        return perform(task, report)


@contextmanager
def _client(scheduler: str | None, workers: int | None) -> "Generator[Client]":
    """Connect, or start one process per core, each with a single-threaded renderer."""
    import dask.config as dask_config
    from distributed import Client, LocalCluster

    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # errors are raised below
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout="10s")
        except (OSError, ValueError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise DatasetError(f"scheduler {scheduler}: does not answer ({reason})") from None
        with client:
            yield client
        return
    count = workers or len(os.sched_getaffinity(0))
    alone = {"LP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    # Any free port: the default, 8787, may be that of another command.
    quiet: dict[str, Any] = {"dashboard_address": "127.0.0.1:0", "silence_logs": 50}
    configuration: dict[str, Any] = {
        "distributed.nanny.pre-spawn-environ": alone,
        "distributed.scheduler.allowed-failures": RETRIES,
        # No task waits at a worker, where the loss of the worker would count against it.
        "distributed.scheduler.worker-saturation": 1.0,
        # On a busy machine a lost worker takes long to start again; given up, all would wait.
        "distributed.deploy.lost-worker-timeout": "1 hour",
    }
    with (
        dask_config.set(configuration),
        LocalCluster(n_workers=count, threads_per_worker=1, **quiet) as cluster,
        Client(cluster) as client,
    ):
        yield client
