"""Trips without pictures: times, states between times, halts, lost frames, ends, a walking hand."""

import math
from fractions import Fraction

import numpy as np
import pytest

from scenes.scene import Motion
from sim.settings import (
    DriveSettings,
    EncoderSettings,
    ExposureSettings,
    HandheldSettings,
    ImuSettings,
    RecordSettings,
    RigSettings,
    RoverSettings,
    SensorSettings,
)
from sim.world.drive import DriveError
from sim.world.rover import WHEEL_RADIUS_M
from sim.world.trip import REST_S, States, Trip, longest_window_s, make_trip
from sim.world.world import START_S, build_world, steps_per_second
from vo.contract import se3
from vo.contract.arrays import Array

SHORT = DriveSettings(distance_m=0.5)
STEADY = HandheldSettings(sway_m=0, sway_deg=0, tremor_m=0, tremor_deg=0)


@pytest.fixture(scope="module")
def travel(make_scene):
    """Make a trip over the toy plane; words go to the scene."""

    def go(settings: RecordSettings, **words) -> Trip:
        return make_trip(build_world(make_scene(**words), settings), settings)

    return go


@pytest.mark.parametrize("rate_hz", [10, 15, 29.97, 7])
def test_frames_have_their_rate_from_one_second_on(travel, rate_hz):
    trip = travel(RecordSettings(rig=RigSettings(rate_hz=rate_hz), drive=SHORT))
    assert trip.timestamps_ns[0] == START_S * 1e9
    expected_ns = START_S * 1e9 + np.arange(len(trip)) * 1e9 / rate_hz
    np.testing.assert_allclose(trip.timestamps_ns, expected_ns, atol=1, rtol=0)
    assert len(trip) > 5


@pytest.mark.parametrize(
    ("camera_hz", "imu_hz", "encoders_hz"),
    [(15, 200, 100), (20, 200, 50), (30, 250, 100), (25, 1000, 1000), (12.5, 200, 100)],
)
def test_physics_rate_is_a_multiple_of_sensor_rates(camera_hz, imu_hz, encoders_hz):
    settings = RecordSettings(
        rig=RigSettings(rate_hz=camera_hz),
        imu=ImuSettings(rate_hz=imu_hz),
        encoders=EncoderSettings(rate_hz=encoders_hz),
    )
    steps = steps_per_second(settings)
    for rate in (camera_hz, imu_hz, encoders_hz):
        assert (steps / Fraction(rate)).denominator == 1
    assert 1000 <= steps <= 4000


@pytest.mark.parametrize("camera_hz", [29.97, 17, 240])
def test_physics_rate_without_multiple_fits_the_camera(camera_hz):
    settings = RecordSettings(
        rig=RigSettings(rate_hz=camera_hz), imu=ImuSettings(rate_hz=333), drive=SHORT
    )
    steps = steps_per_second(settings)
    assert (Fraction(steps) / Fraction(camera_hz).limit_denominator(1000)).denominator == 1
    assert 1000 <= steps < 1000 + camera_hz


def test_inertial_samples_have_their_rate_from_first_frame(travel):
    trip = travel(RecordSettings(drive=SHORT))
    assert trip.motions.times_ns[0] == trip.timestamps_ns[0]
    np.testing.assert_allclose(np.diff(trip.motions.times_ns), 5_000_000, atol=1)
    np.testing.assert_array_equal(trip.motions.T_world_body[0], trip.T_world_body[0])


def test_angular_velocity_agrees_with_the_rotation(travel):
    route = np.array([[0, 0], [0.5, 0], [0.5, 1.0]])
    motions = travel(RecordSettings(), route=route).motions
    turn = se3.rotation_vector(motions.T_world_body[1:] @ se3.inverse(motions.T_world_body[:-1]))
    mean = (motions.w_world_body[1:] + motions.w_world_body[:-1]) / 2
    assert np.abs(motions.w_world_body[:, 2]).max() > 0.3
    error = turn / 0.005 - mean
    assert np.sqrt((error**2).mean()) < 0.01


def test_states_interpolate_half_the_rotation(make_scene):
    world = build_world(make_scene(), RecordSettings())
    first, second = world.data.qpos.copy(), world.data.qpos.copy()
    first[:7] = [0, 0, 1, 1, 0, 0, 0]
    second[:7] = [2, 4, 1, *_about_z(math.radians(80))]
    first[7:], second[7:] = 0.0, 1.0
    for sign in (1, -1):  # either quaternion of the same rotation
        second[3:7] *= sign
        states = States(np.array([10, 20]), np.stack([first, second]))
        halfway = states.at(world.model, 15)
        np.testing.assert_allclose(halfway[:3], [1, 2, 1], atol=1e-12)
        turned = _about_z(math.radians(40))
        assert abs(halfway[3:7] @ turned) == pytest.approx(1, abs=1e-12)
        np.testing.assert_allclose(halfway[7:], 0.5, atol=1e-12)
        quarter = states.at(world.model, 12.5)
        assert abs(quarter[3:7] @ _about_z(math.radians(20))) == pytest.approx(1, abs=1e-12)


def test_states_are_exact_at_samples_and_clamped(make_scene):
    world = build_world(make_scene(), RecordSettings())
    qpos = np.stack([world.data.qpos + x for x in (0.0, 0.1, 0.3)])
    states = States(np.array([10, 20, 30]), qpos)
    for time_ns, k in ((-5, 0), (10, 0), (20, 1), (30, 2), (99, 2)):
        np.testing.assert_array_equal(states.at(world.model, time_ns), qpos[k])


def test_states_cover_all_exposures(travel):
    exposure = ExposureSettings(time_ms=20, line_time_us=20, right_offset_ms=-5)
    settings = RecordSettings(exposure=exposure, drive=SHORT)
    trip = travel(settings)
    half_ns = longest_window_s(settings) / 2 * 1e9
    assert half_ns == pytest.approx((20 + 480 * 0.02 + 10) / 2 * 1e6)
    for time_ns in trip.timestamps_ns:
        near = trip.states.times_ns[np.abs(trip.states.times_ns - time_ns) <= half_ns + 1e6]
        assert near.min() <= time_ns - half_ns
        assert near.max() >= time_ns + half_ns
        assert np.diff(near).max() < 1_000_001


def test_rover_halts_at_the_set_distance_and_duration(travel):
    drive = DriveSettings(distance_m=1.6, stop_every_m=0.5, stop_s=1.0)
    trip = travel(RecordSettings(drive=drive))
    speed_mps = np.linalg.norm(trip.motions.v_world_body[:, :2], axis=1)
    x = trip.motions.T_world_body[:, 0, 3]
    for halt_m in (0.5, 1.0, 1.5):
        standing_s = (speed_mps[np.abs(x - halt_m) < 0.03] < 0.01).sum() * 0.005
        assert 0.8 < standing_s < 1.4
    for between_m in (0.25, 0.75, 1.25):
        assert speed_mps[np.abs(x - between_m) < 0.05].min() > 0.1
    assert x[-1] == pytest.approx(1.6, abs=0.02)
    assert not trip.ended


def test_lost_frames_have_the_set_share_without_the_first(travel):
    settings = RecordSettings(drive=SHORT, rig=RigSettings(rate_hz=60))
    none = travel(settings)
    assert none.delivered.all()
    for seed in range(2):
        sensor = SensorSettings(drop_share=0.5)
        lossy = travel(settings.model_copy(update={"sensor": sensor, "seed": seed}))
        assert lossy.delivered[0]
        assert 0.35 < lossy.delivered.mean() < 0.65
        np.testing.assert_array_equal(lossy.timestamps_ns, none.timestamps_ns)
        np.testing.assert_array_equal(lossy.T_world_body, none.T_world_body)
    most = travel(settings.model_copy(update={"sensor": SensorSettings(drop_share=0.9)}))
    assert most.delivered[0]


def test_tipped_rover_ends_the_trip_with_a_time(travel):
    trip = travel(RecordSettings(), mover=_ram(3.0, 0.45))
    assert trip.ended.startswith("the rover tipped over at ")
    last_s = trip.timestamps_ns[-1] * 1e-9
    assert 3.0 < last_s < 5.0
    assert np.isfinite(trip.T_world_body).all()
    assert trip.T_world_body[-1, 2, 2] > math.cos(math.radians(60))
    assert trip.T_world_body[0, 2, 2] > 0.999


def test_trip_that_fails_before_second_frame_raises(travel):
    with pytest.raises(DriveError, match="tipped over"):
        travel(RecordSettings(rig=RigSettings(rate_hz=1)), mover=_ram(1.2, 0.05))


def test_walk_starts_and_ends_at_rest_at_rover_height(travel):
    drive = DriveSettings(carrier="handheld", distance_m=1.5, speed_mps=0.8, acceleration_mps2=1.0)
    trip = travel(RecordSettings(drive=drive, handheld=STEADY))
    speed_mps = np.linalg.norm(trip.motions.v_world_body, axis=1)
    assert speed_mps[0] < 0.02
    assert speed_mps[-1] < 1e-6
    assert 0.7 < speed_mps.max() < 0.9
    np.testing.assert_allclose(trip.T_world_body[:, 2, 3], WHEEL_RADIUS_M, atol=1e-9)
    np.testing.assert_allclose(trip.T_world_body[0, :2, 3], [0, 0], atol=1e-3)
    np.testing.assert_allclose(trip.T_world_body[-1, :2, 3], [1.5, 0], atol=0.02)
    assert trip.motions.times_ns[-1] - trip.motions.times_ns[0] > REST_S * 1e9
    assert len(trip.wheel_counts) == 0


def test_walk_sway_and_tremor_have_the_set_size(travel):
    drive = DriveSettings(carrier="handheld", distance_m=2.0, speed_mps=0.8)
    trip = travel(RecordSettings(drive=drive))
    height_m = trip.motions.T_world_body[:, 2, 3] - WHEEL_RADIUS_M
    assert 0.01 < np.abs(height_m).max() < 0.025
    tilt_rad = np.arccos(np.clip(trip.motions.T_world_body[:, 2, 2], -1, 1))
    assert math.radians(1) < tilt_rad.max() < math.radians(4)
    at_start = trip.motions.times_ns < (START_S + 0.1) * 1e9
    assert np.abs(height_m[at_start]).max() < 0.005


def test_walk_velocity_is_the_derivative_of_position(travel):
    drive = DriveSettings(carrier="handheld", distance_m=0.5)
    motions = travel(RecordSettings(drive=drive, imu=ImuSettings(rate_hz=1000))).motions
    secant = np.diff(motions.T_world_body[:, :3, 3], axis=0) / 1e-3
    mean = (motions.v_world_body[1:] + motions.v_world_body[:-1]) / 2
    np.testing.assert_allclose(secant, mean, atol=5e-3)
    turn = se3.rotation_vector(motions.T_world_body[1:] @ se3.inverse(motions.T_world_body[:-1]))
    mean = (motions.w_world_body[1:] + motions.w_world_body[:-1]) / 2
    np.testing.assert_allclose(turn / 1e-3, mean, atol=5e-3)


def test_walk_halts(travel):
    drive = DriveSettings(carrier="handheld", distance_m=1.5, stop_every_m=0.6, stop_s=1.0)
    motions = travel(RecordSettings(drive=drive, handheld=STEADY)).motions
    speed_mps = np.linalg.norm(motions.v_world_body, axis=1)
    near = np.abs(motions.T_world_body[:, 0, 3] - 0.6) < 0.01
    assert 0.9 < (speed_mps[near] < 1e-3).sum() * 0.005 < 1.3


def test_walk_repeats_with_its_seed_only(travel):
    settings = RecordSettings(drive=DriveSettings(carrier="handheld", distance_m=0.5))
    first, second = (travel(settings) for _ in range(2))
    np.testing.assert_array_equal(first.motions.T_world_body, second.motions.T_world_body)
    other = travel(settings.model_copy(update={"seed": 1}))
    assert (other.T_world_body != first.T_world_body).any()


def test_bending_mast_vibrates_and_rigid_mast_does_not(make_scene):
    apart_rad = {}
    for flex_deg in (0.0, 3.0):
        settings = RecordSettings(rover=RoverSettings(flex_deg=flex_deg), drive=SHORT)
        world = build_world(make_scene(bumps=True), settings)
        trip = make_trip(world, settings)
        angles = []
        for time_ns, T_world_body in zip(trip.timestamps_ns, trip.T_world_body, strict=True):
            world.place(time_ns * 1e-9, trip.states.at(world.model, time_ns))
            np.testing.assert_allclose(world.T_world_body, T_world_body, atol=1e-9)
            between = se3.inverse(world.T_world_chassis) @ T_world_body
            angles.append(float(se3.rotation_angle(between)))
        apart_rad[flex_deg] = max(angles)
    assert apart_rad[0.0] < 1e-7
    assert math.radians(0.1) < apart_rad[3.0] < math.radians(5)


def _about_z(angle_rad: float) -> Array:
    return np.array([math.cos(angle_rad / 2), 0, 0, math.sin(angle_rad / 2)])


def _ram(hits_at_s: float, x_m: float) -> Motion:
    """A box that comes from the rover's left and runs over its mast at a given time."""

    def motion(time_s: float) -> Array:
        y_m = np.clip(0.2 - 2.0 * (time_s - hits_at_s), -1.0, 1.0)
        return se3.pose(np.eye(3), np.array([x_m, y_m, 0.42]))

    return motion
