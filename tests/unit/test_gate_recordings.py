"""The gate over recordings that it does not make: folders of others, and bags."""

import json

import cv2
import numpy as np
import pytest
from bags import BagWriter, rectified_infos
from folders import HEIGHT, PERIOD_NS, WIDTH, wall, write_euroc
from terminal import driftyard

EYES = ("/left/image_rect", "/right/image_rect")
FRAMES, STEP_M = 13, 0.1
UPDATE = ("gate", "update", "--baseline", "gate.json", "--estimator", "corner_flow")
CHECK = ("gate", "check", "--baseline", "gate.json", "--estimator", "corner_flow")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The rig moves along x by 1.2 m: a folder of EuRoC, and a bag."""
    place = tmp_path_factory.mktemp("gate")
    pairs = wall(FRAMES, step_px=8)
    write_euroc(place / "euroc", pairs, truth_step_m=STEP_M)
    with BagWriter(place / "run.mcap") as bag:
        rectified_infos(bag, ("/left/camera_info", "/right/camera_info"), (WIDTH, HEIGHT))
        for i, pair in enumerate(pairs):
            for topic, image in zip(EYES, pair, strict=True):
                bag.image(topic, (i + 1) * PERIOD_NS, image)
            T = np.eye(4)
            T[0, 3] = STEP_M * i
            bag.pose_stamped("/pose", (i + 1) * PERIOD_NS, T)
    return place


def test_gate_measures_folders_and_bags(folder):
    bag = "run.mcap@truth=/pose"
    update = (*UPDATE, "--recording", "euroc", "--recording", bag, "--cache", "cache")
    done = driftyard(*update, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "corner_flow on 2 sequences, 0 of them lost" in done.stdout
    first, second = json.loads((folder / "gate.json").read_text())["sequences"]
    assert (first["scene"], second["scene"]) == ("euroc", bag)
    assert first["measured"]["drift_percent"] == second["measured"]["drift_percent"] < 5
    assert [
        x.name for x in folder.iterdir() if "candidate" in x.name
    ] == []  # they are in the cache
    checked = driftyard(*CHECK, "--cache", "cache", cwd=folder)
    assert checked.returncode == 3, checked.stderr
    assert "undecided: corner_flow against corner_flow: too few sequences" in checked.stdout
    image = folder / f"euroc/mav0/cam0/data/{PERIOD_NS}.png"
    cv2.imwrite(str(image), np.zeros((HEIGHT, WIDTH), np.uint8))
    refused = driftyard(*CHECK, "--cache", "cache", cwd=folder)
    assert refused.returncode == 2
    assert "gate.json: datasets differ in 1 of 2 sequences, the first euroc; run" in refused.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "--scenes: names no scene"),
        (("--recording", "nowhere"), "nowhere: no such folder"),
        (("--recording", "run.mcap"), "run.mcap: has no ground truth"),
        (("--recording", "euroc", "--recording", "euroc"), "recordings: one is named twice"),
    ],
)
def test_gate_refuses_recordings_in_one_line(folder, words, message):
    done = driftyard(*UPDATE, *words, cwd=folder)
    assert done.returncode == 2
    assert message in done.stderr
    assert len([x for x in done.stderr.splitlines() if ": error: " in x]) == 1
