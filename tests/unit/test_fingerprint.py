"""The fingerprint of a world: any edited file of it is noticed, wherever the world is used."""

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from scenes.assets import mjcf_assets
from scenes.custom import load_scene
from sim.batch import DatasetTask
from sim.settings import RecordSettings
from sim.world.fingerprint import changes_since, expect_unchanged, fingerprint
from sim.world.world import build_world
from trials.execution.jobs import Recording
from trials.execution.runner import recording_folder
from vo.contract.errors import DatasetError
from vo.contract.remarks import Remark

PARK = """<mujoco><compiler meshdir="meshes"/>
<asset><mesh name="bench" file='bench.obj'/></asset>
<worldbody><geom type="plane" size="5 5 .1"/><include file="parts/bench.xml"/></worldbody>
</mujoco>"""
BENCH = """<mujocoinclude><geom type="mesh" mesh="bench" pos="2 2 0"/></mujocoinclude>"""
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
FILES = {"park.xml": PARK, "parts/bench.xml": BENCH, "meshes/bench.obj": OBJ}
SETTINGS = RecordSettings()


@pytest.fixture
def park(tmp_path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path / "park.xml"


def world_of(path: Path):
    return build_world(load_scene(str(path)), SETTINGS)


def test_mjcf_assets_holds_includes_and_meshes(park):
    assert set(mjcf_assets(park)) == set(FILES)


def test_fingerprint_of_a_world_repeats_from_any_folder(park, monkeypatch):
    found = fingerprint(world_of(park))
    monkeypatch.chdir(park.parent)
    assert fingerprint(world_of(Path("park.xml"))) == found


def edit(text: str) -> str:
    """Change a size, a place or a vertex."""
    return text.replace("5 5 .1", "5 6 .1").replace("2 2 0", "2 3 0").replace("v 1 0 0", "v 2 0 0")


@pytest.mark.parametrize("name", FILES)
def test_changes_since_names_the_edited_file(park, name):
    found = fingerprint(world_of(park))
    assert changes_since(found, world_of(park)) == ""
    (park.parent / name).write_text(edit(FILES[name]))
    os.utime(park.parent / name, (0, 0))  # by which MuJoCo knows that a mesh is another one
    assert changes_since(found, world_of(park)) == f"{name} changed"


def test_comments_and_white_space_bring_a_remark(park):
    found = fingerprint(world_of(park))
    park.write_text("<!-- A bench. -->\n" + PARK.replace("><", ">\n  <"))
    with pytest.warns(Remark, match=r"park\.xml changed, the compiled world did not"):
        assert changes_since(found, world_of(park)) == ""


def test_changes_since_finds_what_no_file_tells(park):
    world = world_of(park)
    found = fingerprint(world)
    world.model.geom_pos[0, 2] += 1e-9
    assert changes_since(found, world).startswith("the compiled world changed")


def test_changes_since_notices_an_edited_module(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "helper.py").write_text("SIZE = 5\n")
    (tmp_path / "fields.py").write_text(
        "import mujoco, helper\ndef field():\n    spec = mujoco.MjSpec()\n"
        "    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=(5, 5, 1))\n"
        "    return spec\n"
    )
    scene = load_scene("fields:field")
    assert set(scene.assets) == {"fields.py", "helper.py"}


def test_expect_unchanged_refuses_an_edited_world(park):
    recorded = {"world": fingerprint(world_of(park))}
    expect_unchanged(recorded, world_of(park))
    park.write_text(PARK.replace("5 5 .1", "5 6 .1"))
    with pytest.raises(DatasetError, match=r"park\.xml changed since it was recorded; restore it"):
        expect_unchanged(recorded, world_of(park))


def test_expect_unchanged_remarks_on_registered_scenes(park):
    world = world_of(park)
    registered = replace(world, scene=replace(world.scene, source="", assets={}))
    with pytest.warns(Remark, match="scene park: the compiled world changed"):
        expect_unchanged({"world": {"sha256": "0", "assets": {}}}, registered)
    with pytest.warns(Remark, match="has no hash of its world"):
        expect_unchanged({}, registered)


def test_edited_world_has_another_place_in_the_cache(park, tmp_path):
    drive = Recording(str(park), 0)
    place, _ = recording_folder(drive, tmp_path)
    assert recording_folder(drive, tmp_path)[0] == place
    (park.parent / "meshes/bench.obj").write_text(OBJ.replace("v 1 0 0", "v 2 0 0"))
    assert recording_folder(drive, tmp_path)[0] != place


def test_dataset_of_an_edited_world_is_not_done(park, tmp_path):
    out = tmp_path / "dataset"
    out.mkdir()
    made = {"schema_version": 1, "settings": SETTINGS.model_dump(mode="json")}
    made |= {"scene": {"source": str(park)}, "world": fingerprint(world_of(park))}
    (out / "dataset.json").write_text(json.dumps(made))
    assert DatasetTask(str(park), SETTINGS, out).is_done
    park.write_text(PARK.replace("5 5 .1", "5 6 .1"))
    with pytest.raises(DatasetError, match=r"dataset: exists, and park\.xml changed since"):
        _ = DatasetTask(str(park), SETTINGS, out).is_done
