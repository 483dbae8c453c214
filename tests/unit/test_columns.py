"""Tables of columns as CSV and Parquet, and the segments of a run in them."""

import csv
import sys

import numpy as np
import pytest
from terminal import driftyard

from trials.evaluation.runs import SavedRun
from trials.report.columns import columns_file
from trials.report.score_tables import SEGMENT, segment_table
from vo.contract.errors import SettingsError
from vo.contract.trajectory import Trajectory

SCHEMA = {"name": str, "count": int, "level": float, "is_lost": bool}
FIRST = {"name": "a", "count": np.arange(2), "level": np.array([0.5, np.nan]), "is_lost": True}
SECOND = {"name": ["b"], "count": [7], "level": [None], "is_lost": [False]}
ROWS = [("a", 0, 0.5, True), ("a", 1, None, True), ("b", 7, None, False)]


def write(path):
    with columns_file(path, SCHEMA) as append:
        append(FIRST)
        append(SECOND)
    return path


def test_csv_of_columns_has_their_rows(tmp_path):
    with write(tmp_path / "t.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header == [*SCHEMA]
    assert rows == [["" if x is None else str(x) for x in row] for row in ROWS]


def test_parquet_of_columns_has_their_rows_and_types(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs the extra parquet")
    table = parquet.read_table(write(tmp_path / "t.parquet"))
    assert [tuple(x.values()) for x in table.to_pylist()] == ROWS
    assert [str(x) for x in table.schema.types] == ["string", "int64", "double", "bool"]


def test_table_replaces_the_file_only_when_complete(tmp_path):
    path = write(tmp_path / "t.csv")
    before = path.read_bytes()

    def interrupt():
        with columns_file(path, SCHEMA) as append:
            append(FIRST)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        interrupt()
    assert path.read_bytes() == before
    assert [*tmp_path.iterdir()] == [path]


def test_parquet_without_pyarrow_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(SettingsError, match=r'pip install "driftyard\[parquet\]", or name a \.csv'):
        write(tmp_path / "t.parquet")
    done = driftyard("accuracy", "--segment-table", "s.parquet", cwd=tmp_path)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert [*tmp_path.iterdir()] == []


def test_segments_of_a_run_with_an_error_of_scale(tmp_path):
    """A straight path of 2 m that is estimated 10 % too long."""
    T = np.tile(np.eye(4), (21, 1, 1))
    T[:, 0, 3] = np.linspace(0, 2, 21)
    estimate = T.copy()
    estimate[:, 0, 3] *= 1.1
    times_ns = np.arange(21) * 10**8
    run = SavedRun(tmp_path / "r.txt", "one", Trajectory(times_ns, estimate))
    lost = SavedRun(tmp_path / "r.txt", "two", Trajectory(times_ns[:0], T[:0]))
    with segment_table(tmp_path / "s.csv", {"scene": str}) as add:
        add({"scene": "a"}, Trajectory(times_ns, T), run)
        add({"scene": "b"}, Trajectory(times_ns, T), lost)
    with (tmp_path / "s.csv").open() as file:
        rows = [*csv.DictReader(file)]
    assert [*rows[0]] == ["scene", *SEGMENT]
    lengths = [float(x["length_m"]) for x in rows]
    assert (lengths.count(1), lengths.count(2)) == (11, 1)
    assert [float(x["percent"]) for x in rows] == pytest.approx([10] * 12)
    assert [float(x["x_m"]) for x in rows[:11]] == pytest.approx(np.linspace(0, 1, 11))
    assert [int(x["start_ns"]) for x in rows[:11]] == times_ns[:11].tolist()
