"""Datasets through the command line: of a user's own world, again from a manifest, and many."""

import json

import pytest
from terminal import driftyard

pytestmark = pytest.mark.gl

YARD = """<mujoco><asset>
<texture name="t" type="2d" builtin="checker" rgb1=".2 .3 .4" rgb2=".6 .6 .5"
 width="64" height="64"/>
<material name="t" texture="t" texrepeat="4 4" texuniform="true"/></asset><worldbody>
<light pos="0 0 4"/><geom type="plane" size="5 5 1" material="t"/>
<geom name="post" type="cylinder" pos="2 2 0.5" size="0.2 0.5"/></worldbody></mujoco>"""
TINY = [
    word
    for setting in (
        "rig.width_px=64",
        "rig.height_px=48",
        "drive.distance_m=0.05",
        "render.samples=0",
        "render.shadow_size_px=256",
    )
    for word in ("--set", setting)
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a world of one's own, and a dataset of it."""
    folder = tmp_path_factory.mktemp("generate")
    (folder / "yard.xml").write_text(YARD)
    result = driftyard("generate", "yard.xml", "--out", "d", "--seed", 7, *TINY, cwd=folder)
    assert result.returncode == 0, result.stderr
    return folder


def content(dataset):
    files = (path for path in dataset.rglob("*") if path.is_file())
    return {path.relative_to(dataset).as_posix(): path.read_bytes() for path in files}


def test_generate_mjcf_scene_gives_a_dataset_that_verifies(folder):
    manifest = json.loads((folder / "d/dataset.json").read_text())
    assert manifest["scene"]["name"] == "yard"
    assert manifest["scene"]["source"] == "yard.xml"
    assert manifest["seed"] == 7
    assert manifest["certificate"]["passed"]
    verified = driftyard("verify", "d", cwd=folder)
    assert verified.returncode == 0
    assert "disparity: bias" in verified.stdout
    assert "the smallest shift that is found is" in verified.stdout
    assert "coverage: checked at recording" in verified.stdout


def test_generate_from_manifest_repeats_every_byte(folder):
    result = driftyard("generate", "--from", "d/dataset.json", "--out", "again", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert content(folder / "again") == content(folder / "d")


def test_generate_disturbances_of_strength_0_change_nothing(folder):
    words = ("--out", "zero", "--seed", 7, "--disturb", "blur=0,noise=0,slip=0", *TINY)
    result = driftyard("generate", "yard.xml", *words, cwd=folder)
    assert result.returncode == 0, result.stderr
    assert content(folder / "zero") == content(folder / "d")


def test_generate_many_equals_single_datasets(folder):
    words = ("--out", "many", "--seed", 6, "--count", 2, "--workers", 1, *TINY)
    result = driftyard("generate", "yard.xml", *words, cwd=folder)
    assert result.returncode == 0, result.stderr
    made = {
        json.loads((path / "dataset.json").read_text())["seed"]: path
        for path in (folder / "many").iterdir()
    }
    assert set(made) == {6, 7}
    assert content(made[7]) == content(folder / "d")
