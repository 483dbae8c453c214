"""Recordings that are made, and estimators that are run over them, unless the cache has both."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from trials.estimators.choice import Named, estimate, make_estimator
from trials.execution.cache import CACHE, ESTIMATOR, cache_path, dataset_digest, source_digest
from trials.execution.executor import compute
from trials.execution.jobs import Job, Recording, Result, Results, Variant
from trials.execution.store import fetch, present, publish
from trials.execution.tasks import Task
from vo.contract.errors import DatasetError
from vo.contract.rig import StereoRig
from vo.recordings.pairing import ALL_FRAMES, FrameSelection

if TYPE_CHECKING:
    from sim.settings import RecordSettings

NO_LABELS = ("labels.depth=false", "labels.disparity=false")
"""Overrides of a recording that is only scored: it needs images and truth."""
ANY_RIG = StereoRig(640, 480, 457.0, 319.5, 239.5, 0.09)
"""Rig with which an estimator is built only to check its settings."""


def run_jobs(
    jobs: Sequence[Job], cache: Path = CACHE, progress: Callable[[object], None] | None = None
) -> Results:
    """Record what is missing, each recording once, run what is missing, and return all.

    Progress is called with the results of each recording.

    Raises:
        DriftyardError: If a scene, setting or estimator is wrong; the latter before anything is
            recorded.
    """
    for variant in dict.fromkeys(job.variant for job in jobs):
        if not variant.command:
            make_estimator(variant.estimator, ANY_RIG, None, variant.overrides)
    variants: dict[Recording, list[Variant]] = {}
    for job in jobs:
        variants.setdefault(job.recording, []).append(job.variant)
    tasks = [
        Task("recording", recording.name, _record_and_run, (recording, of, cache))
        for recording, of in variants.items()
    ]
    done = {result.job: result for results in compute(tasks, progress) for result in results}
    for result in done.values():
        _ = present(result.dataset), present(result.file)
    return Results({job: done[job] for job in jobs})


def record_all(
    recordings: Sequence[Recording],
    cache: Path = CACHE,
    progress: Callable[[object], None] | None = None,
) -> list[Path]:
    """Record what is missing; return the dataset folders.

    Raises:
        DriftyardError: If a scene or setting is wrong.
    """
    tasks = [Task("recording", x.name, cached_recording, (x, cache)) for x in recordings]
    return [present(x) for x in compute(tasks, progress)]


def cached_recording(recording: Recording, cache: Path = CACHE) -> Path:
    """Return the dataset folder of a recording, made now unless the cache has it."""
    from sim.batch import build
    from sim.record import record

    folder, settings = recording_folder(recording, cache)
    if not is_recorded(folder, settings):
        if not fetch(folder):
            record(build(recording.scene, settings), settings, folder, overwrite=True)
        publish(folder)
    return folder


def recording_folder(recording: Recording, cache: Path) -> tuple[Path, "RecordSettings"]:
    """Return where the cache has a recording, and its settings; an edited world has another place.

    Raises:
        SettingsError: If there is no such scene or setting, or a custom scene cannot be built.
    """
    from sim.batch import custom_fingerprint
    from trials.execution.recording_settings import recording_settings

    settings = recording_settings(
        recording.scene,
        recording.seed,
        recording.overrides,
        None,
        recording.disturb,
        recording.camera,
    )
    causes = [settings.model_dump_json(), source_digest()]
    if world := custom_fingerprint(recording.scene, settings):
        causes.append(world)
    return cache_path(cache, "recordings", recording.name, *causes), settings


def is_recorded(folder: Path, settings: "RecordSettings") -> bool:
    """Whether the folder was recorded with these settings and no file was lost or changed since."""
    from sim.certificate.verify import verify
    from vo.contract.dataset import read_manifest

    try:
        same = read_manifest(folder).get("settings") == settings.model_dump(mode="json")
        return same and not verify(folder)
    except DatasetError:
        return False


def cached_run(
    dataset: Path,
    variant: Variant,
    cache: Path = CACHE,
    frames: FrameSelection = ALL_FRAMES,
    condition: str = "",
) -> Path:
    """Return the trajectory of a variant over a dataset, run now unless the cache has it.

    Runs under another condition, such as `one core`, have other times, and are kept apart.
    """
    import cv2

    from trials.estimators.plugins.command import Command

    how = json.dumps([variant.estimator, variant.overrides, variant.command])
    causes = [dataset_digest(dataset), how, source_digest(ESTIMATOR)]
    if frames != ALL_FRAMES:
        causes.append(repr(frames))
    causes += [x for x in (condition, f"repeat {variant.repeat}" * bool(variant.repeat)) if x]
    file = cache_path(cache, "runs", dataset.name, *causes).with_suffix(".txt")
    if not file.is_file():  # it is written last, so its companions are there too
        cv2.setNumThreads(1)
        file.parent.mkdir(parents=True, exist_ok=True)
        choice = Named(variant.estimator, None, variant.overrides)
        if variant.command:
            choice = Command(variant.command, label=variant.label)
        if not fetch(file):
            estimate(choice, dataset, file, frames=frames)
        publish(file)
    return file


def _record_and_run(recording: Recording, variants: Sequence[Variant], cache: Path) -> list[Result]:
    dataset = cached_recording(recording, cache)
    return [Result(Job(recording, x), dataset, cached_run(dataset, x, cache)) for x in variants]
