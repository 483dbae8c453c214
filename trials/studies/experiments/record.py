"""Record of an experiment: figure, data, table and conclusion, as files."""

import json
from dataclasses import asdict, dataclass, fields
from itertools import zip_longest
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from trials.execution.jobs import Results
from trials.report.figure import save_figure
from trials.report.tables import write_csv
from trials.studies.experiments.base import Claim, Experiment, Scale, Verdict
from vo.contract.errors import DatasetError
from vo.contract.files import write_text

SCHEMA = "driftyard experiment 1"


@dataclass(frozen=True)
class Table:
    """Headings with units, and rows with a cell of text for each."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Record(Claim):
    """A claim and the result of its test.

    Attributes:
        verdict: On the claim.
        sentence: Reasons for the verdict.
        table: Measurements.
        figure: File name of the PNG, in the folder of the record.
        data: File names of the CSVs, likewise.
        seeds: Seeds of the recordings.
        distance_m: Length of each drive, unless the experiment sets its own.
    """

    verdict: Verdict
    sentence: str
    table: Table
    figure: str
    data: tuple[str, ...]
    seeds: tuple[int, ...]
    distance_m: float


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
    )
    content = {"schema": SCHEMA, **asdict(record)}
    write_text(out / f"{one.id}.json", json.dumps(content, indent=1) + "\n")
    return record


def read_record(file: Path) -> Record:
    """Read a record.

    Raises:
        DatasetError: If the file is not a record.
    """
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        if content.pop("schema", None) == SCHEMA:
            return TypeAdapter(Record).validate_python(content)
    except (OSError, ValueError, AttributeError):  # pydantic's errors are ValueErrors too
        pass
    raise DatasetError(f"{file}: not a record of an experiment ({SCHEMA})")
