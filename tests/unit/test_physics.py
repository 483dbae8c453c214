"""Physics of a user's world: honoured, or named in the manifest as replaced."""

import os
from pathlib import Path

import numpy as np
import pytest

from scenes.custom import load_scene
from sim.settings import DriveSettings, ImuSettings, RecordSettings, TerrainSettings
from sim.world.drive import DriveError
from sim.world.physics import physics_entry, remark_replaced
from sim.world.trip import make_trip
from sim.world.world import World, build_world
from trials.gym.world.sensors import InertialUnit
from trials.gym.world.simulation import Simulation
from vo.contract.remarks import Remark

ARM = """<mujoco>{option}<worldbody><geom type="plane" size="5 5 .1"/>
<body pos="3 0 1"><joint name="swing" axis="0 1 0" damping="1"/><geom size=".1" mass="1"/></body>
</worldbody>{rest}</mujoco>"""
MOON = '<option timestep="0.0005" integrator="RK4" gravity="0 0 -1.62"/>'
KEYS = """<actuator><position joint="swing" kp="400"/></actuator>
<keyframe><key name="away" qpos=".3"/><key name="home" qpos=".6" ctrl=".6"/></keyframe>"""
SETTINGS = RecordSettings(drive=DriveSettings(distance_m=0.05), imu=ImuSettings(noise=0.0))


def world_of(folder: Path, option: str = "", rest: str = "", settings=SETTINGS) -> World:
    path = folder / "arm.xml"
    path.write_text(ARM.format(option=option, rest=rest))
    return build_world(load_scene(str(path)), settings)


def test_physics_entry_names_what_is_replaced(tmp_path):
    entry = physics_entry(world_of(tmp_path, MOON, KEYS))
    assert entry["gravity_mps2"] == [0, 0, -1.62]
    assert entry["replaced"]["integrator"] == {"scene": "rk4", "used": "implicitfast"}
    assert entry["replaced"]["timestep_s"]["scene"] == 0.0005
    assert entry["replaced"]["cone"] == {"scene": "pyramidal", "used": "elliptic"}
    assert (entry["keyframe"], entry["keyframes_ignored"]) == ("home", ["away"])


def test_remark_replaced_names_what_the_scene_sets(tmp_path):
    said = r"arm\.xml: replaced are timestep_s 0\.0005 by 0\.0008\d+, integrator rk4 by im"
    with pytest.warns(Remark, match=said):
        remark_replaced(world_of(tmp_path, MOON))
    remark_replaced(world_of(tmp_path))  # nothing: an error in tests


def test_keyframe_home_is_the_start_and_is_held(tmp_path):
    boxes = SETTINGS.model_copy(update={"terrain": TerrainSettings(boxes_per_m=1.0)})
    world = world_of(tmp_path, rest=KEYS, settings=boxes)
    assert world.data.joint("swing").qpos == 0.6
    make_trip(world, boxes)
    assert world.data.joint("swing").qpos == pytest.approx(0.6, abs=0.1)
    simulation = Simulation(world, SETTINGS, 1.0)
    assert simulation.reset(np.array([0.0, -1.0, 0.0]))
    assert world.data.joint("swing").qpos == pytest.approx(0.6, abs=0.1)


def test_inertial_unit_at_rest_measures_the_gravity_of_the_world(tmp_path):
    unit = InertialUnit(SETTINGS.imu, np.random.default_rng(0))
    simulation = Simulation(world_of(tmp_path, MOON), SETTINGS, 1.0)
    for _ in range(15):
        simulation.advance(np.zeros(2))
    for _ in range(2):
        np.testing.assert_allclose(unit.read(simulation)[3:], [0, 0, 1.62], atol=0.02)
        simulation.advance(np.zeros(2))


def test_gravity_that_is_off_is_zero(tmp_path):
    walk = RecordSettings(drive=DriveSettings(carrier="handheld", distance_m=1.2))
    world = world_of(tmp_path, '<option><flag gravity="disable"/></option>', settings=walk)
    np.testing.assert_array_equal(world.gravity_mps2, 0)


def test_unstable_world_ends_the_trip_without_a_log_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    world = world_of(tmp_path)
    world.data.joint("swing").qvel = 1e12
    with pytest.raises(DriveError, match=r"the physics is unstable at .* its time step of 0\.8"):
        make_trip(world, SETTINGS)
    assert os.listdir(tmp_path) == ["arm.xml"]


def test_unstable_world_ends_an_environment(tmp_path):
    simulation = Simulation(world_of(tmp_path), SETTINGS, 1.0)
    simulation.world.data.joint("swing").qvel = 1e12
    with pytest.raises(DriveError, match="the physics is unstable at"):
        simulation.advance(np.zeros(2))
