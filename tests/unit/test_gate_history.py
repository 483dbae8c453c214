"""History of a gate: records that checks append, their trends, and the command that prints them."""

import json
import subprocess
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import numpy as np
import pytest
from terminal import driftyard

from trials.gate.baseline import Baseline, Design, Measurement, Recorded, Rules
from trials.gate.comparison import Comparison
from trials.gate.decision import decide
from trials.gate.drive_table import write_checked_drives
from trials.gate.history import (
    CheckRecord,
    FigureRecord,
    SceneRecord,
    append_record,
    read_history,
    record_of,
)
from trials.gate.trends import (
    comparable,
    draw,
    figure_size_in,
    scene_trends,
    trend,
    trends,
)
from trials.report.figure import make_figure
from vo.contract.errors import DatasetError

SCENES = tuple("abcde")


def measured(drift=0.1):
    return Measurement(frames=9, lost_frames=0, drift_percent=drift, frame_ms=4.0, reference_ms=2.0)


@pytest.fixture
def comparison():
    """Of five scenes with two seeds each, `c` drifts twice as much."""
    design = Design(scenes=SCENES, seeds=2)
    baseline = Baseline(
        estimator="one", settings={}, reference="corner_flow", rules=Rules(), design=design,
        platform="", generator="", software={},
        sequences=tuple(
            Recorded(scene=scene, seed=seed, sha256=f"{scene}{seed}", measured=measured())
            for scene, seed in design.sequences
        ),
    )  # fmt: skip
    ratios = np.exp(np.random.default_rng(0).normal(0, 0.02, 10)) * [1, 1, 1, 1, 2, 2, 1, 1, 1, 1]
    after = [measured(0.1 * x) for x in ratios]
    decision = decide(Rules(), baseline.scenes, baseline.measured, after)
    return Comparison(baseline, "two", {}, {}, after, decision, ())


def record(day, drift, **changes):
    figure = FigureRecord(verdict="pass", baseline=0.1, now=drift, ratio=drift / 0.1)
    content = {
        "commit": f"{day:040x}", "checked": datetime(2026, 1, 1, tzinfo=UTC) + timedelta(days=day),
        "estimator": "one", "baseline": "one", "sequences": "s", "number": 9,
        "verdict": "pass", "why": "",
        "figures": {"drift": figure},
    }  # fmt: skip
    return CheckRecord(**{**content, **changes})


def write(path, records):
    for x in records:
        append_record(path, x)
    return path


def test_record_names_commit_figures_and_scene(comparison, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert record_of(comparison, "v1").commit in ("v1", "")
    git = ("git", "-c", "user.name=a", "-c", "user.email=a@b.c")
    for words in (("init", "-q"), ("commit", "-q", "--allow-empty", "-m", "one")):
        subprocess.run([*git, *words], check=True)
    found = record_of(comparison)
    assert len(found.commit) == 40
    assert (found.committed is not None, found.has_changes) == (True, False)
    assert found.figures["drift"].ratio == pytest.approx(2**0.2, rel=0.03)
    assert found.figures["losses"].now == 0
    assert found.regressed == ["c"]
    append_record(tmp_path / "h.jsonl", found)
    append_record(tmp_path / "h.jsonl", found)
    assert read_history([tmp_path]) == [found]


def test_history_is_sorted_and_files_are_joined(tmp_path):
    write(tmp_path / "x/one.jsonl", [record(3, 0.1), record(1, 0.1)])
    write(tmp_path / "x/two.jsonl", [record(2, 0.1), record(1, 0.1)])
    found = read_history([tmp_path / "x"])
    assert [x.checked.day for x in found] == [2, 3, 4]


def test_record_after_an_interrupted_write_is_kept_apart(tmp_path):
    path = write(tmp_path / "h.jsonl", [record(1, 0.1)])
    path.write_text(path.read_text() + '{"kind": "dri')
    append_record(path, record(2, 0.1))
    with pytest.raises(DatasetError, match=r"h\.jsonl:2: not a record"):
        read_history([path])
    assert len(path.read_text().splitlines()) == 3


def test_trend_of_two_percent_a_check_is_found():
    values = 0.1 * 1.02 ** np.arange(12) * np.exp(np.random.default_rng(0).normal(0, 0.01, 12))
    found = trend("drift", values)
    assert found.low < 0.02 < found.high
    assert found.per_check == pytest.approx(0.02, abs=0.003)
    assert str(found).startswith("drift, % rises: 0.100 to 0.12")
    assert trend("drift", values[::-1]).direction == "falls"
    noise = np.exp(np.random.default_rng(1).normal(0, 0.01, 12))
    assert trend("drift", noise).direction == "level"
    assert trend("drift", np.array([0.1, np.nan, 0.1, 0.1, 0.1])) is None


def test_trend_is_of_the_same_sequences_and_estimator():
    old = [record(k, 0.1 * 1.1**k, sequences="other") for k in range(6)]
    new = [record(6 + k, 0.3, sequences="s") for k in range(5)]
    other = record(20, 0.9, estimator="two")
    assert comparable([*old, *new[:3], other, *new[3:]]) == new
    (found,) = trends([*old, *new])
    assert (found.direction, found.checks) == ("level", 5)


def test_scene_whose_drift_rises_is_named():
    """Among others that vary as much by chance."""
    rng = np.random.default_rng(3)
    names = [f"scene {k}" for k in range(12)]

    def scenes(k):
        drifts = {x: 0.1 * np.exp(rng.normal(0, 0.02)) for x in names}
        drifts["scene 7"] *= 1.03**k
        unknown = {"sequences": 2, "newly_lost": 0, "p": None, "q": None, "verdict": ""}
        return [
            SceneRecord(scene=x, drift_percent=0.2, ratio=y / 0.2, **unknown)
            for x, y in drifts.items()
        ]

    records = [record(k, 0.1, scenes=tuple(scenes(k))) for k in range(12)]
    (found,) = scene_trends(records)
    assert str(found).startswith("drift, % in scene 7 rises: 0.1")
    assert not scene_trends(records[:4])


def test_figure_separates_sequences_and_marks_scenes(comparison):
    records = [record(1, 0.2, sequences="other"), record_of(comparison), record_of(comparison)]
    figure = make_figure(figure_size_in(records), lambda x: draw(x, records))
    figure.draw_without_rendering()
    titles = [x.get_title() or x.get_title(loc="left") for x in figure.axes]
    assert "drift, %" in titles
    crosses = [line for x in figure.axes for line in x.lines if line.get_marker() == "X"]
    assert [line.get_xdata()[0] for line in crosses] == [1, 2]


def test_gate_history_prints_checks_and_trend(tmp_path):
    write(tmp_path / "h.jsonl", [record(k, 0.1 * 1.05**k) for k in range(8)])
    done = driftyard("gate", "history", "h.jsonl", "--figure", "h.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "2026-01-08" in done.stdout
    assert "drift, % rises: 0.100 to 0.141 over 8 checks, +5.00 % a check" in done.stdout
    assert (tmp_path / "h.png").stat().st_size > 5000
    few = driftyard("gate", "history", "h.jsonl", "--last", "3", cwd=tmp_path)
    assert "no trend: fewer than 5 checks" in few.stdout


def test_gate_history_bad_input_ends_in_one_line(tmp_path, comparison):
    (tmp_path / "bad.jsonl").write_text("[1, 2]\n")
    (tmp_path / "key.jsonl").write_text(record(1, 0.1).model_dump_json().replace('"why"', '"y"'))
    (tmp_path / "new.jsonl").write_text('{"kind": "driftyard gate record", "schema_version": 9}')
    (tmp_path / "empty").mkdir()
    cases = {
        ("history", "bad.jsonl"): "bad.jsonl:1: not a record of",
        ("history", "key.jsonl"): "key.jsonl:1: ",
        ("history", "new.jsonl"): "new.jsonl:1: record of schema 9, this program reads 1",
        ("history", "none.jsonl"): "none.jsonl: cannot be read",
        ("history", "empty"): "empty: no records; `driftyard gate check --history",
        ("check", "--baseline", "b", "--history", "bad.jsonl"): "bad.jsonl:1: not a record of",
        ("check", "--baseline", "b", "--history", "h.json"): "h.json: the name of a history must",
        ("check", "--baseline", "b", "--commit", "a"): "--commit a: needs --history",
        ("check", "--baseline", "b", "--drive-table", "a.txt"): "a.txt: the name must end in",
    }
    for words, message in cases.items():
        done = driftyard("gate", *words, cwd=tmp_path)
        assert done.returncode == 2, words
        assert message in done.stderr
        assert len(done.stderr.splitlines()) == 1, done.stderr


def test_drive_table_has_a_row_for_each_drive(comparison, tmp_path):
    after = [*comparison.measured[:-1], Measurement(frames=9, lost_frames=9, problem="died")]
    write_checked_drives(tmp_path / "d.csv", replace(comparison, measured=after))
    header, *rows = [x.split(",") for x in (tmp_path / "d.csv").read_text().splitlines()]
    assert len(rows) == 10
    first, last = (
        SimpleNamespace(**dict(zip(header, x, strict=True))) for x in rows[:: len(rows) - 1]
    )
    assert (first.scene, first.seed, first.baseline_drift_percent) == ("a", "0", "0.1")
    assert float(first.log_drift_ratio) == pytest.approx(
        np.log(float(first.now_drift_percent) / 0.1)
    )
    assert (last.now_is_lost, last.now_drift_percent, last.problem) == ("True", "", "died")
    assert json.loads(comparison.baseline.model_dump_json())["estimator"] == first.baseline
