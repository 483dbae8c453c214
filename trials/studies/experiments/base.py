"""Experiments: a claim, the jobs that test it, the conclusion, and the files of all that."""

import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from enum import StrEnum
from itertools import product, zip_longest
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from pydantic import TypeAdapter

from sim.camera_names import DEFAULT_CAMERA, IDEAL
from trials.execution.jobs import Job, Recording, Results, Variant, jobs_of
from trials.execution.runner import NO_LABELS
from trials.report.figure import save_figure
from trials.report.tables import write_csv
from vo.contract.arrays import Array
from vo.contract.errors import DatasetError
from vo.contract.files import write_text

SCHEMA = "driftyard experiment 1"

Rows = Iterator[Mapping[str, str]]
"""Rows of a table, each a heading with unit to a cell; all have the same headings."""
Data = Mapping[str, Mapping[str, Array]]
"""Name of a CSV file to its columns, each a name with unit to (N,) values of its own length."""


class Verdict(StrEnum):
    """Result of the test of a claim."""

    HOLDS = "holds"
    PARTLY = "holds in part"
    FAILS = "does not hold"
    OPEN = "cannot be decided"

    @staticmethod
    def of(in_part: bool | np.bool, in_full: bool | np.bool) -> "Verdict":
        """Return whether a claim holds in part and, if so, whether it holds in full."""
        if not in_part:
            return Verdict.FAILS
        return Verdict.HOLDS if in_full else Verdict.PARTLY


Finding = tuple[Verdict, str]
"""Verdict, and its reasons and conditions in a few sentences."""


@dataclass(frozen=True)
class Scale:
    """Drives of every setting: seeds, length, scenes at most, further settings and camera."""

    seeds: tuple[int, ...]
    distance_m: float
    max_scenes: int = 99
    overrides: tuple[str, ...] = ()
    camera: str = DEFAULT_CAMERA

    @property
    def drive(self) -> tuple[str, ...]:
        """Overrides of every recording: its length, and no labels, as none is needed."""
        return (f"drive.distance_m={self.distance_m:g}", *NO_LABELS, *self.overrides)

    def recordings(self, scenes: Sequence[str], seeds: int | None = None) -> list[Recording]:
        """Return drives through scenes, each with all or the first few seeds."""
        pairs = product(scenes[: self.max_scenes], self.seeds[:seeds])
        return [self.recording(*x) for x in pairs]

    def recording(
        self, scene: str, seed: int, settings: tuple[str, ...] = (), disturb: str = ""
    ) -> Recording:
        """Return a drive through a scene with further settings."""
        return Recording(scene, seed, (*self.drive, *settings), disturb, self.camera)

    def with_length(self, length_m: float) -> "Scale":
        """Replace the length of drives; a smaller scale shortens it in proportion."""
        return replace(self, distance_m=length_m * min(1.0, self.distance_m / FULL.distance_m))


FULL = Scale(seeds=(0, 1, 2), distance_m=4.0)
SMALL = Scale(
    seeds=(0,),
    distance_m=1.2,
    max_scenes=1,
    overrides=("rig.width_px=320", "rig.height_px=240", "rig.rate_hz=8"),
)
"""Scale of tests: it shows that an experiment runs, and is too small for its conclusion."""


@dataclass(frozen=True)
class Steps:
    """Functions that decide on a claim, tabulate, draw the figure, and return its data."""

    conclude: Callable[[Results], Finding]
    table: Callable[[Results], Rows]
    draw: Callable[[Figure, Results], None]
    data: Callable[[Results], Data]


@dataclass(frozen=True)
class Claim:
    """A claim, its place in the thesis, and how it is tested, as text.

    The setup describes the recordings and variants that are compared, the caption the figure.
    """

    id: str
    title: str
    claim: str
    source: str
    setup: str
    caption: str


@dataclass(frozen=True)
class Experiment(Claim):
    """A claim and its test; the size of the figure is width and height in inches."""

    size_in: tuple[float, float]
    recordings: Callable[[Scale], Sequence[Recording]]
    variants: Collection[Variant]
    steps: Steps

    def jobs(self, scale: Scale) -> list[Job]:
        """Combine every drive at a scale with every variant."""
        return jobs_of(self.recordings(scale), self.variants)


@dataclass(frozen=True)
class Table:
    """Headings with units, and rows with a cell of text for each."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Record(Claim):
    """A claim and the result of its test.

    Attributes:
        sentence: Reasons for the verdict.
        figure: File name of the PNG, in the folder of the record.
        data: File names of the CSVs, likewise.
        distance_m: Length of each drive, unless the experiment sets its own.
        camera: Camera of every drive; records of earlier versions name none.
    """

    verdict: Verdict
    sentence: str
    table: Table
    figure: str
    data: tuple[str, ...]
    seeds: tuple[int, ...]
    distance_m: float
    camera: str = IDEAL


def write_record(one: Experiment, results: Results, scale: Scale, out: Path) -> Record:
    """Evaluate an experiment, and write ID.png, ID-NAME.csv and, last, ID.json into a folder."""
    verdict, sentence = one.steps.conclude(results)
    save_figure(out / f"{one.id}.png", one.size_in, lambda figure: one.steps.draw(figure, results))
    data: list[str] = []
    for part, columns in one.steps.data(results).items():
        data.append(f"{one.id}-{part.replace(' ', '_').replace(',', '')}.csv")
        rows = zip_longest(*columns.values(), fillvalue=np.nan)
        cells = (["" if np.isnan(x) else f"{x:.6g}" for x in map(float, row)] for row in rows)
        write_csv(out / data[-1], list(columns), cells)
    table = list(one.steps.table(results))
    record = Record(
        **{x.name: getattr(one, x.name) for x in fields(Claim)},
        verdict=verdict,
        sentence=sentence,
        table=Table(tuple(table[0]), tuple(tuple(row.values()) for row in table)),
        figure=f"{one.id}.png",
        data=tuple(data),
        seeds=scale.seeds,
        distance_m=scale.distance_m,
        camera=scale.camera,
    )
    content = {"schema": SCHEMA, **asdict(record)}
    write_text(out / f"{one.id}.json", json.dumps(content, indent=1) + "\n")
    return record


def read_record(file: Path) -> Record:
    """Read a record; DatasetError if the file is none."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        if content.pop("schema", None) == SCHEMA:
            return TypeAdapter(Record).validate_python(content)
    except (OSError, ValueError, AttributeError):  # pydantic's errors are ValueErrors too
        pass
    raise DatasetError(f"{file}: not a record of an experiment ({SCHEMA})")
