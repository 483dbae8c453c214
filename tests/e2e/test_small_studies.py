"""Small versions of the experiments: they run and write their files."""

import csv
import json

import pytest
from gym_worlds import write_yard
from terminal import driftyard

pytestmark = [pytest.mark.gl, pytest.mark.slow, pytest.mark.usefixtures("in_this_process")]
NAMES = ("E5",)
"""One variant on one short recording; the others take many times as long."""


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    """The folder of the command, and its output."""
    folder = tmp_path_factory.mktemp("study")
    words = ("experiment", ",".join(NAMES), "--small", "--page", "docs/page.md")
    result = driftyard(*words, cwd=folder)
    assert result.returncode == 0, result.stderr
    return folder, result.stdout


@pytest.mark.parametrize("name", NAMES)
def test_experiment_writes_figure_data_and_verdict(studied, name):
    folder, printed = studied
    results = folder / "build/experiments/small"
    record = json.loads((results / f"{name}.json").read_text())
    assert record["verdict"] in ("holds", "holds in part", "does not hold", "cannot be decided")
    assert f"The claim {record['verdict']}." in printed
    assert "nan" not in record["sentence"] or name == "E5"  # too short for a fast turn
    assert (results / record["figure"]).stat().st_size > 10_000
    assert record["data"]
    for file in record["data"]:
        with (results / file).open() as stream:
            assert len(list(csv.reader(stream))) > 1, file
    assert all(len(row) == len(record["table"]["columns"]) for row in record["table"]["rows"])


def test_experiment_pages_contain_all(studied):
    folder, _ = studied
    page = (folder / "docs/page.md").read_text()
    html = (folder / "build/experiments/small/report.html").read_text()
    for name in NAMES:
        assert f"images/experiments/{name}.png" in page
        assert f'id="{name}"' in html
        assert (folder / f"docs/images/experiments/{name}.png").is_file()


def test_experiment_again_reuses_cached_runs(studied):
    folder, _ = studied
    runs = folder / "build/cache/runs"
    before = {file: file.stat().st_mtime_ns for file in runs.iterdir()}
    assert driftyard("experiment", "E5", "--small", cwd=folder).returncode == 0
    assert {file: file.stat().st_mtime_ns for file in runs.iterdir()} == before


def test_experiment_unknown_is_an_error(tmp_path):
    result = driftyard("experiment", "E13", cwd=tmp_path)
    assert result.returncode == 2
    assert "unknown experiment E13; valid: all, E1, E2" in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_stress_unknown_axis_is_an_error(tmp_path):
    result = driftyard("stress", "wind", cwd=tmp_path)
    assert result.returncode == 2
    assert "unknown axis wind; valid: all, exposure, brick_height" in result.stderr


def test_stress_unfinished_quotation_is_an_error(tmp_path):
    result = driftyard("stress", "noise", "--command", "'run {dataset} {out}", cwd=tmp_path)
    assert result.returncode == 2
    assert "run {dataset} {out}: No closing quotation" in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_stress_finds_where_the_baseline_fails(tmp_path):
    scene = write_yard(tmp_path)
    words = ("--estimator", "corner_flow", "--points", "2", "--rounds", "0", "--seeds", "1")
    words += ("--scene", scene, "--distance", "1.2", "--drift", "0")
    words += ("--record", "rig.width_px=160", "--record", "rig.height_px=120")
    words += ("--record", "rig.rate_hz=8", "--record", "drive.speed_mps=0.6")
    words += ("--record", "render.samples=0")
    result = driftyard("stress", "noise", *words, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "Fails on yard without any disturbance" in result.stdout
    (figure,) = (tmp_path / "build/stress").glob("*.png")
    assert figure.stat().st_size > 10_000
    found = json.loads(figure.with_suffix(".json").read_text())["estimators"]
    assert found["corner_flow"]["bracket"] == [0.0, 0.0]
