"""Sequences of a baseline: drives that are recorded where they are missing, and recordings."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np

from trials.evaluation.truth import true_trajectory
from trials.execution.cache import cache_path
from trials.execution.jobs import Recording
from trials.execution.recording_settings import recording_settings
from trials.execution.runner import NO_LABELS, record_all
from trials.gate.baseline import Design
from vo.contract.dataset import MANIFEST, read_manifest
from vo.recordings.readers import open_sequence, recording_name

Bar = Callable[[str, int], AbstractContextManager[Callable[[object], None]]]
"""Shows a progress bar with label and total; yields a function to call at each step."""
HASHED_FRAMES = 16
"""Frames of a recording whose images are hashed, evenly over it."""
DECIMALS = 6
"""Decimals of hashed numbers, which do not depend on the processor."""


def obtain(design: Design, cache: Path, bar: Bar) -> tuple[list[Path], list[Path]]:
    """Record what is missing, on all cores; return each sequence, and the file of its trajectory.

    Raises:
        DriftyardError: If a setting is not accepted, or a recording is invalid or has no truth.
    """
    overrides = (*NO_LABELS, *design.overrides)
    how = overrides, design.disturb, design.camera
    drives = [Recording(x, seed, *how) for x, seed in design.drives]
    recorded: list[Path] = []
    if drives:
        with bar("recording", len(drives)) as count:
            for x in drives:  # refuses now what a worker would refuse
                recording_settings(x.scene, x.seed, x.overrides, None, x.disturb, x.camera)
            recorded = record_all(drives, cache, count)
    runs = [x.with_name(f"{x.name}.candidate.txt") for x in recorded]
    others = [Path(x) for x in design.recordings]
    for x in others:
        name, place = f"{recording_name(x)}.candidate", str(x.absolute())
        runs.append(cache_path(cache, "runs", name, place).with_suffix(".txt"))
        _ = open_sequence(x), true_trajectory(x)
    return [*recorded, *others], runs


def software(dataset: Path) -> Mapping[str, Any]:
    """Return what rendered a dataset; empty for recordings of other origin."""
    return read_manifest(dataset).get("software", {}) if _is_own(dataset) else {}


def content_hashes(datasets: Sequence[Path]) -> list[str]:
    """Hash the contents of sequences.

    Of datasets, these are all files but the manifest, which names the software; of recordings,
    calibration, times, truth and images of HASHED_FRAMES.
    """
    return [_own_hash(x) if _is_own(x) else _recording_hash(x) for x in datasets]


def _is_own(dataset: Path) -> bool:
    return (dataset / MANIFEST).is_file()


def _own_hash(dataset: Path) -> str:
    content = json.dumps(read_manifest(dataset)["sha256"], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()


def _recording_hash(recording: Path) -> str:
    sequence, truth = open_sequence(recording), true_trajectory(recording)
    rig = sequence.rig
    found = hashlib.sha256(sequence.timestamps_ns.tobytes() + truth.timestamps_ns.tobytes())
    for numbers in (rig.K, rig.baseline_m, rig.T_body_cam, truth.T_ref_frame):
        found.update((np.round(np.asarray(numbers, np.float64), DECIMALS) + 0.0).tobytes())
    for i in np.unique(np.linspace(0, len(sequence) - 1, HASHED_FRAMES).astype(int)).tolist():
        for image in sequence.load(i):
            found.update(image.tobytes())
    return found.hexdigest()
