"""Estimators on published data sets, and systems over scenes, as one table each."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from driftyard.dataset import PathLike
from driftyard.failures import in_one_family
from driftyard.given_settings import GivenSettings, sources_of
from trials.execution.cache import CACHE
from trials.studies.benchmark import Benchmark, recordings_of, run_benchmark, variants_of
from trials.studies.systems.comparison import SystemComparison
from trials.studies.systems.pages import write_comparison
from trials.studies.systems.study import EVERY, Plan
from trials.studies.systems.study import compare_systems as compare
from vo.contract.errors import SettingsError

Estimators = str | Sequence[str]
"""Names `a,b`, or one or several of `NAME KEY=VALUE ...`."""


@in_one_family
def benchmark(
    kind: str,
    folder: PathLike,
    estimators: Estimators = "driftyard",
    *,
    seeds: int = 3,
    cache: PathLike = CACHE,
) -> Benchmark:
    """Run estimators over every recording of a published data set, in the benchmark's own figures.

    On all cores. What the cache has is not run again; a failure costs one run.

    Args:
        kind: `euroc`, `tumvi` or `kitti`.
        folder: Recordings at any depth, as published or excerpts.
        estimators: Names, each with settings `key=value` if wanted.
        seeds: Number of runs, with seeds of RANSAC from 0 on.
        cache: Folder of the runs.

    Returns:
        The runs: `table(figure)`, `published()`, `to_dict()`; a notebook shows the headline.

    Raises:
        SettingsError: If there is no such benchmark or estimator, or it refuses a setting.
        DatasetError: If the folder holds no recording of it with a ground truth.

    Example:
        >>> found = dy.benchmark("euroc", "ds", "corner_flow", seeds=1)
        >>> header, rows = found.table(found.headline)
        >>> header
        ['sequence', 'corner_flow']
    """
    recordings = recordings_of(kind, Path(folder))
    variants = variants_of(_several(estimators), seeds)
    return run_benchmark(kind, recordings, variants, lambda _: None, Path(cache))


@in_one_family
def compare_systems(
    estimators: Estimators = EVERY,
    scenes: Estimators = "all",
    *,
    seeds: int = 3,
    repeats: int = 3,
    distance_m: float = 10.0,
    settings: GivenSettings = None,
    added: Mapping[str, PathLike] | None = None,
    out: PathLike | None = None,
) -> SystemComparison:
    """Compare estimators, and systems of other authors, over drives through scenes.

    Runs are one at a time, on one core. What `build/cache` has is not recorded or run again; a
    failure costs one run.

    Args:
        estimators: Names, each with settings `key=value` if wanted; all systems by default.
        scenes: Names of scenes, or all.
        seeds: Number of drives in each scene.
        repeats: Number of runs of an estimator with a seed, or with varying results.
        distance_m: Length of each drive.
        settings: Values of further settings of the recordings.
        added: Name to the folder of trajectory files `SCENE-SEED.txt` of a program that ran
            elsewhere.
        out: Folder of a page as HTML, Markdown and JSON; none by default.

    Returns:
        The runs: `interval(system, "drift")`, `summary()`, `failures`, `to_dict()`; a notebook
        shows the table.

    Raises:
        DriftyardError: If a scene, setting, estimator or folder is wrong.

    Example:
        >>> tiny = {"rig": {"width_px": 64, "height_px": 48, "rate_hz": 5}}
        >>> found = dy.compare_systems(
        ...     "corner_flow", "yard.xml", seeds=1, repeats=1, distance_m=1.2, settings=tiny)
        >>> found.failures, len(found.trials)
        ([], 1)
    """
    config, overrides = sources_of(settings)
    if config is not None:
        raise SettingsError(f"settings {config}: expected values by name, not a file")
    several = scenes if isinstance(scenes, str) else ",".join(scenes)
    folders = [f"{name}={folder}" for name, folder in (added or {}).items()]
    plan = Plan(_several(estimators), several, seeds, repeats, distance_m, overrides, added=folders)
    found = compare(plan, "driftyard.compare_systems")
    if out is not None:
        write_comparison(found, Path(out))
    return found


def _several(texts: Estimators) -> Sequence[str]:
    return [texts] if isinstance(texts, str) else texts
