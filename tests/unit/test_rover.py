"""The rover as a machine: weight, rest, straight lines, turns, bumps, and honest encoders."""

import math
import re

import mujoco
import numpy as np
import pytest

from sim.settings import DriveSettings, ImuSettings, RecordSettings, RigSettings
from sim.world.drive import wheel_speeds
from sim.world.rover import BODY, TRACK_M, WHEEL_RADIUS_M
from sim.world.trip import Trip, make_trip
from sim.world.world import START_S, build_world
from vo.contract import se3
from vo.contract.errors import SettingsError


def test_rover_weight_is_on_its_wheels_at_rest(make_scene, settled):
    world = settled(make_scene(), RecordSettings())
    body = world.model.body(BODY)
    assert 10 < body.subtreemass[0] < 12
    assert world.model.opt.timestep <= 0.001
    before = world.T_world_body
    mujoco.mj_step(world.model, world.data, 2000)
    drift = se3.log(se3.inverse(before) @ world.T_world_body)
    assert np.abs(drift).max() < 1e-4
    assert world.T_world_body[2, 3] == pytest.approx(WHEEL_RADIUS_M, abs=5e-4)


def test_rover_drives_straight_at_the_set_speed(make_scene, settled):
    world = settled(make_scene(), RecordSettings())
    start = world.T_world_body
    world.command_wheels(wheel_speeds(0.3, 0.0))
    mujoco.mj_step(world.model, world.data, round(5 / world.model.opt.timestep))
    x, y = (se3.inverse(start) @ world.T_world_body)[:2, 3]
    assert x == pytest.approx(1.5, rel=0.03)
    assert abs(y) < 0.01


def test_rover_turns_on_the_spot(make_scene, settled):
    world = settled(make_scene(), RecordSettings())
    world.command_wheels(wheel_speeds(0.0, math.radians(30)))
    mujoco.mj_step(world.model, world.data, round(3 / world.model.opt.timestep))
    yaw = se3.rotation_vector(world.T_world_body)[2]
    assert yaw == pytest.approx(math.radians(90), rel=0.06)
    assert np.linalg.norm(world.T_world_body[:2, 3]) < 0.03


def test_rover_on_bumps_stays_on_its_route(make_scene):
    settings = RecordSettings()
    flat, bumpy = (
        make_trip(build_world(make_scene(bumps=bumps), settings), settings)
        for bumps in (False, True)
    )

    def tilt_rad(trip: Trip) -> float:
        return float(np.arccos(np.clip(trip.T_world_body[:, 2, 2], -1, 1)).max())

    assert tilt_rad(flat) < math.radians(0.5)
    assert math.radians(0.5) < tilt_rad(bumpy) < math.radians(6)
    assert bumpy.T_world_body[-1, :2, 3] == pytest.approx([3.0, 0.0], abs=0.03)


def test_encoders_agree_with_the_path(make_scene):
    """Dead reckoning from ticks ends within 1.5 % of a path with turns, but not exactly there."""
    route = np.array([[0, 0], [1.5, 0], [2.5, 1.0], [2.5, 2.0], [1.0, 2.0]])
    settings = RecordSettings()
    trip = make_trip(build_world(make_scene(route=route), settings), settings)
    turns = np.diff(trip.wheel_counts, axis=0) / settings.encoders.ticks_per_turn
    left, right = (turns * 2 * math.pi * WHEEL_RADIUS_M).T
    heading = np.concatenate([[0], np.cumsum((right - left) / TRACK_M)])[:-1]
    heading = heading + (right - left) / TRACK_M / 2
    position = [((left + right) / 2 * f(heading)).sum() for f in (np.cos, np.sin)]
    at = trip.T_world_body[-1, :2, 3] - trip.T_world_body[0, :2, 3]
    error = np.linalg.norm(position - at) / trip.length_m
    assert 1e-6 < error < 0.015
    spacing_ns = np.diff(trip.wheel_times_ns)
    assert abs(spacing_ns - 10_000_000).max() <= 1_000_000
    assert trip.wheel_times_ns[0] == trip.timestamps_ns[0]


def test_trip_repeats_exactly(make_scene):
    settings = RecordSettings(drive=DriveSettings(distance_m=1.0))
    first, second = (
        make_trip(build_world(make_scene(bumps=True), settings), settings) for _ in range(2)
    )
    np.testing.assert_array_equal(first.states.qpos, second.states.qpos)
    np.testing.assert_array_equal(first.wheel_counts, second.wheel_counts)


def test_velocity_is_the_derivative_of_position(make_scene):
    settings = RecordSettings(drive=DriveSettings(distance_m=1.0))
    trip = make_trip(build_world(make_scene(), settings), settings)
    seconds = np.diff(trip.timestamps_ns) * 1e-9
    secant = np.diff(trip.T_world_body[:, :3, 3], axis=0) / seconds[:, None]
    mean = (trip.v_world_body[1:] + trip.v_world_body[:-1]) / 2
    np.testing.assert_allclose(secant, mean, atol=0.012)


def test_velocity_is_that_of_its_time_not_of_half_a_step_before(make_scene):
    """Sampled at every physics step, it is the central difference of the positions."""
    settings = RecordSettings(
        rig=RigSettings(rate_hz=10),
        imu=ImuSettings(rate_hz=1000),
        drive=DriveSettings(distance_m=0.3),
    )
    motions = make_trip(build_world(make_scene(), settings), settings).motions
    places, step_s = motions.T_world_body[:, :3, 3], 1e-3
    central = (places[2:] - places[:-2]) / (2 * step_s)
    late = (places[1:-1] - places[:-2]) / step_s
    v = motions.v_world_body[1:-1]
    assert np.abs(v - late).max() > 1e-3
    assert np.abs(v - central).max() < 2e-5


def test_trip_against_a_wall_ends_with_a_reason(make_scene):
    settings = RecordSettings()
    trip = make_trip(build_world(make_scene(wall=True), settings), settings)
    assert re.search(r"got stuck at \d+\.\d+ s near \(0\.\d+, ", trip.ended)
    assert trip.T_world_body[-1, 0, 3] < 1.0
    stuck_s = (trip.timestamps_ns[-1] - START_S * 1e9) * 1e-9
    assert 4 < stuck_s < 25


def test_unknown_route_lists_the_valid_ones(make_scene):
    settings = RecordSettings(drive=DriveSettings(route="scenic"))
    with pytest.raises(SettingsError, match="no route scenic; valid: default"):
        build_world(make_scene(), settings)
