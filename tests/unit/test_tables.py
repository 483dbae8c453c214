"""Text tables: encodings, separators, headers, timestamps, and errors with file and line."""

import warnings

import numpy as np
import pytest

from vo.contract.errors import DatasetError
from vo.contract.remarks import Remark
from vo.recordings.tables import SECONDS, read_table

EPOCH_NS = 1403636579763555584
ROW = "a timestamp and a number"


def written(path, text, encoding="utf-8"):
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        ("#t,x\n5,1.5\n6,2\n", "utf-8"),
        ("#t,x\r\n5,1.5\r\n6,2\r\n", "utf-8-sig"),
        ("#t,x\r5,1.5\r6,2\r", "utf-8"),
        ("#t,x\n5,1.5\n6,2\n", "utf-16"),
        ("t;x\r\n5;1.5\r\n6;2\r\n", "utf-16-le"),
        ("t;x\r\n5;1.5\r\n6;2\r\n", "utf-16-be"),
        ("#t,x\n5,1.5\n6,2\n", "utf-32"),
        ("# angle in °\nt x\n5 1.5\n\n  6   2  \n", "latin-1"),
        ("t\tx\n5\t1.5\n6\t2\t\n", "utf-8"),
        ("% t,x\n5, 1.5,\n6, 2,,\n", "utf-8"),
        ('"t","x"\n"5","1.5"\n"6","2"\n', "utf-8"),
        ("'t';'x'\n'5';'1.5'\n'6';'2'\n", "utf-8"),
    ],
)
def test_table_is_read_in_every_notation(tmp_path, text, encoding):
    table = read_table(written(tmp_path / "x.csv", text, encoding))
    assert table.headers[-1][-1] == "x"
    assert table.times_ns(ROW, SECONDS).tolist() == [5 * SECONDS, 6 * SECONDS]
    assert table.numbers([1], ROW)[:, 0].tolist() == [1.5, 2.0]


@pytest.mark.parametrize("data", [b"\x89PNG\r\n\x1a\n\0\0", b"\xff\xfe\x00", b"1,2\n\0\0"])
def test_table_of_other_bytes_is_no_text(tmp_path, data):
    (tmp_path / "x.csv").write_bytes(data)
    with pytest.raises(DatasetError, match=r"x\.csv: not a text file"):
        read_table(tmp_path / "x.csv")


@pytest.mark.parametrize(
    "words",
    [
        ["1403636579763555584", "1403636579813555584"],
        ["1403636579763555584.0", "1403636579813555584.000000"],
        ["1.403636579763555584e18", "1.403636579813555584E+18"],
        ["1403636579.763555584", "1403636579.813555584"],
        ["1403636579.76355558400000000001", "1403636579.8135555839999999999"],
    ],
)
def test_timestamps_are_exact_in_every_notation(tmp_path, words):
    table = read_table(written(tmp_path / "x.csv", "".join(f"{x},1\n" for x in words)))
    assert table.times_ns(ROW).tolist() == [EPOCH_NS, EPOCH_NS + 50_000_000]


@pytest.mark.parametrize(
    ("start", "step", "unit"),
    [
        (1403636579763555, 50000, "microseconds"),
        (1403636579763, 33, "milliseconds"),
        (1403636579763.555, 33.333, "milliseconds"),
        (0, 50000, "microseconds"),
        (0, 50, "milliseconds"),
        (0, 33.333, "milliseconds"),
    ],
)
def test_milliseconds_and_microseconds_are_read_with_a_remark(tmp_path, start, step, unit):
    text = "".join(f"{start + i * step},1\n" for i in range(3))
    with pytest.warns(Remark, match=rf"x\.csv: timestamps are taken as {unit}"):
        times = read_table(written(tmp_path / "x.csv", text)).times_ns(ROW)
    step_ns = step * {"milliseconds": 10**6, "microseconds": 10**3}[unit]
    assert np.allclose(np.diff(times), step_ns, rtol=1e-4)


def test_whole_numbers_of_any_unit_are_refused(tmp_path):
    table = read_table(written(tmp_path / "x.csv", "0,1\n1,1\n2,1\n"))
    with pytest.raises(DatasetError, match=r"x\.csv:1: timestamps are 1 apart: seconds, milli"):
        table.times_ns(ROW)


@pytest.mark.parametrize(
    ("step", "unit_ns"), [(0.1, 10**9), (100, 10**6), (10**5, 10**3), (10**8, 1)]
)
def test_unit_is_that_which_fits_a_recording_from_zero(tmp_path, step, unit_ns):
    text = "".join(f"{i * step:.1f} 1\n" for i in range(20))
    table = read_table(written(tmp_path / "x.csv", text))
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("always")
        found = table.unit_ns(table.stamps(0, ROW), 1, 10**8 * np.arange(25))
    assert found == unit_ns


def test_units_that_fit_a_recording_alike_are_refused(tmp_path):
    table = read_table(written(tmp_path / "x.csv", "".join(f"{10 * i} 1\n" for i in range(317))))
    with pytest.raises(DatasetError, match=r"x\.csv:1: timestamps may be .* both fit the record"):
        table.unit_ns(table.stamps(0, ROW), 1, 10**8 * np.arange(1000))


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("1e400,1", "the timestamp 1e400 is out of range"),
        ("1e99999999999,1", "out of range"),
        ("nan,1", "the timestamp nan is out of range"),
        ("9.9e18,1", "out of range"),
        ("two,1", "two is not a number; expected a timestamp and a number"),
        ("2;1,5", "1,5 has a decimal comma"),
        ("2,1_000", "1_000 is not a number"),
        ("0x2,1", "0x2 is not a number"),
        ("2,0 1,5", "1,5 has a decimal comma"),
        ("2", "1 columns; expected a timestamp and a number"),
        ("2,inf", "inf is not finite"),
        ("1,7", r"1 ns repeats that of line 2"),
        ("0,7", r"0 ns is before that of line 2"),
    ],
)
def test_faults_of_a_row_name_file_and_line(tmp_path, row, message):
    table = read_table(written(tmp_path / "x.csv", f"t,x\n1,1\n{row}\n"))
    with pytest.raises(DatasetError, match=rf"x\.csv:3: .*{message}"):
        check(table)


def check(table):
    table.numbers([1], ROW)
    table.require_increasing(table.times_ns(ROW, 1))


@pytest.mark.parametrize("row", ["0x5;1", "5,5;1,5", "nan 1"])
def test_first_row_of_odd_numbers_is_no_header(tmp_path, row):
    with pytest.raises(DatasetError, match=r"x\.csv:1: "):
        check(read_table(written(tmp_path / "x.csv", f"{row}\n")))


def test_numbers_that_are_not_finite_are_kept_on_request(tmp_path):
    table = read_table(written(tmp_path / "x.csv", "1,nan\n2,3\n"))
    assert np.isnan(table.numbers([1], ROW, finite=False)[0, 0])
