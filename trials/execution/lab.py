"""The lab: makes recordings, runs estimators over them, and keeps both until a cause changes.

A recording is named after its settings and the generator's sources, a run after its recording, its
estimator's settings and the estimator's sources. So all studies share what they have in common, go
on where they were interrupted, and redo only what changed.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from trials.estimators.choice import Named, estimate, make_estimator
from trials.execution.outcomes import Outcome, Outcomes, Recording, Trial, Variant
from trials.execution.parallel import spread
from vo.contract.dataset import MANIFEST
from vo.contract.errors import DatasetError
from vo.contract.rig import StereoRig

if TYPE_CHECKING:
    from sim.settings import RecordSettings

CACHE = Path("build/lab")
GENERATOR = ("scenes", "sim", "vo/contract")
ESTIMATOR = ("vo", "trials/estimators/baselines", "trials/estimators/systems")
"""Folders of the sources that decide what a recording looks like, and what an estimator says."""
NO_LABELS = ("labels.depth=false", "labels.disparity=false")
"""Labels are for training and checking; a score needs images and truth."""
ANY_RIG = StereoRig(640, 480, 457.0, 319.5, 239.5, 0.09)
"""With which an estimator is built to see whether it can be."""


def perform(
    trials: Sequence[Trial], cache: Path = CACHE, progress: Callable[[object], None] | None = None
) -> Outcomes:
    """Record what is missing, run what is missing, and return all.

    Args:
        trials: May share recordings; each is made once.
        cache: Folder of recordings and runs.
        progress: Called with every recording that is done with.

    Raises:
        DriftyardError: If a scene, setting or estimator is wrong; the latter before anything is
            recorded.
    """
    for variant in dict.fromkeys(trial.variant for trial in trials):
        if not variant.command:
            make_estimator(variant.estimator, ANY_RIG, None, variant.overrides)
    variants: dict[Recording, list[Variant]] = {}
    for trial in trials:
        variants.setdefault(trial.recording, []).append(trial.variant)
    done: dict[Trial, Outcome] = {}
    calls = [(recording, of, cache) for recording, of in variants.items()]
    for _, outcomes in spread(_record_and_run, calls):
        done |= {outcome.trial: outcome for outcome in outcomes}
        if progress:
            progress(outcomes)
    return Outcomes({trial: done[trial] for trial in trials})


def record_all(recordings: Sequence[Recording], cache: Path = CACHE) -> Iterator[tuple[int, Path]]:
    """Record what is missing; yields rows and dataset folders as they finish.

    Raises:
        DriftyardError: If a scene or setting is wrong.
    """
    return spread(recorded, [(recording, cache) for recording in recordings])


def recorded(recording: Recording, cache: Path = CACHE) -> Path:
    """Return the folder of a drive, recorded now unless it is there."""
    from sim.batch import build
    from sim.record import record
    from trials.cli.datasets import record_settings

    settings = record_settings(
        recording.scene, recording.seed, list(recording.overrides), None, recording.disturb
    )
    key = _key(settings.model_dump_json() + fingerprint(GENERATOR))
    name = Path(recording.scene).stem.replace(":", ".")
    folder = cache / "recordings" / f"{name}-{recording.seed}-{key}"
    if not is_recorded(folder, settings):
        record(build(recording.scene, settings), settings, folder, overwrite=True)
    return folder


def is_recorded(folder: Path, settings: "RecordSettings") -> bool:
    """Whether the folder was recorded with these settings and no file was lost or changed since."""
    from sim.certificate.verify import verify
    from vo.contract.dataset import read_manifest

    try:
        same = read_manifest(folder).get("settings") == settings.model_dump(mode="json")
        return same and not verify(folder)
    except DatasetError:
        return False


def run_over(dataset: Path, variant: Variant, cache: Path = CACHE) -> Path:
    """Return the trajectory file of a variant's run over a dataset, run now unless it is there."""
    import cv2

    from trials.estimators.plugins.command import Command

    manifest = dataset / MANIFEST
    what = manifest.read_text(encoding="utf-8") if manifest.is_file() else str(dataset.resolve())
    how = [what, variant.estimator, variant.overrides, variant.command]
    file = cache / "runs" / f"{_key(json.dumps(how) + fingerprint(ESTIMATOR))}.txt"
    if not file.is_file():  # it is written last, so what belongs to it is there too
        cv2.setNumThreads(1)
        file.parent.mkdir(parents=True, exist_ok=True)
        choice = Named(variant.estimator, None, variant.overrides)
        if variant.command:
            choice = Command(variant.command, label=variant.label)
        estimate(choice, dataset, file)
    return file


def _record_and_run(
    recording: Recording, variants: Sequence[Variant], cache: Path
) -> list[Outcome]:
    dataset = recorded(recording, cache)
    return [
        Outcome(Trial(recording, variant), dataset, run_over(dataset, variant, cache))
        for variant in variants
    ]


def fingerprint(folders: Sequence[str] = GENERATOR) -> str:
    """Hash the sources in some folders, the generator's by default, to twelve digits."""
    root = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for folder in folders:
        for file in sorted((root / folder).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def _key(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]
