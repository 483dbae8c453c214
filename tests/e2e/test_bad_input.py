"""Every way to be misused ends in one clear line and status 2, with nothing half-written."""

import shutil

import cv2
import numpy as np
import pytest
import yaml
from folders import PERIOD_NS, wall, write_euroc
from terminal import driftyard

PLANE = """<mujoco><worldbody><geom type="plane" size="5 5 1"/></worldbody></mujoco>"""
FILLED = """<mujoco><worldbody><geom type="plane" size="5 5 1"/>
<geom name="block" type="box" size="3 3 0.3"/></worldbody></mujoco>"""
FREE = "d/mav0/cam0/free.xml"
FIRST = f"mav0/cam0/data/{PERIOD_NS}.png"


def assert_refused(result, *fragments):
    assert result.returncode == 2, result.stdout + result.stderr
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("driftyard: error: ")
    for fragment in fragments:
        assert fragment in lines[0]


@pytest.fixture(scope="module")
def pristine(tmp_path_factory):
    return write_euroc(tmp_path_factory.mktemp("pristine") / "d", wall(3), truth_step_m=0.1)


@pytest.fixture
def dataset(pristine, tmp_path):
    return shutil.copytree(pristine, tmp_path / "d")


def edit_sheet(dataset, eye, **values):
    path = dataset / f"mav0/cam{eye}/sensor.yaml"
    sheet = yaml.safe_load(path.read_text().removeprefix("%YAML:1.0\n"))
    path.write_text(yaml.safe_dump({**sheet, **values}))


def remove(dataset):
    shutil.rmtree(dataset)


def wrong_size(dataset):
    cv2.imwrite(str(dataset / FIRST), np.zeros((20, 30), np.uint8))


def truncate(dataset):
    data = (dataset / FIRST).read_bytes()
    (dataset / FIRST).write_bytes(data[: len(data) // 2])


def empty_file(dataset):
    (dataset / FIRST).write_bytes(b"")


def missing_image(dataset):
    (dataset / FIRST).unlink()


def delay_right(dataset):
    table = dataset / "mav0/cam1/data.csv"
    rows = (f"{k * PERIOD_NS + 20_000_000},{k * PERIOD_NS}.png\n" for k in (1, 2, 3))
    table.write_text("".join(rows))


def reverse_time(dataset):
    for eye in (0, 1):
        table = dataset / f"mav0/cam{eye}/data.csv"
        header, *rows = table.read_text().splitlines(keepends=True)
        table.write_text(header + "".join(rows[::-1]))


def no_frames(dataset):
    for eye in (0, 1):
        (dataset / f"mav0/cam{eye}/data.csv").write_text("#timestamp [ns],filename\n")


def zero_baseline(dataset):
    edit_sheet(dataset, 1, T_BS={"data": np.eye(4).ravel().tolist()})


def nan_calibration(dataset):
    edit_sheet(dataset, 0, intrinsics=[float("nan"), 200.0, 100.0, 100.0])


def no_calibration(dataset):
    (dataset / "mav0/cam1/sensor.yaml").unlink()


@pytest.mark.parametrize(
    ("damage", "fragments"),
    [
        (remove, ["d: no such folder"]),
        (wrong_size, [FIRST, "the image is 30x20", "cam0/sensor.yaml says 240x180"]),
        (missing_image, ["1 of 6 images are missing", FIRST, "--skip-missing"]),
        (delay_right, ["their times differ by 20 ms or more", "--pair-tolerance", "3 ms"]),
        (reverse_time, ["cam0/data.csv:3: time must increase"]),
        (no_frames, ["mav0/cam0/data.csv: holds no rows"]),
        (zero_baseline, ["mav0/cam1/sensor.yaml", "zero baseline"]),
        (nan_calibration, ["mav0/cam0/sensor.yaml", "NaN"]),
        (no_calibration, ["mav0/cam1/sensor.yaml", "cannot be read"]),
    ],
)
def test_bad_dataset_is_refused_in_one_line(dataset, tmp_path, damage, fragments):
    damage(dataset)
    words = ("run", "d", "--out", "out/x.txt", "--estimator", "corner_flow")
    assert_refused(driftyard(*words, cwd=tmp_path), *fragments)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("damage", "fragment"), [(truncate, "truncated"), (empty_file, "the file is empty")]
)
def test_damaged_image_costs_its_frame(dataset, tmp_path, damage, fragment):
    damage(dataset)
    words = ("run", "d", "--out", "x.txt", "--estimator", "corner_flow")
    result = driftyard(*words, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "3 frames, 1 lost" in result.stdout
    (line,) = result.stderr.splitlines()
    assert f"{FIRST}: " in line
    assert fragment in line
    table = (tmp_path / "x.frames.csv").read_text().splitlines()
    assert table[1] == f"{PERIOD_NS},lost,unreadable image,0.000" + "," * (table[0].count(",") - 3)


@pytest.mark.parametrize(
    ("words", "times"),
    [
        (["--skip-missing"], [2, 3]),
        (["--first", "1"], [2, 3]),
        (["--first", "1", "--last", "1"], [2]),
        (["--skip-missing", "--every", "2"], [3]),
    ],
)
def test_run_goes_on_without_missing_images(dataset, tmp_path, words, times):
    missing_image(dataset)
    words = ("run", "d", "--out", "x.txt", "--estimator", "corner_flow", *words)
    result = driftyard(*words, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert ("images are missing" in result.stderr) == ("--skip-missing" in words)
    rows = (tmp_path / "x.frames.csv").read_text().splitlines()[1:]
    assert [int(row.split(",")[0]) // PERIOD_NS for row in rows] == times


@pytest.mark.parametrize(
    ("words", "fragments"),
    [
        (["--first", "3"], ["frames 3 to 2", "frames 0 to 2"]),
        (["--last", "7"], ["frames 0 to 7", "d has frames 0 to 2"]),
        (["--pair-tolerance", "50"], ["--pair-tolerance 50 ms", "half of the period of 100 ms"]),
        (["--every", "2", "--command", "true {dataset} {out}"], ["a program reads all frames"]),
        (["--estimator", "orb"], ["unknown estimator orb", "corner_flow, driftyard"]),
        (["--set", "seeds=3"], ["unknown setting seeds", "features"]),
        (["--set", "seed=nan"], ["seed"]),
        (["--config", "nowhere.toml"], ["nowhere.toml", "cannot be read"]),
        (["--config", "bad.toml"], ["bad.toml", "not valid TOML"]),
    ],
)
def test_bad_run_option_is_refused_in_one_line(dataset, tmp_path, words, fragments):
    (tmp_path / "bad.toml").write_text("= 3")
    assert_refused(driftyard("run", "d", "--out", "x.txt", *words, cwd=tmp_path), *fragments)
    assert not list(tmp_path.glob("*x*txt*"))


def test_run_output_folder_is_refused(dataset, tmp_path):
    assert_refused(driftyard("run", "d", "--out", ".", cwd=tmp_path), "is a folder")


@pytest.mark.parametrize(
    ("words", "fragments"),
    [
        (["generate", "moon", "--out", "o"], ["unknown scene moon", "brick_court"]),
        (["generate", "yards.py", "--out", "o"], ["unknown scene yards.py", "or yards:FUNCTION"]),
        (["generate", "office", "--out", "o", "--set", "rig.tilt=3"], ["rig.tilt", "tilt_deg"]),
        (["generate", "office", "--out", "o", "--set", "rig.tilt_deg=nan"], ["rig.tilt_deg"]),
        (["generate", "office", "--out", "o", "--set", "rig.baseline_m=0"], ["rig.baseline_m"]),
        (
            ["generate", "office", "--out", "o", "--set", "labels.flows=true"],
            ["labels.flows", "flow"],
        ),
        (
            ["generate", FREE, "--out", "o", "--set", "exposure.time_ms=80"],
            ["exposure.time_ms", "takes 80.0 ms", "rig.rate_hz leaves 66.7 ms"],
        ),
        (
            ["generate", FREE, "--out", "o", "--set", "calibration.baseline_percent=-100"],
            ["baseline", "must be positive"],
        ),
        (
            ["generate", FREE, "--out", "o", "--set", "sensor.k1=-0.5"],
            ["sensor.k1 = -0.5", "folds the image"],
        ),
        (["generate", "office", "--out", "o", "--disturb", "hail"], ["disturbance hail", "blur"]),
        (["generate", "office", "--out", "o", "--disturb", "blur=x"], ["blur", "not a number"]),
        (
            ["generate", FREE, "--out", "o", "--set", "drive.waypoints=[[1,1],[1,1]]"],
            ["drive.waypoints", "the same"],
        ),
        (["generate", "nowhere.xml", "--out", "o"], ["nowhere.xml: no such file"]),
        (["generate", "d/mav0/cam0/broken.xml", "--out", "o"], ["broken.xml: not valid MJCF"]),
        (
            ["generate", "d/mav0/cam0/filled.xml", "--out", "o"],
            ["no free space at the start", "block is in the way"],
        ),
        (["generate", "no_module:build", "--out", "o"], ["cannot import no_module"]),
        (["generate", "json:nothing", "--out", "o"], ["json has no function nothing"]),
        (["generate", "office", "--out", "d"], ["already exists"]),
        (["generate", "--from", "d/edited", "--out", "o"], ["dataset.json", "its own digest"]),
        (["preview", "moon", "--out", "o.png"], ["unknown scene moon"]),
        (["preview", "office", "--out", "o"], ["must end in .png"]),
        (["verify", "o"], ["o: no such folder"]),
        (["verify", "d"], ["dataset.json", "cannot be read"]),
    ],
)
def test_bad_generate_option_is_refused_in_one_line(dataset, tmp_path, words, fragments):
    (dataset / "mav0/cam0/broken.xml").write_text("<mujoco>")
    (dataset / "mav0/cam0/filled.xml").write_text(FILLED)
    (dataset / "edited").mkdir()
    (dataset / "edited/dataset.json").write_text('{"schema_version": 1, "manifest_sha256": "0"}')
    (tmp_path / FREE).write_text(PLANE)
    assert_refused(driftyard(*words, cwd=tmp_path), *fragments)
    assert {path.name for path in tmp_path.iterdir()} == {"d"}


@pytest.mark.parametrize("command", ["score", "report"])
@pytest.mark.parametrize(
    ("text", "fragments"),
    [
        (None, ["x.txt: cannot be read"]),
        ("1 0 0 nan 0 0 0 1\n", ["x.txt:1: nan is not finite"]),
        ("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n", ["x.txt: the estimate shares 0 times"]),
    ],
)
def test_bad_trajectory_is_refused_in_one_line(dataset, tmp_path, command, text, fragments):
    if text:
        (tmp_path / "x.txt").write_text(text)
    assert_refused(driftyard(command, "d", "x.txt", cwd=tmp_path), *fragments)
    assert not (tmp_path / "report.html").exists()


def test_score_without_truth_is_refused(dataset, tmp_path):
    shutil.rmtree(dataset / "mav0/state_groundtruth_estimate0")
    (tmp_path / "x.txt").write_text("0.1 0 0 0 0 0 0 1\n")
    assert_refused(driftyard("score", "d", "x.txt", cwd=tmp_path), "has no ground truth")


@pytest.mark.parametrize("words", [["fly"], ["run"], ["run", "d", "--bogus"], ["preview"]])
def test_usage_error_has_status_2(tmp_path, words):
    result = driftyard(*words, cwd=tmp_path)
    assert result.returncode == 2
    assert "Usage:" in result.stderr
    assert "Traceback" not in result.stderr
