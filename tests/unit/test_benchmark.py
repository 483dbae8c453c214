"""Benchmarks of published recordings: all of a folder, with spread, resumable, in four forms."""

import json

import pytest
from folders import BASELINE_M, DISPARITY_PX, wall, write_euroc
from terminal import driftyard

from trials.evaluation.score import Score
from trials.report.tables import latex_table
from trials.studies.benchmark import ATE, KINDS, LOST, Benchmark, Figure, Trials

FRAMES, STEP_PX = 5, 4
STEP_M = STEP_PX / DISPARITY_PX * BASELINE_M


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two sequences in folders of different depth, one without truth and one without its images."""
    root = tmp_path_factory.mktemp("published")
    for name, step_m in (("hall/one", STEP_M), ("two", STEP_M), ("three", None)):
        write_euroc(root / "data" / name, wall(FRAMES, STEP_PX), truth_step_m=step_m)
    broken = write_euroc(root / "data" / "zero", wall(FRAMES, STEP_PX), truth_step_m=STEP_M)
    for file in (broken / "mav0/cam1/data").iterdir():
        file.unlink()
    return root


def run(folder, *words):
    return driftyard("benchmark", *words, "--estimator", "corner_flow", "--seeds", 2, cwd=folder)


def test_benchmark_runs_every_recording_with_truth(folder):
    result = run(folder, "euroc", "data")
    assert result.returncode == 0, result.stderr
    for name in ("hall/one", "two", "zero", "mean", ATE.label, LOST.label):
        assert name in result.stdout
    assert "data/three: has no ground truth and is left out" in result.stderr
    assert "zero, corner_flow: " in result.stderr  # the reason; the others have their figures
    made = json.loads((folder / "build/benchmark/euroc.json").read_text())
    assert made["command"].startswith("driftyard benchmark euroc data")
    scores = {x["sequence"]: x["scores"] for x in made["runs"]}
    assert {name: len(some) for name, some in scores.items()} == {
        "hall/one": 2,
        "two": 2,
        "zero": 2,
    }
    assert scores["zero"] == [None, None]
    for name in ("hall/one", "two"):
        assert scores[name][0]["frames"] == FRAMES
        assert 0 < scores[name][0]["ate_m"]["se3"]["rmse"] < 0.1 * STEP_M
    assert "(2 of 3)" in result.stdout
    text = {x: (folder / f"build/benchmark/euroc.{x}").read_text() for x in ("md", "tex")}
    assert f"**{ATE.label}**" in text["md"]
    assert "| two | " in text["md"]
    assert r"two & " in text["tex"]


def test_benchmark_again_reuses_the_runs(folder):
    runs = folder / "build/cache/runs"
    if not runs.is_dir():
        assert run(folder, "euroc", "data").returncode == 0
    before = {file: file.stat().st_mtime_ns for file in runs.iterdir()}
    assert before
    assert run(folder, "euroc", "data").returncode == 0
    assert {file: file.stat().st_mtime_ns for file in runs.iterdir()} == before


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["moon", "data"], "unknown benchmark moon; valid: euroc, tumvi, kitti"),
        (["kitti", "data"], "data: holds no recording of kitti with a ground truth"),
        (["euroc", "nowhere"], "nowhere: no such folder"),
    ],
)
def test_benchmark_bad_input_ends_in_one_line(folder, words, complaint):
    result = run(folder, *words)
    assert result.returncode == 2
    assert complaint in result.stderr.splitlines()[-1]


def test_benchmark_unknown_estimator_is_refused_before_any_run(folder):
    result = driftyard("benchmark", "euroc", "data", "--estimator", "foo", cwd=folder)
    assert result.returncode == 2
    assert "unknown estimator foo; valid: corner_flow" in result.stderr


def trials(sequence: str, estimator: str, *figures: float) -> Trials:
    """Runs whose score is replaced by its only figure."""
    return Trials(sequence, estimator, tuple(figures), "")


def test_table_has_median_range_and_mean():
    plain = Figure("error, m", 2, lambda x: x)
    found = Benchmark(
        "euroc",
        (
            trials("a", "ours", 0.1, 0.3, 0.2), trials("a", "theirs", 0.5),
            trials("b", "ours", 0.4, 0.4), Trials("b", "theirs", (None,), "lost"),
        ),
    )  # fmt: skip
    header, rows = found.table(plain)
    assert header == ["sequence", "ours", "theirs"]
    assert rows == [
        ["a", "0.20 (0.10–0.30)", "0.50"],
        ["b", "0.40", "–"],
        ["mean", "0.30", "0.50 (1 of 2)"],
    ]
    assert found.problems == ["b, theirs: lost"]


def test_kitti_states_segments_that_are_shorter(real_data, tmp_path):
    folder = real_data("kitti_06")
    result = run(tmp_path, "kitti", folder)
    assert result.returncode == 0, result.stderr
    assert "kitti_06: segments of 1 to 8 m" in result.stdout
    (some,) = json.loads((tmp_path / "build/benchmark/kitti.json").read_text())["runs"]
    figures = [KINDS["kitti"].figures[k].of(Score(**some["scores"][0])) for k in (0, 1)]
    assert 0.8 < figures[0] < 1.5
    assert 1.0 < figures[1] < 5.0


def test_latex_escapes_and_aligns():
    lines = latex_table(["sequence", "drift, %"], [["kitti_06", "1 (0–2)"], ["°", "–"]]).split("\n")
    assert lines[0] == r"\begin{tabular}{lr}"
    assert lines[2] == r"sequence & drift, \% \\"
    assert lines[4] == r"kitti\_06 & 1 (0--2) \\"
    assert lines[5] == r"$^\circ$ & -- \\"
