"""Custom scenes: accepted as they are, or refused in one line."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from scenes import build_scene, find_scene
from scenes.custom import LOOP_M, is_custom, load_scene
from scenes.scene import Kind
from sim.settings import DriveSettings, RecordSettings, TerrainSettings
from sim.world.trip import make_trip
from sim.world.world import build_world, thing_of
from vo.contract.errors import SettingsError

YARD = """
<mujoco model="yard">
  <compiler angle="radian"/>
  <option timestep="0.01" gravity="0 0 -9.81"/>
  <visual><map znear="0.02" zfar="70"/><quality shadowsize="1024"/></visual>
  <asset>
    <texture name="grid" type="2d" builtin="checker" rgb1=".2 .3 .4" rgb2=".6 .6 .5"
             width="256" height="256"/>
    <material name="grid" texture="grid" texrepeat="8 8" texuniform="true"/>
  </asset>
  <worldbody>
    <light pos="0 0 4" dir="0 0 -1"/>
    <geom name="floor" type="plane" size="6 6 1" material="grid"/>
    <geom name="pillar" type="cylinder" pos="2 2 0.5" size="0.2 0.5" material="grid"/>
    <body name="ball" pos="2.5 0 0.2"><freejoint/>
      <geom name="ball" type="sphere" size="0.15" mass="0.3" rgba="0.8 0.2 0.2 1"/></body>
  </worldbody>
</mujoco>
"""
MODULE = """
import mujoco
import numpy as np
from scenes.scene import Scene

def spec():
    made = mujoco.MjSpec()
    made.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=(5, 5, 1))
    return made

def scene():
    route = np.array([[0.0, 0.0], [1.0, 0.5]])
    return Scene("mine", "My own.", spec(), {"default": route, "back": route[::-1]}, (-1, -1, 2, 2))

def number():
    return 3

def broken():
    return 1 // 0

constant = 5

def exits():
    raise SystemExit("bye")

def library():
    return np.concatenate([])

def needy(size):
    return spec()

def low():
    return Scene("low", "", spec(), {"default": np.eye(2)}, (1, 0, 0, 1))

def pose(time_s):
    raise KeyError("pose")

def staged():
    from scenes.stage import Stage
    Stage("yard").draw("no such material")

def absent():
    return Scene("a", "", spec(), {"default": np.eye(2)}, (0, 0, 1, 1), movers={"cart": pose})

def moved():
    world = spec()
    world.worldbody.add_body(name="ball", mocap=True)
    motions = {"ball": pose}
    return Scene("moved", "", world, {"default": np.eye(2)}, (0, 0, 1, 1), movers=motions)
"""


@pytest.fixture
def yard(tmp_path) -> Path:
    path = tmp_path / "yard.xml"
    path.write_text(YARD)
    return path


@pytest.fixture
def module(tmp_path, monkeypatch) -> str:
    """A module that can be imported, under a name of its own for every test."""
    name = f"worlds_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    return name


@pytest.mark.parametrize(
    ("name", "custom"),
    [
        *(("office", False), ("a.xml", True), ("b/c.mjcf", True), ("m:f", True), ("xml", False)),
        *(("A.XML", True), ("site:1.xml", True)),
    ],
)
def test_is_custom_distinguishes_files_functions_and_names(name, custom):
    assert is_custom(name) == custom


def test_load_scene_mjcf_file_has_a_closed_route(yard):
    scene = build_scene(str(yard), np.random.default_rng(0), {})
    assert scene.name == "yard"
    assert scene.source == str(yard)
    route = scene.routes["default"]
    np.testing.assert_allclose(route[0], route[-1])
    assert np.abs(route).max() <= LOOP_M / 2 + 1e-9
    x_min, y_min, x_max, y_max = scene.extent_m
    assert x_min < -LOOP_M / 2
    assert y_min < -LOOP_M / 2
    assert x_max >= 2.65
    assert y_max >= 2.2


@pytest.mark.parametrize("name", ["YARD.XML", "site:1.xml", "yard.mjcf"])
def test_load_scene_any_file_name_is_read(yard, name):
    scene = load_scene(str(yard.rename(yard.with_name(name))))
    assert scene.name == Path(name).stem


def test_custom_scene_rover_drives_and_objects_have_classes(yard):
    settings = RecordSettings(drive=DriveSettings(distance_m=1.0))
    world = build_world(load_scene(str(yard)), settings)
    assert world.model.opt.timestep <= 1e-3  # ours, not the file's
    trip = make_trip(world, settings)
    assert trip.length_m == pytest.approx(1.0, abs=0.05)
    kinds = {thing.name: thing.kind for thing in (thing_of(world, g) for g in range(3))}
    assert kinds["floor"] == Kind.GROUND
    assert kinds["pillar"] == Kind.STATIC
    assert thing_of(world, world.model.geom("ball").id).kind == Kind.MOVING


def test_custom_scene_accepts_terrain(yard):
    settings = RecordSettings(terrain=TerrainSettings(brick_mm=10.0))
    world = build_world(load_scene(str(yard)), settings)
    assert any(world.model.geom(g).name.startswith("terrain/") for g in range(world.model.ngeom))


def test_custom_scene_waypoints_replace_the_route(yard):
    drive = DriveSettings(waypoints=((0.0, 0.0), (1.0, 1.0)))
    world = build_world(load_scene(str(yard)), RecordSettings(drive=drive))
    np.testing.assert_allclose(world.T_world_chassis[:2, :2] @ [1, 0], np.sqrt([0.5, 0.5]))
    assert world.path.length_m == pytest.approx(np.sqrt(2))
    with pytest.raises(SettingsError, match=r"drive\.waypoints: expected at least two points"):
        build_world(
            load_scene(str(yard)), RecordSettings(drive=DriveSettings(waypoints=((0.0, 0.0),)))
        )


def test_load_scene_function_returns_a_spec_or_a_scene(module):
    made = load_scene(f"{module}:spec")
    assert isinstance(made.spec, mujoco.MjSpec)
    assert made.name == "spec"
    scene = load_scene(f"{module}:scene")
    assert scene.name == "mine"
    assert set(scene.routes) == {"default", "back"}
    assert scene.source == f"{module}:scene"
    assert find_scene(f"{module}:scene").defaults == {}


@pytest.mark.parametrize(
    ("function", "fragment"),
    [
        ("nothing", "has no function nothing; its functions: spec, scene, number, broken"),
        ("broken", r"broken failed \(\S*worlds_\w+\.py:19: ZeroDivisionError: "),
        ("constant", "has no function constant"),
        ("exits", r"exits failed \(\S*worlds_\w+\.py:24: SystemExit: bye"),
        ("library", r"library failed \(\S*worlds_\w+\.py:27: ValueError: "),
        ("staged", r"staged failed \(\S*worlds_\w+\.py:40: KeyError: "),
        ("absent", "mover cart of the Scene: expected the name of a mocap body"),
        ("needy", "needy takes arguments, expected none"),
        ("low", "extent_m of the Scene: expected x, y, x, y in m"),
        ("moved", r"mover ball failed \(\S*worlds_\w+\.py:36: KeyError: 'pose'"),
        ("number", "returned a int; return a mujoco.MjSpec or a scenes.scene.Scene"),
    ],
)
def test_load_scene_unusable_function_is_refused(module, function, fragment):
    with pytest.raises(SettingsError, match=fragment):
        load_scene(f"{module}:{function}")


@pytest.mark.parametrize("name", [":build", "worlds:"])
def test_load_scene_incomplete_function_name_is_refused(name):
    with pytest.raises(SettingsError, match=f"{name}: expected module:function"):
        load_scene(name)


def test_load_scene_module_with_syntax_error_is_one_line(tmp_path, monkeypatch):
    (tmp_path / "slipped.py").write_text("def build(:\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SettingsError, match=r"cannot import slipped \(\S*slipped.py:1: Syntax"):
        load_scene("slipped:build")


def test_load_scene_exception_outside_of_pythons_is_one_line(tmp_path, monkeypatch):
    (tmp_path / "odd.py").write_text(
        "class Odd(BaseException):\n    pass\ndef f():\n    raise Odd\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SettingsError, match=r"f failed \(\S*odd.py:4: Odd\)"):
        load_scene("odd:f")


def test_files_that_are_no_mjcf_are_named(tmp_path):
    (tmp_path / "robot.urdf").touch()
    with pytest.raises(SettingsError, match=r"robot.urdf: expected an MJCF file, whose name ends"):
        find_scene(str(tmp_path / "robot.urdf"))
    (tmp_path / "yard.xml").mkdir()
    with pytest.raises(SettingsError, match=r"yard.xml: is a folder; give the path"):
        load_scene(str(tmp_path / "yard.xml"))


def test_load_scene_missing_module_is_refused():
    with pytest.raises(SettingsError, match="cannot import no_such_module"):
        load_scene("no_such_module:build")


@pytest.mark.parametrize(
    ("text", "fragment"),
    [
        ("<mujoco><worldbody>", "not valid MJCF"),
        ("<mujoco><worldbody><geom type='blob'/></worldbody></mujoco>", "not valid MJCF"),
        (
            "<mujoco><worldbody><geom type='mesh' mesh='m'/></worldbody></mujoco>",
            "does not compile",
        ),
        (
            "<mujoco><worldbody><body><freejoint/></body></worldbody></mujoco>",
            "does not compile",
        ),
    ],
)
def test_load_scene_invalid_mjcf_is_one_line(tmp_path, text, fragment):
    path = tmp_path / "bad.xml"
    path.write_text(text)
    with pytest.raises(SettingsError, match=fragment) as caught:
        load_scene(str(path))
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_load_scene_missing_file_is_named():
    with pytest.raises(SettingsError, match=r"nowhere\.xml: no such file"):
        load_scene("nowhere.xml")


def test_custom_scene_start_inside_an_object_names_it(yard):
    yard.write_text(YARD.replace('pos="2 2 0.5"', 'pos="1.0 0 0.3"'))
    route = DriveSettings(waypoints=((1.0, 0.0), (2.0, 0.0)))
    with pytest.raises(SettingsError, match=r"no free space at the start \(1, 0\) m, pillar is"):
        build_world(load_scene(str(yard)), RecordSettings(drive=route))


def test_custom_scene_options_are_refused(yard):
    with pytest.raises(SettingsError, match="unknown option bricks"):
        build_scene(str(yard), np.random.default_rng(0), {"bricks": 3})


BALL = '<body pos="2 2 .2"><freejoint/><geom name="{}" size=".1"/></body>'
PUSH = """<body pos="2 2 .2"><joint name="hinge"/><geom size=".1"/></body></worldbody>
<actuator><motor name="rover/wheel_left" joint="hinge"/></actuator><worldbody>"""
HOME = '</worldbody><keyframe><key name="home" qpos="{}"/></keyframe><worldbody>'


@pytest.mark.parametrize(
    ("content", "fragment"),
    [
        (
            '<geom name="odd" size=".1" pos="3 nan 0"/>',
            "pos of geom odd is 3 nan 0, expected finite",
        ),
        ('<geom name="odd" size="inf" pos="3 0 0"/>', "size of geom odd is inf 0 0"),
        (BALL.format("x").replace("2 2", "nan 2"), "pos of body 1 is nan 2 0.2"),
        (BALL.format("x") + HOME.format("1 2 3"), "qpos of key home has 3 numbers, expected 7"),
        (BALL.format("x") + HOME.format("2 nan 3 1 0 0 0"), "qpos of key home is 2 nan 3"),
        (PUSH, "does not compile with the rover, whose names begin with rover/"),
    ],
)
@pytest.mark.filterwarnings("ignore:MuJoCo warns")
def test_world_that_only_compiles_is_refused_in_one_line(tmp_path, content, fragment):
    with pytest.raises(SettingsError, match=re.escape(fragment)) as error:
        build_world(load_scene(plane_world(tmp_path, content)), RecordSettings())
    assert "\n" not in str(error.value)


def test_names_like_the_rovers_are_labelled_as_what_they_are(tmp_path):
    world = build_world(load_scene(plane_world(tmp_path, BALL.format("rover/x"))), RecordSettings())
    geom = world.model.geom("rover/x").id
    assert thing_of(world, geom).name == "rover/x"


def test_memory_of_a_world_without_the_rover_is_enough(tmp_path):
    path = plane_world(tmp_path, "", '<size memory="2K"/>')
    settings = RecordSettings(drive=DriveSettings(distance_m=0.1))
    assert make_trip(build_world(load_scene(path), settings), settings).ended == ""


def plane_world(folder: Path, content: str, top: str = "") -> str:
    path = folder / "plane.xml"
    plane = '<geom type="plane" size="5 5 1"/>'
    path.write_text(f"<mujoco>{top}<worldbody>{plane}{content}</worldbody></mujoco>")
    return str(path)
