"""The command `drive`: every source drives the same trials."""

import json

import pytest
from gym_worlds import write_yard
from terminal import driftyard

pytestmark = pytest.mark.gl

SMALL = ("--set", "rig.width_px=320", "--set", "rig.height_px=240")
SHORT = ("--option", "distance_m=[1.0, 2.5]")


def test_sources_are_compared_on_the_same_ways(tmp_path):
    write_yard(tmp_path)
    words = ("--localization", "truth,wheels", "--worlds", 2, "--out", "trials.jsonl")
    done = driftyard("drive", "yard.xml", *words, *SMALL, *SHORT, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for word in ("success", "collisions", "SPL", "soft SPL", "BARN score", "truth", "wheels"):
        assert word in done.stdout
    trials = [json.loads(line) for line in (tmp_path / "trials.jsonl").read_text().splitlines()]
    assert [t["localization"] for t in trials] == ["truth", "wheels"] * 2
    assert [t["layout"] for t in trials] == [0, 0, 1, 1]
    for first, second in (trials[:2], trials[2:]):
        assert first["way_m"] == second["way_m"]
        assert first["error_m"] < 1e-9 < second["error_m"]
    assert trials[0]["way_m"] != trials[2]["way_m"]
    assert {t["outcome"] for t in trials} == {"success"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("yard.xml", "--localization", "gps"), "unknown localization gps"),
        (("yard.xml", "--option", "bays=3"), "bays"),
        (("yard.xml", "--set", "rig.width"), "rig.width: expected key=value"),
        (("moon",), "unknown scene moon"),
        (("yard.xml", "--option", "distance_m=[5.0, 2.0]"), "the first must be the smaller"),
    ],
)
def test_bad_input_ends_in_one_line(tmp_path, words, said):
    write_yard(tmp_path)
    done = driftyard("drive", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
