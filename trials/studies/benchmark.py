"""Estimators on published recordings, in the form in which each benchmark is reported.

EuRoC and TUM-VI: absolute trajectory error after a rigid fit. KITTI: relative errors over all
segments of 100 to 800 m, or of 1 to 8 m where the path is shorter than 100 m.
"""

import json
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from trials.evaluation.display import html_display, text_display
from trials.evaluation.metrics import KITTI_LENGTHS_M
from trials.evaluation.score import FIGURES, Score
from trials.execution.cache import CACHE
from trials.execution.executor import compute
from trials.execution.jobs import Job, Recording, Result, Variant
from trials.execution.runner import cached_run
from trials.execution.tasks import Task
from trials.execution.variants import parse_estimators, repeated
from trials.report.tables import latex_table, markdown_table
from trials.studies.published import published_table
from vo.contract.errors import DatasetError, DriftyardError, SettingsError
from vo.contract.files import write_text
from vo.contract.remarks import remark
from vo.recordings.euroc import is_euroc
from vo.recordings.kitti import is_kitti
from vo.recordings.pairing import FrameSelection
from vo.recordings.readers import find_recordings, read_truth

PRESENT = FrameSelection(skip_missing=True)
"""All frames whose images are there: excerpts keep the tables of the whole."""
NOTHING = "–"
PUBLISHED = (
    "ATE, m, beside what others have published; theirs are of whole sequences and not computed here"
)


@dataclass(frozen=True)
class Figure:
    """A column of a benchmark: its label with unit, its digits and its value; None if undefined."""

    label: str
    digits: int
    of: Callable[[Score], float | None]


def _per_100m(score: Score) -> float | None:
    return None if score.kitti_deg_per_m is None else 100 * score.kitti_deg_per_m


@dataclass(frozen=True)
class Kind:
    """A benchmark: whether a folder has its layout, and its figures, the headline first."""

    fits: Callable[[Path], bool]
    figures: tuple[Figure, ...]


ATE = Figure("ATE after an SE(3) fit, RMSE, m", 3, FIGURES["ATE, SE(3), m"][0])
LOST = Figure("frames lost, %", 1, lambda x: 100 * x.statuses.get("lost", 0) / x.frames)
TIME = Figure("time per frame, median, ms, all cores busy", 1, lambda x: x.frame_ms)
SEGMENTS = (
    Figure("translation error over segments, %", 2, lambda x: x.kitti_percent),
    Figure("rotation error over segments, °/100 m", 2, _per_100m),
)
KINDS = {
    "euroc": Kind(is_euroc, (ATE, LOST, TIME)),
    "tumvi": Kind(is_euroc, (ATE, LOST, TIME)),
    "kitti": Kind(is_kitti, (*SEGMENTS, LOST, TIME)),
}


@dataclass(frozen=True)
class Trials:
    """The runs of one estimator over one recording: a score for each seed, None if it failed."""

    sequence: str
    estimator: str
    scores: tuple[Score | None, ...]
    problem: str

    def values(self, figure: Figure) -> list[float]:
        """Values of a figure, of those runs that have it."""
        found = [figure.of(x) for x in self.scores if x is not None]
        return [x for x in found if x is not None]

    def cell(self, figure: Figure) -> str:
        """Median of a figure over the seeds, and its range where they differ."""
        if not (values := self.values(figure)):
            return NOTHING
        low, middle, high = (f"{np.quantile(values, q):.{figure.digits}f}" for q in (0, 0.5, 1))
        return middle if low == high else f"{middle} ({low}–{high})"


@dataclass(frozen=True, repr=False)
class Benchmark:
    """All runs of a benchmark, by recording and estimator."""

    kind: str
    trials: tuple[Trials, ...]

    @cached_property
    def _by_name(self) -> Mapping[tuple[str, str], Trials]:
        return {(x.sequence, x.estimator): x for x in self.trials}

    @property
    def estimators(self) -> list[str]:
        """Names, in their order."""
        return list(dict.fromkeys(x.estimator for x in self.trials))

    @property
    def headline(self) -> Figure:
        """The first figure of the benchmark."""
        return KINDS[self.kind].figures[0]

    def table(self, figure: Figure) -> tuple[list[str], list[list[str]]]:
        """Header and rows of a figure: a row for each recording, and the mean of the medians."""
        names = list(dict.fromkeys(x.sequence for x in self.trials))
        rows = [[n, *(self._by_name[n, e].cell(figure) for e in self.estimators)] for n in names]
        if len(names) > 1:
            rows.append(["mean", *(self._mean(figure, e) for e in self.estimators)])
        return ["sequence", *self.estimators], rows

    def _mean(self, figure: Figure, estimator: str) -> str:
        """Mean over the recordings, and how many they are if not all."""
        every = [x.values(figure) for x in self.trials if x.estimator == estimator]
        medians = [float(np.median(x)) for x in every if x]
        if not medians:
            return NOTHING
        of = "" if len(medians) == len(every) else f" ({len(medians)} of {len(every)})"
        return f"{np.mean(medians):.{figure.digits}f}{of}"

    @property
    def notes(self) -> list[str]:
        """One line for each recording with segments of other lengths than KITTI's."""
        if self.headline not in SEGMENTS:
            return []
        found = {x.sequence: y.segments for x in self.trials for y in x.scores if y and y.segments}
        return [
            f"{name}: segments of {some[0].length_m:g} to {some[-1].length_m:g} m"
            for name, some in found.items()
            if some[0].length_m < KITTI_LENGTHS_M[0]
        ]

    def published(self) -> tuple[list[str], list[list[str]], list[str]]:
        """Header, rows and sources of our ATE beside what others have published.

        No rows where nothing is known of these recordings.
        """
        ours: dict[str, dict[str, float]] = {}
        for x in self.trials:
            if values := x.values(ATE):
                ours.setdefault(x.estimator, {})[x.sequence] = float(np.median(values))
        frames = {x.sequence: y.frames for x in self.trials for y in x.scores if y}
        return published_table(self.kind, ours, frames)

    @property
    def problems(self) -> list[str]:
        """One line for each estimator that failed on a recording."""
        return [f"{x.sequence}, {x.estimator}: {x.problem}" for x in self.trials if x.problem]

    def to_dict(self) -> dict[str, Any]:
        """Return every score of every run, and what others have published, ready for JSON."""
        header, rows, sources = self.published()
        return {
            "benchmark": self.kind,
            "machine": machine(),
            "runs": [asdict(x) for x in self.trials],
            "published": {"header": header, "rows": rows, "sources": sources},
        }

    def __repr__(self) -> str:
        header, rows = self.table(self.headline)
        lines = [(name, "  ".join(cells)) for name, *cells in (header, *rows)]
        return text_display(f"{self.kind}: {self.headline.label}", lines)

    def _repr_html_(self) -> str:
        header, rows = self.table(self.headline)
        return html_display(f"{self.kind}: {self.headline.label}", [header, *rows])


def recordings_of(kind: str, folder: Path) -> dict[str, Path]:
    """Find the recordings with a ground truth in a folder, by their names in tables.

    Raises:
        SettingsError: If there is no such benchmark.
        DatasetError: If the folder holds none.
    """
    if kind not in KINDS:
        raise SettingsError(f"unknown benchmark {kind}; valid: {', '.join(KINDS)}")
    found: dict[str, Path] = {}
    for path in filter(KINDS[kind].fits, find_recordings(folder)):
        name = str(path.relative_to(folder)) if path != folder else path.resolve().name
        if read_truth(path) is None:
            remark(f"{path}: has no ground truth and is left out")
            continue
        found[name] = path
    if not found:
        raise DatasetError(f"{folder}: holds no recording of {kind} with a ground truth")
    return found


def variants_of(estimators: Sequence[str], seeds: int) -> list[tuple[Variant, ...]]:
    """Return the variants of each estimator: one for each seed of RANSAC, or one without seed.

    Raises:
        SettingsError: If there is no such estimator, or it refuses a setting.
    """
    return [repeated(x, seeds) for x in parse_estimators(estimators)]


def run_benchmark(
    kind: str,
    recordings: Mapping[str, Path],
    estimators: Sequence[tuple[Variant, ...]],
    progress: Callable[[object], None],
    cache: Path = CACHE,
) -> Benchmark:
    """Run what the cache lacks, on all cores, and score it; a failure costs that run only."""
    jobs = [(name, variant) for name in recordings for some in estimators for variant in some]
    tasks = [
        Task("run", f"{x}, {y.label}", _score, (x, recordings[x].resolve(), y, cache))
        for x, y in jobs
    ]
    results = dict(zip(jobs, compute(tasks, progress), strict=True))
    trials: list[Trials] = []
    for name in recordings:
        for some in estimators:
            scores, problems = zip(*(results[name, variant] for variant in some), strict=True)
            problem = next(filter(None, problems), "")
            trials.append(Trials(name, some[0].label, scores, problem))
    return Benchmark(kind, tuple(trials))


def _score(name: str, dataset: Path, variant: Variant, cache: Path) -> tuple[Score | None, str]:
    try:
        file = cached_run(dataset, variant, cache, PRESENT)
    except DriftyardError as error:
        return None, str(error)
    score = Result(Job(Recording(name, 0), variant), dataset, file).score
    return score, "" if score else "has fewer than two poses with a truth"


def write_benchmark(benchmark: Benchmark, folder: Path, command: str) -> list[Path]:
    """Write all figures as Markdown, LaTeX and JSON; return the files."""
    tables = {x.label: benchmark.table(x) for x in KINDS[benchmark.kind].figures}
    said = [f"`{command}` on {machine()}. Medians over seeds, with their range.", *benchmark.notes]
    about = " ".join(said)
    markdown = "\n\n".join(f"**{x}**\n\n{markdown_table(*y, True)}" for x, y in tables.items())
    latex = "\n\n".join(f"% {label}\n{latex_table(*table)}" for label, table in tables.items())
    header, rows, sources = benchmark.published()
    if rows:
        beside = "\n".join(f"- {x}" for x in sources)
        markdown += f"\n\n**{PUBLISHED}**\n\n{markdown_table(header, rows)}\n\n{beside}"
        comments = "".join(f"% {x}\n" for x in sources)
        latex += f"\n\n% {PUBLISHED}\n{comments}{latex_table(header, rows)}"
    content = {"command": command} | benchmark.to_dict()
    written = {
        "md": f"{about}\n\n{markdown}\n",
        "tex": f"% {about}\n{latex}\n",
        "json": json.dumps(content, indent=1, allow_nan=False) + "\n",
    }
    for suffix, text in written.items():
        write_text(folder / f"{benchmark.kind}.{suffix}", text)
    return [folder / f"{benchmark.kind}.{suffix}" for suffix in written]


def machine() -> str:
    """Name the processor and the number of cores that this process may use."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text("utf-8").splitlines() if cpuinfo.is_file() else [""]
    names = [x.partition(":")[2].strip() for x in lines if x.startswith("model name")]
    return f"{names[0] if names else platform.processor() or platform.machine()}, " + (
        f"{len(os.sched_getaffinity(0))} cores"
    )
