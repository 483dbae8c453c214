"""Sequences of a gate: scenes, seeds and settings, recorded once and hashed."""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path

from pydantic import Field

from trials.execution.jobs import Recording
from trials.execution.recording_settings import recording_settings
from trials.execution.runner import NO_LABELS, record_all
from vo.contract.dataset import read_manifest
from vo.contract.settings import Settings


class Design(Settings):
    """Every scene with every seed, and the settings of the recordings."""

    scenes: tuple[str, ...] = Field(min_length=1)
    seeds: int = Field(default=1, ge=1)
    """Number of seeds of each scene."""
    first_seed: int = Field(default=0, ge=0)
    """Random seed of the first sequence of each scene."""
    disturb: str = ""
    """Disturbances, as for `driftyard generate`."""
    overrides: tuple[str, ...] = ()
    """Settings of the recordings, `key=value` each."""

    @property
    def sequences(self) -> tuple[tuple[str, int], ...]:
        """Scene and seed of each sequence."""
        seeds = range(self.first_seed, self.first_seed + self.seeds)
        return tuple((scene, seed) for scene in self.scenes for seed in seeds)


def record(design: Design, cache: Path, progress: Callable[[object], None]) -> list[Path]:
    """Record what is missing, on all cores.

    Args:
        design: Sequences.
        cache: Folder of recordings.
        progress: Called for each sequence.

    Returns:
        The dataset folder of each sequence of the design.

    Raises:
        SettingsError: If a scene, disturbance or setting is not accepted.
        DatasetError: If a recording cannot be made.
    """
    overrides = (*NO_LABELS, *design.overrides)
    drives = [Recording(x, seed, overrides, design.disturb) for x, seed in design.sequences]
    for x in drives:  # refuses now what a worker would refuse
        recording_settings(x.scene, x.seed, x.overrides, None, x.disturb)
    folders: dict[int, Path] = {}
    for row, folder in record_all(drives, cache):
        folders[row] = folder
        progress(folder)
    return [folders[row] for row in range(len(drives))]


def content_hashes(datasets: Sequence[Path]) -> tuple[str, ...]:
    """Hash the contents of datasets: all files but the manifest, which names the software."""
    hashes = [json.dumps(read_manifest(x)["sha256"], sort_keys=True) for x in datasets]
    return tuple(hashlib.sha256(x.encode()).hexdigest() for x in hashes)
