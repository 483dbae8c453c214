"""Statistics of recordings that are kept in the cache, so that a match continues where it ended."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sim.imaging.linear_light import Response
from trials.execution.cache import ESTIMATOR, cache_path, dataset_digest, source_digest
from trials.realism.measure import measure
from trials.realism.quantities import Measured, Statistic
from vo.contract.files import replacing
from vo.recordings.readers import recording_name

SOURCES = (*ESTIMATOR, "trials/realism", "sim/imaging/linear_light.py")
"""Sources that decide the statistics of a recording."""


def saved_measure(
    folder: Path,
    frames: int,
    cache: Path,
    response: Response = "srgb",
    progress: Callable[[int, int], None] | None = None,
) -> Measured:
    """Measure the first frames of a recording, unless the cache has their statistics."""
    name = recording_name(folder)
    causes = dataset_digest(folder), f"{frames} {response}", source_digest(SOURCES)
    file = cache_path(cache, "measures", name, *causes).with_suffix(".npz")
    if file.is_file():
        return _read(file, name)
    found = measure(folder, frames, response, progress)
    with replacing(file) as partial:
        _write(found, partial)
    return found


def _write(measured: Measured, file: Path) -> None:
    arrays = {f"parts/{name}": x.parts for name, x in measured.statistics.items()}
    for name, x in measured.statistics.items():
        if x.weights is not None:
            arrays[f"weights/{name}"] = x.weights
    pictures = {f"picture/{k}": x for k, x in enumerate(measured.pictures)}
    path = {"landmarks": measured.landmarks, "steps_m": measured.steps_m, "turns": measured.turns}
    numbers = {"frames": np.array(measured.frames), "baseline_m": np.array(measured.baseline_m)}
    everything = {**arrays, **pictures, **path, **numbers}
    np.savez(file, allow_pickle=False, **everything)


def _read(file: Path, name: str) -> Measured:
    with np.load(file) as arrays:
        found = dict(arrays)
    statistics = {
        key.partition("/")[2]: Statistic(x, found.get(key.replace("parts", "weights", 1)))
        for key, x in found.items()
        if key.startswith("parts/")
    }
    pictures = tuple(x for key, x in found.items() if key.startswith("picture/"))
    path = found["landmarks"], found["steps_m"], found["turns"]
    frames, baseline_m = int(found["frames"]), float(found["baseline_m"])
    return Measured(name, frames, statistics, pictures, *path, baseline_m)
