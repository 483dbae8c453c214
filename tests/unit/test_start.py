"""Ground at the start, and falls from it: said at once, with coordinates."""

import re
from pathlib import Path

import pytest

from scenes.custom import load_scene
from sim.settings import DriveSettings, RecordSettings
from sim.world.trip import make_trip
from sim.world.world import build_world
from trials.gym.world.scene_instance import build_instance
from vo.contract.errors import SettingsError
from vo.contract.settings import amended

FLOOR = '<geom name="floor" type="plane" size="5 5 .1"/>'
SLAB = '<geom name="slab" type="box" pos="0 -1.5 -.1" size="2 1.5 .1"/>'
SETTINGS = RecordSettings(drive=DriveSettings(distance_m=1.2))


def world_file(folder: Path, content: str, option: str = "") -> str:
    path = folder / "yard.xml"
    path.write_text(f"<mujoco>{option}<worldbody>{content}</worldbody></mujoco>")
    return str(path)


@pytest.mark.parametrize(
    ("content", "option", "fragment"),
    [
        ("", "", r"no ground at the start \(0, -1\) m: there is nothing below"),
        (
            FLOOR.replace("/>", ' contype="0" conaffinity="0"/>'),
            "",
            r"at the start \(0, -1\) m: floor does not collide with the wheels \(contype 0, conaff",
        ),
        (
            FLOOR.replace("/>", ' pos="0 0 -.3"/>'),
            "",
            r"at the start \(0, -1\) m: floor is at z = -0\.3 m, expected 0 m",
        ),
        (
            FLOOR.replace("/>", ' pos="0 0 .3"/>'),
            "",
            r"no free space at the start .*, floor is in the way: its surface is at z = 0\.3 m, ex",
        ),
        (
            FLOOR.replace("/>", ' euler="0 20 0"/>'),
            "",
            "in the way: its surface is tilted by 20 deg",
        ),
        (FLOOR, '<option gravity="0 0 0"/>', r"gravity is \(0, 0, 0\) m/s\^2; a rover needs"),
        (FLOOR, '<option gravity="0 0 9"/>', r"gravity is \(0, 0, 9\) m/s\^2; a rover needs"),
        (FLOOR, '<option gravity="9 0 -8"/>', r"gravity is \(9, 0, -8\) m/s\^2; a rover needs"),
        *(
            (FLOOR, f'<option><flag {flag}="disable"/></option>', f"option flag {flag} is off")
            for flag in ("gravity", "contact", "constraint", "actuation")
        ),
        (FLOOR, '<option actuatorgroupdisable="0"/>', "actuatorgroupdisable turns off group 0"),
    ],
)
def test_start_that_cannot_carry_a_rover_is_refused(tmp_path, content, option, fragment):
    scene = load_scene(world_file(tmp_path, content, option))
    with pytest.raises(SettingsError, match=f"scene yard: .*{fragment}"):
        build_world(scene, SETTINGS)
    with pytest.raises(SettingsError, match=fragment):
        build_instance(scene.source, SETTINGS, 0.3, 1.0)


@pytest.mark.parametrize("content", [FLOOR.replace("/>", ' pos="0 0 -.03"/>'), FLOOR])
def test_start_on_ground_is_accepted(tmp_path, content):
    build_world(load_scene(world_file(tmp_path, content)), SETTINGS)


def test_start_of_a_walk_needs_no_ground(tmp_path):
    walk = RecordSettings(drive=DriveSettings(carrier="handheld", distance_m=1.2))
    build_world(load_scene(world_file(tmp_path, "", '<option gravity="0 0 0"/>')), walk)


def test_trip_over_an_edge_ends_with_the_fall(tmp_path):
    route = DriveSettings(waypoints=((0.0, -0.4), (0.0, 2.0)))
    settings = RecordSettings(drive=route)
    world = build_world(load_scene(world_file(tmp_path, SLAB)), settings)
    ended = make_trip(world, settings).ended
    assert re.fullmatch(r"the rover fell at [34]\.\d\d s near \(-?0\.00, 0\.0\d\) m", ended), ended


def test_environment_start_beside_the_ground_has_fallen(tmp_path):
    scene = world_file(tmp_path, SLAB)
    simulation = build_instance(scene, SETTINGS, 0.3, 1.0).simulation
    assert simulation.reset([0.0, -1.0, 0.0])
    assert not simulation.has_fallen
    assert not simulation.reset([0.0, 1.0, 0.0])
    assert simulation.has_fallen


CUBE = " ".join(f"{x} {y} {z}" for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (-0.3, 0.3))
ASSETS = f"""<asset><mesh name="cube" vertex="{CUBE}"/>
<hfield name="hill" nrow="3" ncol="3" elevation="1 1 1 1 1 1 1 1 0" size=".5 .5 .8 .1"/></asset>"""


@pytest.mark.parametrize(
    "shape",
    [
        'type="box" size=".3 .3 .3"',
        'type="sphere" size=".3"',
        'type="cylinder" size=".3 .2"',
        'type="capsule" size=".2 .2"',
        'type="ellipsoid" size=".3 .2 .2"',
        'type="mesh" mesh="cube"',
        'type="mesh" mesh="cube" contype="0" conaffinity="0"',
        'type="hfield" hfield="hill"',
        'type="plane" size=".3 .3 .1"',
    ],
)
def test_camera_that_starts_inside_a_body_is_refused(tmp_path, shape):
    drive = DriveSettings(carrier="handheld", distance_m=1.2)
    walk = amended(RecordSettings(drive=drive), {"rig.height_m": 1.2})
    shift = {"hfield": 0.7, "plane": -0.1}.get(shape.split('"')[1], 0.0)
    turn = "0 0 0" if shift else "20 30 40"
    geom = f'<geom name="block" {shape} pos="{{}} -1 {{}}" euler="{turn}"/>'
    beside = world_file(tmp_path, FLOOR + geom.format(1, 1.2 - shift), ASSETS)
    build_world(load_scene(beside), walk)
    inside = world_file(tmp_path, FLOOR + geom.format(0.1, 1.2 - shift), ASSETS)
    with pytest.raises(SettingsError, match=r"the camera is inside block at the start \(.*, 1\.2"):
        build_world(load_scene(inside), walk)
    invisible = geom.format(0.1, 1.2 - shift).replace("/>", ' rgba="1 1 1 0"/>')
    build_world(load_scene(world_file(tmp_path, FLOOR + invisible, ASSETS)), walk)


@pytest.mark.parametrize("thing", ['type="box" size=".1 2 .5"', 'type="mesh" mesh="cube"'])
def test_rover_that_starts_inside_a_body_is_refused(tmp_path, thing):
    geom = f'<geom name="wall" {thing} pos="0 -1 .3"/>'
    scene = load_scene(world_file(tmp_path, FLOOR + geom, ASSETS))
    fragment = r"no free space at the start \(0, -1\) m, wall is in the way"
    with pytest.raises(SettingsError, match=fragment):
        build_world(scene, SETTINGS)
    with pytest.raises(SettingsError, match=fragment):
        build_instance(scene.source, SETTINGS, 0.3, 1.0)
