"""The sequences of a gate: what is driven where, recorded once and fingerprinted."""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path

from pydantic import Field

from vo.contract.dataset import read_manifest
from vo.contract.settings import Settings


class Design(Settings):
    """Every scene with every seed."""

    scenes: tuple[str, ...] = Field(min_length=1)
    seeds: int = Field(default=1, ge=1)
    """Of each scene."""
    first_seed: int = Field(default=0, ge=0)
    disturb: str = ""
    """As for generate."""
    overrides: tuple[str, ...] = ()
    """`key=value` of the recording's settings."""

    @property
    def sequences(self) -> tuple[tuple[str, int], ...]:
        """Scene and seed of each."""
        seeds = range(self.first_seed, self.first_seed + self.seeds)
        return tuple((scene, seed) for scene in self.scenes for seed in seeds)


def record(design: Design, cache: Path, progress: Callable[[object], None]) -> list[Path]:
    """Record what is missing, several drives at a time.

    Args:
        design: What to drive.
        cache: Folder of recordings; each is named after all that made it.
        progress: Called for each drive.

    Returns:
        A dataset folder for each of the design's sequences.

    Raises:
        SettingsError: If a scene, disturbance or setting is not accepted.
        DatasetError: If a recording cannot be made.
    """
    from trials.execution.jobs import Recording
    from trials.execution.runner import NO_LABELS, record_all

    overrides = (*NO_LABELS, *design.overrides)
    drives = [Recording(x, seed, overrides, design.disturb) for x, seed in design.sequences]
    folders: dict[int, Path] = {}
    for row, folder in record_all(drives, cache):
        folders[row] = folder
        progress(folder)
    return [folders[row] for row in range(len(drives))]


def fingerprints(datasets: Sequence[Path]) -> tuple[str, ...]:
    """Hash the contents of datasets: every file but the manifest, which names the software."""
    hashes = [json.dumps(read_manifest(x)["sha256"], sort_keys=True) for x in datasets]
    return tuple(hashlib.sha256(x.encode()).hexdigest() for x in hashes)
