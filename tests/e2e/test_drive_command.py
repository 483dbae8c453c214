"""The command `drive`: every source drives the same trials."""

import json

import cv2
import pytest
from gym_worlds import write_yard
from terminal import driftyard

from vo.recordings.readers import open_sequence

pytestmark = [pytest.mark.gl, pytest.mark.usefixtures("in_this_process")]

SIZE = ("--set", "rig.width_px=320", "--set", "rig.height_px=240")
SMALL = (*SIZE, "--set", "render.samples=0")
SHORT = ("--trial", "distance_m=[1.0, 2.0]", "--trial", "rate_hz=5.0")


def test_drive_compares_sources_on_the_same_goals(tmp_path):
    write_yard(tmp_path)
    sources = "truth,wheels,drift:90"
    words = ("--localization", sources, "--worlds", 2, "--out", "trials.jsonl")
    words = (*words, "--figure", "curve.png")
    done = driftyard("drive", "yard.xml", *words, *SMALL, *SHORT, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for word in ("success", "collisions", "SPL", "soft SPL", "BARN score", "truth", "wheels"):
        assert word in done.stdout
    trials = [json.loads(line) for line in (tmp_path / "trials.jsonl").read_text().splitlines()]
    assert [t["localization"] for t in trials] == sources.split(",") * 2
    assert [t["layout"] for t in trials] == [0] * 3 + [1] * 3
    for truth, *others in (trials[:3], trials[3:]):
        assert {t["way_m"] for t in others} == {truth["way_m"]}
        errors = [t["error_m"] for t in (truth, *others)]
        assert errors[0] < 1e-9 < errors[1] < errors[2]
    assert trials[0]["way_m"] != trials[3]["way_m"]
    assert {t["outcome"] for t in trials if t["localization"] != "drift:90"} == {"success"}
    assert cv2.imread(str(tmp_path / "curve.png")).shape[1] > 800


def test_drive_keep_writes_film_and_dataset(tmp_path):
    write_yard(tmp_path)
    short = ("--trial", "distance_m=[1.0, 1.5]", "--trial", "rate_hz=5.0")
    words = ("--localization", "drift:20", "--worlds", 1, "--keep", "kept", *SMALL, *short)
    done = driftyard("drive", "yard.xml", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    film = cv2.VideoCapture(str(tmp_path / "kept/0-0-drift_20.mp4"))
    pictures = int(film.get(cv2.CAP_PROP_FRAME_COUNT))
    dataset = open_sequence(tmp_path / "kept/0-0-drift_20")
    assert len(dataset) == pictures > 20


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("yard.xml", "--localization", ","), "--localization: names no source"),
        (("yard.xml", "--localization", "gps"), "unknown localization gps"),
        (("yard.xml", "--localization", "drift:much"), "drift:PERCENT"),
        (("yard.xml", "--trial", "bays=3"), "bays"),
        (("yard.xml", "--set", "rig.width"), "rig.width: expected key=value"),
        (("moon",), "unknown scene moon"),
        (("yard.xml", "--trial", "distance_m=[5.0, 2.0]"), "the first must be the smaller"),
    ],
)
def test_drive_bad_input_ends_in_one_line(tmp_path, words, said):
    write_yard(tmp_path)
    done = driftyard("drive", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
