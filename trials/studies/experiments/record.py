"""What an experiment leaves behind: a figure, its data, and a record of what was found."""

import csv
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from trials.report.figure import save_figure
from trials.studies.experiments.experiment import Experiment, Findings, Scale, TableOf, Verdict
from vo.contract.errors import DatasetError
from vo.contract.files import replacing, write_text

SCHEMA = "driftyard experiment 1"


@dataclass(frozen=True)
class Record:
    """An experiment and its findings, as text.

    Attributes:
        id: Of the experiment.
        title: Its.
        claim: Its.
        source: Its.
        setup: Its.
        verdict: On the claim.
        sentence: Why.
        table: The figures behind it.
        caption: Of the figure.
        figure: File name of the PNG, beside the record.
        data: File names of the CSVs, likewise.
        seeds: Of the recordings.
        distance_m: Of each drive, where the experiment does not choose its own.
    """

    id: str
    title: str
    claim: str
    source: str
    setup: str
    verdict: Verdict
    sentence: str
    table: TableOf
    caption: str
    figure: str
    data: tuple[str, ...]
    seeds: tuple[int, ...]
    distance_m: float


def write_record(experiment: Experiment, findings: Findings, scale: Scale, out: Path) -> Record:
    """Write ID.png, ID-NAME.csv and, last, ID.json into a folder."""
    name = experiment.id
    save_figure(out / f"{name}.png", experiment.size_in, findings.draw)
    data: list[str] = []
    for part, columns in findings.data.items():
        data.append(f"{name}-{part.replace(' ', '_').replace(',', '')}.csv")
        _write_csv(out / data[-1], columns)
    record = Record(
        experiment.id,
        experiment.title,
        experiment.claim,
        experiment.source,
        experiment.setup,
        findings.verdict,
        findings.sentence,
        findings.table,
        findings.caption,
        f"{name}.png",
        tuple(data),
        scale.seeds,
        scale.distance_m,
    )
    content = {"schema": SCHEMA, **asdict(record)}
    write_text(out / f"{name}.json", json.dumps(content, indent=1) + "\n")
    return record


def read_record(file: Path) -> Record:
    """Read what `write_record` wrote.

    Raises:
        DatasetError: If it is something else.
    """
    try:
        content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        if content.pop("schema", None) == SCHEMA:
            return TypeAdapter(Record).validate_python(content)
    except (OSError, ValueError, AttributeError):  # pydantic's errors are ValueErrors too
        pass
    raise DatasetError(f"{file}: not a record of an experiment ({SCHEMA})")


def _write_csv(file: Path, columns: Any) -> None:
    with replacing(file) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            table.writerow("" if np.isnan(x) else f"{x:.6g}" for x in map(float, row))
