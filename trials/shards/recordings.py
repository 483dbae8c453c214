"""Datasets that workers record into a location, each by way of a temporary folder of its own."""

import os
import shutil
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir

from sim.batch import DatasetTask, record_scene
from sim.graphics import GraphicsError
from sim.progress import Progress
from sim.record import Recording
from trials.execution.cache import digest, source_digest
from trials.execution.location import Location, StoreError
from trials.execution.tasks import Task, report_steps
from trials.shards.catalogue import read_entries
from trials.shards.writing import ShardWriter, send_folder
from vo.contract.dataset import CONTENT, MANIFEST
from vo.contract.errors import DatasetError, DriftyardError
from vo.contract.partial import lock

PREFIX = "driftyard-recording-"
"""Begin of the names of temporary folders."""
Made = tuple[str, Recording | DriftyardError]
"""Name of a dataset, and what its recording said, or why there is none."""


def missing(location: Location, tasks: Sequence[DatasetTask]) -> list[DatasetTask]:
    """Return the tasks whose datasets a location does not hold.

    Raises:
        DatasetError: If it holds a dataset of that name with other settings.
        StoreError: If it cannot be read.
    """
    entries = read_entries(location)
    for task in tasks:
        if task.out.name in entries:
            task.check_same(entries[task.out.name].about, f"{location}/{task.out.name}")
    return [task for task in tasks if task.out.name not in entries]


def folder_tasks(location: Location, waiting: Sequence[DatasetTask]) -> list[Task[list[Made]]]:
    """Return a task for each dataset, which writes a folder."""
    return [Task("recording", x.out.name, _record_folder, (location.url, x)) for x in waiting]


def shard_tasks(
    location: Location, waiting: Sequence[DatasetTask], each: int
) -> list[Task[list[Made]]]:
    """Return a task for so many datasets each, which writes tar files and their index.

    Names hold a digest of the settings and of the sources of the generator.
    """
    groups = [waiting[k : k + each] for k in range(0, len(waiting), each)]
    named = {f"{x[0].out.name}-{_digest(x)}": x for x in groups}
    return [
        Task("recording", name, _record_shard, (location.url, name, x)) for name, x in named.items()
    ]


def record_at(location: Location, overwrite: bool, make: Callable[[Path], Recording]) -> Recording:
    """Record one dataset, which then is the location itself.

    Raises:
        DatasetError: If something is there, and `overwrite` is off or it is no dataset.
        StoreError: If it cannot be written.
    """
    location.check()
    names = {*location.contents()}
    if MANIFEST in names and not overwrite:
        raise DatasetError(f"{location}: already exists; choose another location or --overwrite")
    if names - CONTENT:
        raise DatasetError(f"{location}: holds {min(names - CONTENT)}; choose another location")
    with _temporary() as folder:
        made = make(folder / "dataset")
        for name in sorted(names, key=lambda x: x != MANIFEST):  # without it, it is no dataset
            location.remove(name)
        send_folder(folder / "dataset", location)
    return made


def _digest(tasks: Sequence[DatasetTask]) -> str:
    causes = (text for x in tasks for text in (x.out.name, x.scene, x.settings.model_dump_json()))
    return digest(*causes, source_digest())


def _record_folder(url: str, task: DatasetTask) -> list[Made]:
    with _temporary() as folder:
        local = replace(task, out=folder / task.out.name)
        made = record_scene(local, progress=report_steps())
        location = Location(url)
        location.remove(task.out.name)  # what an interruption left
        send_folder(local.out, location, task.out.name)
    return [(task.out.name, made)]


def _record_shard(url: str, name: str, tasks: Sequence[DatasetTask]) -> list[Made]:
    """Record the datasets of a shard; one that cannot be recorded does not hinder the others."""
    made: list[Made] = []
    with _temporary() as folder, ShardWriter(Location(url), name, folder) as writer:
        for k, task in enumerate(tasks):
            local = replace(task, out=folder / task.out.name)
            try:
                recording = record_scene(local, progress=_part(k, len(tasks)))
            except (GraphicsError, StoreError):
                raise
            except DriftyardError as error:
                made.append((task.out.name, error))
                continue
            writer.add(local.out)
            shutil.rmtree(local.out)
            made.append((task.out.name, recording))
        if any(isinstance(x, Recording) for _, x in made):
            writer.commit()
    return made


def _part(k: int, count: int) -> Progress:
    """Report the frames of one of several datasets, as if all were equally long."""
    report = report_steps()
    return lambda done, total: report(k * total + done, count * total)


@contextmanager
def _temporary() -> Generator[Path]:
    """Yield a folder that is removed afterwards, also by the next writer after a kill.

    Raises:
        DatasetError: If the disk is full.
    """
    for left in Path(gettempdir()).glob(f"{PREFIX}*/*"):  # an empty one may just be starting
        with suppress(OSError):  # of another user
            held = lock(left.parent)
            if held is not None:
                shutil.rmtree(left.parent, ignore_errors=True)
                os.close(held)
    with TemporaryDirectory(prefix=PREFIX) as folder:
        held = lock(Path(folder), wait=True)
        try:
            yield Path(folder)
        except OSError as error:
            if error.filename is not None and not str(error.filename).startswith(folder):
                raise
            reason = error.strerror or error
            raise DatasetError(f"{folder}: cannot be written ({reason}); set TMPDIR") from None
        finally:
            if held is not None:
                os.close(held)
