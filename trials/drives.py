"""Drives: recordings that are made once, kept, and scored with estimators; many at a time.

Recordings are kept under a folder named after the sources that made them, and made again when
those change or a file is damaged.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from trials.workers import spread
from vo.contract.errors import DatasetError

if TYPE_CHECKING:
    from sim.settings import RecordSettings
    from trials.score import Score

GENERATOR = ("scenes", "sim", "vo/contract")
"""Folders of the sources that decide what a recording looks like."""
NO_LABELS = ("labels.depth=false", "labels.disparity=false")
"""Labels are for training and checking; a score needs images and truth."""


@dataclass(frozen=True)
class Drive:
    """One recording to make and score.

    Attributes:
        scene: Name.
        settings: Resolved.
        folder: Dataset folder.
        estimators: Names of those to score on it.
    """

    scene: str
    settings: "RecordSettings"
    folder: Path
    estimators: tuple[str, ...]


def score_drives(drives: Sequence[Drive]) -> "Iterator[tuple[Drive, list[Score]]]":
    """Record what is missing and score it; yields drives as they finish."""
    for k, scores in spread(score_drive, [(drive,) for drive in drives]):
        yield drives[k], scores


def score_drive(drive: Drive) -> "list[Score]":
    """Record a drive unless it is there, and score its estimators on it."""
    from sim.batch import build
    from sim.record import record

    if not is_recorded(drive.folder, drive.settings):
        record(build(drive.scene, drive.settings), drive.settings, drive.folder, overwrite=True)
    return score_recording(drive.folder, drive.folder.parent, drive.estimators)


def is_recorded(folder: Path, settings: "RecordSettings") -> bool:
    """Whether the folder was recorded with these settings and no file was lost or changed since."""
    from sim.verify import verify
    from vo.contract.dataset import read_manifest

    try:
        same = read_manifest(folder).get("settings") == settings.model_dump(mode="json")
        return same and not verify(folder)
    except DatasetError:
        return False


def score_recording(folder: Path, runs: Path, estimators: Sequence[str]) -> "list[Score]":
    """Run and score estimators on a recording; the runs are kept in the folder `runs`.

    Raises:
        DatasetError: If the recording is damaged or holds no truth.
    """
    import cv2

    from trials.estimators import make_estimator
    from trials.runs import read_run
    from trials.score import score_run
    from vo.contract.readers import open_sequence, read_truth
    from vo.runner import run, write_run

    cv2.setNumThreads(1)
    sequence, truth = open_sequence(folder), read_truth(folder)
    if truth is None:
        raise DatasetError(f"{folder}: holds no truth to compare with")
    scores: list[Score] = []
    for name in estimators:
        estimator, settings = make_estimator(name, sequence.rig)
        file = runs / f"{sequence.name}.{name}.txt"
        write_run(file, run(sequence, estimator), name, settings, folder)
        scores.append(score_run(truth, read_run(file), len(sequence)))
    return scores


def fingerprint(folders: Sequence[str] = GENERATOR) -> str:
    """Hash the sources in some folders, the generator's by default, to twelve digits."""
    root = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for folder in folders:
        for file in sorted((root / folder).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
