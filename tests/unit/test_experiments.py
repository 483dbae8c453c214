"""What experiments measure, their records and their pages, on runs made by hand."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from trials.evaluation.runs import read_map
from trials.execution.jobs import Job, Recording, Result, Results, Variant
from trials.studies.experiments.base import (
    FULL,
    SMALL,
    Experiment,
    Steps,
    Verdict,
    read_record,
    write_record,
)
from trials.studies.experiments.e11_stationary import stationary_drift, stops
from trials.studies.experiments.measures import (
    first_failure,
    step_errors_m,
    tracked_fraction,
)
from trials.studies.experiments.orientation import inlier_rise
from trials.studies.experiments.page import page_text, write_html_page
from trials.studies.experiments.registry import EXPERIMENTS
from vo.contract import se3
from vo.contract.errors import DatasetError, TrajectoryError
from vo.contract.estimator import Estimate, PointMap, Status
from vo.contract.trajectory import Trajectory, write_tum
from vo.runner import Run, write_map, write_run

PERIOD_NS = 100_000_000
STEP_M = 0.02


def drive(frames: int, step_m: float = STEP_M) -> np.ndarray:
    """Poses (N, 4, 4) along x."""
    T = np.tile(np.eye(4), (frames, 1, 1))
    T[:, 0, 3] = step_m * np.arange(frames)
    return T


def result(tmp_path: Path, truth: np.ndarray, estimate: list, inliers: list[int]) -> Result:
    """An result whose run is written by the runner; `None` is a lost frame."""
    estimates = tuple(
        Estimate(PERIOD_NS * i, Status.LOST if T is None else Status.TRACKED, T, "",
                 {"consensus": n})
        for i, (T, n) in enumerate(zip(estimate, inliers, strict=True))
    )  # fmt: skip
    file = tmp_path / "run.txt"
    run = Run("made", estimates, tuple(1.0 for _ in estimates))
    write_run(file, run, "made", {}, tmp_path)
    made = Result(Job(Recording("office", 0), Variant("made")), tmp_path, file)
    vars(made)["truth"] = Trajectory(PERIOD_NS * np.arange(len(truth)), truth)
    return made


def test_a_wrong_step_breaks_a_drive(tmp_path):
    truth = drive(20)
    estimate = truth.copy()
    estimate[12:, 1, 3] += 0.2
    run = result(tmp_path, truth, list(estimate), [50] * 20)
    errors = step_errors_m(run)
    assert np.isnan(errors[0])
    assert errors[12] == pytest.approx(0.2)
    assert np.nanmax(np.delete(errors, 12)) < 1e-9
    assert first_failure(run) == 12
    assert tracked_fraction(run) == 12 / 20


def test_a_lost_frame_breaks_a_drive(tmp_path):
    truth = drive(10)
    estimate: list = list(truth)
    estimate[4] = None
    run = result(tmp_path, truth, estimate, [50, 40, 40, 40, 0, 90, 90, 90, 90, 40])
    assert first_failure(run) == 4
    assert run.lost_share == 0.1
    assert inlier_rise(run) == pytest.approx(np.mean([0, 90, 90, 90, 90]) / 40)


def test_a_whole_drive_does_not_break(tmp_path):
    run = result(tmp_path, drive(6), list(drive(6)), [9] * 6)
    assert first_failure(run) is None
    assert tracked_fraction(run) == 1.0
    assert inlier_rise(run) is None


def test_a_run_without_poses_is_read_and_has_no_score(tmp_path):
    run = result(tmp_path, drive(4), [None] * 4, [0] * 4)
    assert len(run.run.trajectory) == 0
    assert first_failure(run) == 0
    assert run.lost_share == 1.0


def test_drift_at_rest_counts_halts_only(tmp_path):
    x_m = np.concatenate([np.arange(15) * STEP_M, np.full(30, 0.28), 0.28 + np.arange(15) * STEP_M])
    truth = np.tile(np.eye(4), (60, 1, 1))
    truth[:, 0, 3] = x_m
    estimate = truth.copy()
    creep = np.clip(np.arange(60) - 14, 0, 30)
    estimate[:, 2, 3] += 1e-4 * creep  # 0.1 mm a frame while standing
    estimate = estimate @ se3.exp(np.outer(creep, [0, 0, 0, 0, 1e-5, 0]))
    truth[30:, 2, 3] += 5e-5  # what truly moves is no drift
    estimate[30:, 2, 3] += 5e-5
    run = result(tmp_path, truth, list(estimate), [50] * 60)
    ((first, last),) = stops(run)
    assert (first, last) == (14, 45)
    seconds, moved_mm, turned_deg = stationary_drift(run)
    assert seconds == pytest.approx(3.1)
    assert moved_mm == pytest.approx(3.0, rel=1e-3)
    assert turned_deg == pytest.approx(np.degrees(3e-4), rel=1e-3)


def test_every_experiment_of_the_thesis_is_there():
    assert [f"E{k}" for k in range(1, 13)] == list(EXPERIMENTS)[:12]
    for name, experiment in EXPERIMENTS.items():
        assert experiment.id == name
        jobs = experiment.jobs(FULL)
        assert len(set(jobs)) == len(jobs)
        assert {t.recording.seed for t in jobs} <= set(FULL.seeds)
        assert len(experiment.jobs(SMALL)) <= len(jobs)


MADE = Experiment(
    id="X1",
    title="A made-up thing",
    claim="It is so.",
    source="nowhere",
    setup="Nothing was done.",
    caption="A line.",
    size_in=(3.0, 2.0),
    recordings=lambda _: [],
    variants=(),
    steps=Steps(
        conclude=lambda _: (Verdict.PARTLY, "It is so & so."),
        table=lambda _: iter(
            [
                {"what": "this", "how much, %": "1"},
                {"what": "that", "how much, %": "2"},
            ]
        ),
        draw=lambda figure, _: figure.subplots().plot([0, 1], [0, 2]),
        data=lambda _: {"a line": {"x": np.arange(3), "y": np.array([0.5])}},
    ),
)
NOTHING = Results({})


def test_records_come_back_as_they_were(tmp_path):
    record = write_record(MADE, NOTHING, SMALL, tmp_path)
    assert read_record(tmp_path / "X1.json") == record
    with (tmp_path / "X1-a_line.csv").open() as file:
        assert list(csv.reader(file)) == [["x", "y"], ["0", "0.5"], ["1", ""], ["2", ""]]
    assert (tmp_path / "X1.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("change", [{"schema": "driftyard experiment 0"}, {"verdict": "perhaps"}])
def test_a_record_of_another_schema_is_refused(tmp_path, change):
    write_record(MADE, NOTHING, SMALL, tmp_path)
    file = tmp_path / "X1.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), **change}))
    with pytest.raises(DatasetError, match=r"X1\.json: not a record"):
        read_record(file)


def test_pages_hold_every_part(tmp_path):
    record = write_record(MADE, NOTHING, SMALL, tmp_path)
    text = page_text([record, replace(record, id="X2")], "pictures")
    assert "[X1](#x1-a-made-up-thing)" in text
    assert "## X1. A made-up thing" in text
    assert "![A made-up thing](pictures/X1.png)" in text
    assert "| what | how much, % |" in text
    assert "| this | 1 |" in text
    write_html_page([record], tmp_path, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "It is so &amp; so." in page
    assert 'download="X1-a_line.csv"' in page
    assert "http" not in page.replace("http-equiv", "")


def test_maps_come_back_with_their_identifiers(tmp_path):
    points = PointMap(
        np.array([7, 3]),
        np.array([[1, 2, 3], [4, 5, 6.5]]),
        np.array([9, 200], np.uint8),
        np.array([3, 12]),
    )
    write_map(tmp_path / "m.ply", points)
    found = read_map(tmp_path / "m.ply")
    for name, values in vars(points).items():
        assert (getattr(found, name) == values).all(), name


@pytest.mark.parametrize(
    "content", [b"", b"ply\nend_header\n", b"ply\nproperty float x\nend_header\n"]
)
def test_another_map_is_refused(tmp_path, content):
    (tmp_path / "m.ply").write_bytes(content)
    with pytest.raises(TrajectoryError, match=r"m\.ply"):
        read_map(tmp_path / "m.ply")


def test_a_trajectory_without_record_must_hold_poses(tmp_path):
    write_tum(tmp_path / "t.txt", Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4))))
    from trials.evaluation.runs import read_run

    with pytest.raises(TrajectoryError, match="holds no poses"):
        read_run(tmp_path / "t.txt")
