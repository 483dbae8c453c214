"""Drift of the default settings on both scenes; `make accuracy`.

Every scene is driven with seeds 0, 1, ...; parameters were chosen on seeds of 100 and above, so
that no figure here is of a drive that a parameter has seen. A drive is one sample: the figures
are medians over drives, with the worst drive and a bootstrap interval over drives. Recordings are
kept under a folder named after the sources that made them, and made again when those change or a
file is damaged.
"""

import hashlib
import json
import multiprocessing
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from rich.table import Table

from trials.cli import guard
from trials.commands import console
from trials.estimators import ESTIMATORS
from vo.contract.arrays import Array
from vo.contract.errors import DatasetError

if TYPE_CHECKING:
    from sim.settings import RecordSettings
    from trials.score import Score

SCENES = ("brick_court", "office")
CACHE = Path("build/accuracy")
GENERATOR = ("scenes", "sim", "vo/contract")
"""Folders of the sources that decide what a recording looks like."""

PROCESSES = 2
"""Drives at a time; figures in milliseconds are slower for it than those of `make bench`."""

RESAMPLES, CONFIDENCE = 10_000, 0.95


@dataclass(frozen=True)
class Drive:
    """One recording to make and score.

    Attributes:
        scene: Name.
        seed: Of everything random.
        distance_m: Path length.
        folder: Dataset folder.
    """

    scene: str
    seed: int
    distance_m: float
    folder: Path


@dataclass(frozen=True)
class Figure:
    """A row of the table.

    Attributes:
        label: With the unit.
        key: Path into a score's JSON.
        digits: To print.
    """

    label: str
    key: tuple[str, ...]
    digits: int


FIGURES = (
    Figure("drift over 1 m, median, %", ("drift_1m", "median_percent"), 3),
    Figure("drift over 1 m, mean, %", ("drift_1m", "mean_percent"), 3),
    Figure("rotation over 1 m, °/m", ("drift_1m", "mean_deg_per_m"), 4),
    Figure("end point, % of path", ("end_percent",), 3),
    Figure("ms per frame, two drives at a time", ("frame_ms",), 1),
)


def accuracy(
    distance: Annotated[float, typer.Option(min=2.0, help="Of each drive, metres.")] = 20.0,
    seeds: Annotated[int, typer.Option(min=1, help="Drives of each scene, from seed 0 on.")] = 5,
    kitti: Annotated[Path | None, typer.Option(help="Also score this recording.")] = None,
    out: Annotated[Path | None, typer.Option("--json", help="File for all scores.")] = None,
) -> None:
    """Record or reuse the drives, run every estimator over them and print its errors."""
    cache = CACHE / fingerprint()
    drives = [
        Drive(scene, seed, distance, cache / f"{scene}-{seed}-{distance:g}m")
        for scene, seed in product(SCENES, range(seeds))
    ]
    scores: dict[str, list[Score]] = {scene: [] for scene in SCENES}
    with (
        console.progress_bar("drives") as progress,
        ProcessPoolExecutor(PROCESSES, multiprocessing.get_context("spawn")) as pool,
    ):
        progress(0, len(drives))
        jobs = {pool.submit(score_drive, drive): drive for drive in drives}
        try:
            for done, job in enumerate(as_completed(jobs), start=1):
                scores[jobs[job].scene] += job.result()
                progress(done, len(drives))
        except BaseException:
            pool.shutdown(cancel_futures=True)  # one drive failed: the others would be for nothing
            raise
    if kitti is not None:
        scores[kitti.resolve().name] = score_recording(kitti, cache)
    for name, of_scene in scores.items():
        console.out.print(accuracy_table(name, of_scene))
    if out is not None:
        _write(out, scores)


def score_drive(drive: Drive) -> "list[Score]":
    """Record a drive unless it is there, and score every estimator on it."""
    from sim.batch import build
    from sim.record import record
    from trials.commands.datasets import record_settings

    # Labels are for training and checking; a score needs images and truth.
    overrides = [f"drive.distance_m={drive.distance_m}", "labels.depth=false"]
    settings = record_settings(
        drive.scene, drive.seed, [*overrides, "labels.disparity=false"], None
    )
    if not _is_recorded(drive.folder, settings):
        record(build(drive.scene, settings), settings, drive.folder, overwrite=True)
    return score_recording(drive.folder, drive.folder.parent)


def _is_recorded(folder: Path, settings: "RecordSettings") -> bool:
    """Whether the folder was recorded with these settings and no file was lost or changed since."""
    from sim.verify import verify
    from vo.contract.dataset import read_manifest

    try:
        same = read_manifest(folder).get("settings") == settings.model_dump(mode="json")
        return same and not verify(folder)
    except DatasetError:
        return False


def score_recording(folder: Path, runs: Path) -> "list[Score]":
    """Run and score every estimator on a recording; the runs are kept in the folder `runs`.

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
    for name in ESTIMATORS:
        estimator, settings = make_estimator(name, sequence.rig)
        file = runs / f"{sequence.name}.{name}.txt"
        write_run(file, run(sequence, estimator), name, settings, folder)
        scores.append(score_run(truth, read_run(file), len(sequence)))
    return scores


def fingerprint() -> str:
    """Hash the sources of the generator to twelve hexadecimal digits."""
    root = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for folder in GENERATOR:
        for file in sorted((root / folder).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def bootstrap_interval(values: Array) -> tuple[float, float]:
    """Percentile interval of the median of (N,) values, N >= 1, at CONFIDENCE.

    With five values it is all but their range: a median needs drives, not segments.

    Source:
        Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapter 13.
    """
    rng = np.random.default_rng(0)
    medians = np.median(rng.choice(values, (RESAMPLES, len(values))), axis=1)
    low, high = np.quantile(medians, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def accuracy_table(title: str, scores: "list[Score]") -> Table:
    """Lay out every figure of every estimator: median over drives, worst, interval."""
    names = list(dict.fromkeys(x.estimator for x in scores))
    drives = len(scores) // len(names)
    path_m = sum(x.path_m for x in scores) / len(names)
    title = f"{title}: {drives} {'drive' if drives == 1 else 'drives'}, {path_m:.1f} m in all"
    table = Table("estimator", "figure", "median", "worst", "95 %", title=title)
    for column in table.columns[2:]:
        column.justify = "right"
    for name in names:
        mine = [x for x in scores if x.estimator == name]
        for k, figure in enumerate(FIGURES):
            values = [_at(x.as_json(), figure.key) for x in mine]
            table.add_row(name if k == 0 else "", figure.label, *_spread(values, figure.digits))
        lost = [x.statuses.get("lost", 0) for x in mine]
        total = f"{sum(lost)} of {sum(x.frames for x in mine)}"
        table.add_row("", "frames lost", total, str(max(lost)), "", end_section=True)
    return table


def _spread(values: list[float | None], digits: int) -> tuple[str, str, str]:
    known = np.array([x for x in values if x is not None])
    if len(known) < len(values):
        return "–", "–", "–"
    median, worst = f"{np.median(known):.{digits}f}", f"{known.max():.{digits}f}"
    if len(known) == 1:
        return median, worst, "–"
    low, high = bootstrap_interval(known)
    return median, worst, f"{low:.{digits}f}–{high:.{digits}f}"


def _at(content: Any, key: tuple[str, ...]) -> float | None:
    for part in key:
        content = None if content is None else content[part]
    return content


def _write(out: Path, scores: "dict[str, list[Score]]") -> None:
    from vo.contract.files import write_text

    content = {name: [x.as_json() for x in of_scene] for name, of_scene in scores.items()}
    write_text(out, json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    guard(lambda: typer.run(accuracy))
