"""Benchmarks of published recordings: all of a folder, with spread, resumable, in four forms."""

import json

import pytest
from folders import BASELINE_M, DISPARITY_PX, wall, write_euroc
from terminal import driftyard

from trials.evaluation.score import Score
from trials.report.tables import latex_table
from trials.studies.benchmark import ATE, KINDS, LOST, Benchmark, Figure, Trials
from trials.studies.published import published, published_table, sequence_of

FRAMES, STEP_PX = 5, 4
STEP_M = STEP_PX / DISPARITY_PX * BASELINE_M


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two sequences in folders of different depth, one without truth and one without its images."""
    root = tmp_path_factory.mktemp("published")
    for name, step_m in (("hall/V1_01_easy", STEP_M), ("two", STEP_M), ("three", None)):
        write_euroc(root / "data" / name, wall(FRAMES, STEP_PX), truth_step_m=step_m)
    broken = write_euroc(root / "data" / "zero", wall(FRAMES, STEP_PX), truth_step_m=STEP_M)
    for file in (broken / "mav0/cam1/data").iterdir():
        file.unlink()
    return root


def run(folder, *words):
    return driftyard("benchmark", *words, "--estimator", "corner_flow", "--seeds", 2, cwd=folder)


def test_benchmark_runs_every_recording_with_truth(folder, in_this_process):
    result = run(folder, "euroc", "data")
    assert result.returncode == 0, result.stderr
    for name in ("hall/V1_01_easy", "two", "zero", "mean", ATE.label, LOST.label):
        assert name in result.stdout
    assert "data/three: has no ground truth and is left out" in result.stderr
    assert "zero, corner_flow: " in result.stderr  # the reason; the others have their figures
    made = json.loads((folder / "build/benchmark/euroc.json").read_text())
    assert made["command"].startswith("driftyard benchmark euroc data")
    scores = {x["sequence"]: x["scores"] for x in made["runs"]}
    assert {name: len(some) for name, some in scores.items()} == {
        "hall/V1_01_easy": 2,
        "two": 2,
        "zero": 2,
    }
    assert scores["zero"] == [None, None]
    for name in ("hall/V1_01_easy", "two"):
        assert scores[name][0]["frames"] == FRAMES
        assert 0 < scores[name][0]["ate_m"]["se3"]["rmse"] < 0.1 * STEP_M
    assert "(2 of 3)" in result.stdout
    text = {x: (folder / f"build/benchmark/euroc.{x}").read_text() for x in ("md", "tex")}
    assert f"**{ATE.label}**" in text["md"]
    assert "| two | " in text["md"]
    assert r"two & " in text["tex"]
    for form in (result.stdout, *text.values()):
        assert "DROID-SLAM (theirs" in form.replace("\n", " ")
        assert "read in Teed and Deng" in form


def test_benchmark_again_reuses_the_runs(folder, in_this_process):
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


def test_kitti_states_segments_that_are_shorter(real_data, tmp_path, in_this_process):
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


@pytest.mark.parametrize(
    ("kind", "recording", "sequence"),
    [
        ("euroc", "machine_hall/MH_03_medium", "MH03"),
        ("euroc", "V1_02_medium", "V102"),
        ("euroc", "mh_04_difficult", "MH04"),
        ("euroc", "euroc_micro", None),
        ("euroc", "MH_06", None),
        ("tumvi", "dataset-room4_512_16", "room4"),
        ("tumvi", "dataset-corridor1_512_16", None),
        ("kitti", "sequences/06", None),
    ],
)
def test_sequence_is_known_by_its_name(kind, recording, sequence):
    assert sequence_of(kind, recording) == sequence


PRINTED_MEANS = {
    ("euroc", "ORB-SLAM2", "stereo"): 0.044,
    ("euroc", "VINS-Fusion", "stereo"): 0.424,
    ("euroc", "SVO", "stereo"): 0.159,
    ("euroc", "ORB-SLAM3", "stereo"): 0.084,
    ("euroc", "DROID-SLAM", "stereo"): 0.024,
    ("euroc", "Basalt, odometry", "stereo and IMU"): 0.072,
    ("euroc", "Kimera", "stereo and IMU"): 0.119,
    ("euroc", "VINS-Fusion", "stereo and IMU"): 0.138,
    ("euroc", "ORB-SLAM3", "stereo and IMU"): 0.036,
    ("tumvi", "ORB-SLAM3", "stereo"): 0.068,
    ("tumvi", "OKVIS", "stereo and IMU"): 0.063,
    ("tumvi", "ROVIO", "stereo and IMU"): 0.15,
    ("tumvi", "Basalt", "stereo and IMU"): 0.082,
    ("tumvi", "ORB-SLAM3", "stereo and IMU"): 0.0092,
}
"""Means that the sources print, which a slip in copying the values would not give."""


def test_published_values_have_the_printed_means():
    found = {(x.benchmark, x.system, x.input): x for k in KINDS for x in published(k)}
    assert found.keys() == PRINTED_MEANS.keys()
    for key, x in found.items():
        assert sum(x.values.values()) / len(x.values) == pytest.approx(PRINTED_MEANS[key], abs=6e-4)
        assert {sequence_of(key[0], name) or name for name in x.values} == set(x.values)
        assert x.paper
        assert x.seen_in


def test_published_table_marks_what_is_theirs():
    ours = {"driftyard": {"MH_01_easy": 0.1, "V2_03_difficult": 0.3, "extra": 0.2}}
    frames = {"MH_01_easy": 3682, "V2_03_difficult": 40, "extra": 7}
    header, rows, sources = published_table("euroc", ours, frames)
    names = ["MH_01_easy", "V2_03_difficult (ours: excerpt)"]
    assert header == ["system", "input", *names, "mean"]
    assert rows[0] == ["driftyard", "stereo", "0.100", "0.300", "0.200"]
    assert rows[1] == ["ORB-SLAM2 (theirs [1])", "stereo", "0.035", "–", "0.035 (1 of 2)"]
    assert all("(theirs [" in x[0] for x in rows[1:])
    assert sources[0].startswith("[1] ATE: Mur-Artal and Tardós")
    assert sources[-1] == ("V2_03_difficult: an excerpt of 40 frames, not comparable with theirs")
    assert published_table("euroc", {"driftyard": {"extra": 0.2}}, frames) == ([], [], [])
    assert published_table("kitti", ours, frames) == ([], [], [])
