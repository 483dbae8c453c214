"""The commands route signals and route timing: tables, a begin, and refusals in one line."""

import pytest
from terminal import driftyard


def test_route_signals_prints_both_tables_and_their_share(tmp_path):
    done = driftyard("route", "signals", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = [" ".join(line.split()) for line in done.stdout.splitlines()]
    assert rows[0] == "high congestion 4+7 4+8 3+8 3+7 2+5 2+6 1+6 1+5"
    assert "north to south, 4 4+7* 4+7 4+7 4+7 4+7 4+7 4+7 4+7" in rows
    assert "north to south, 4 4+7* 4+8* 4+8 4+8 4+8 4+8 4+8 4+8" in rows
    assert rows[-1] == "both select the same in 12 of 96 cells, 12.5 %"


def test_route_signals_shows_one_present_phase_and_side(tmp_path):
    done = driftyard("route", "signals", "--present", "3+8", "--from", "north", cwd=tmp_path)
    rows = [" ".join(line.split()) for line in done.stdout.splitlines()]
    assert [x for x in rows if x.startswith("north to south")] == [
        "north to south, 4 4+7", "north to south, 4 4+8",
    ]  # fmt: skip
    assert not [x for x in rows if x.startswith("west")]


COUNTS = "# s, arrived, departed\n0,0,0\n20,4,4\n30,6,7\n60,12,7\n"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], ["the preemption begins at 51.00 s"]),
        (["--queue", "8"], ["queue 8.00 vehicles a lane, its delay 18.00 s", "begins at 33.00 s"]),
        (
            ["--counts", "c.csv", "--green-start", "20", "--green-length", "10"],
            ["queue 5.00 vehicles", "begins at 39.00 s"],
        ),
        (
            ["--counts", "c.csv", "--green-start", "55", "--lanes", "2"],
            ["queue 0.00 vehicles", "begins at 49.00 s"],
        ),
    ],
)
def test_route_timing_computes_the_begin(tmp_path, words, expected):
    (tmp_path / "c.csv").write_text(COUNTS)
    done = driftyard("route", "timing", "--arrival", "60", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for text in expected:
        assert text in done.stdout


def test_route_timing_remarks_that_more_departed_than_arrived(tmp_path):
    (tmp_path / "c.csv").write_text("0,0,0\n50,3,9\n")
    words = ("--arrival", "60", "--counts", "c.csv", "--green-start", "1")
    done = driftyard("route", "timing", *words, cwd=tmp_path)
    assert done.returncode == 0
    (line,) = done.stderr.splitlines()
    assert line.startswith("driftyard: remark: c.csv: 9 vehicles departed, but only 3 arrived")


@pytest.mark.parametrize(
    ("words", "fragment"),
    [
        (["signals", "--phases", "4+7,4+8"], "no phase lets these movements through"),
        (["signals", "--present", "4+6"], "--present 4+6: expected one of 4+7, "),
        (["signals", "--from", "up"], "--from up: expected one of north, "),
        (["timing", "--arrival", "60", "--counts", "empty.csv", "--green-start", "3"], "no counts"),
        (["timing", "--arrival", "60", "--counts", "none.csv", "--green-start", "3"], "none.csv"),
        (["timing", "--arrival", "60", "--counts", "c.csv"], "needs --green-start"),
        (
            ["timing", "--arrival", "60", "--counts", "c.csv", "--green-start", "99"],
            "--green-start 99: c.csv counts from 0 to 60 s",
        ),
        (["timing", "--arrival", "60", "--counts", "c.csv", "--queue", "3"], "one of both"),
        (["timing", "--arrival", "60", "--counts", "bad.csv", "--green-start", "3"], "bad.csv:2: "),
        (["timing", "--arrival", "nan"], "--arrival"),
    ],
)
def test_route_commands_refuse_wrong_input_in_one_line(tmp_path, words, fragment):
    (tmp_path / "c.csv").write_text(COUNTS)
    (tmp_path / "empty.csv").write_text("# s, arrived, departed\n")
    (tmp_path / "bad.csv").write_text("0,0,0\n20,many,4\n")
    done = driftyard("route", *words, cwd=tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("driftyard: error: ")
    assert fragment in line
