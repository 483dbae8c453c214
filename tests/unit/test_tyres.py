"""Rubber tyres: stiffness as stated, and motion over bricks that does not depend on the step."""

import mujoco
import numpy as np
import pytest

from sim.settings import DriveSettings, ImuSettings, RecordSettings, TerrainSettings
from sim.world.carrier_motion import wheel_forces_n
from sim.world.rover import CONTACT_GROUP, WHEEL_BODIES
from sim.world.trip import Trip, make_trip
from sim.world.tyres import STIFFNESS_N_PER_M
from sim.world.world import build_world

RATE_HZ = 600.0
SETTINGS = RecordSettings(
    imu=ImuSettings(rate_hz=RATE_HZ),
    drive=DriveSettings(distance_m=1.8),
    terrain=TerrainSettings(brick_mm=18, brick_gap_m=0.6),
)


@pytest.fixture(scope="module")
def trips(make_scene) -> list[Trip]:
    """Drives over two bricks with the default time step and with half of it."""
    found = []
    for share in (1.0, 0.5):
        world = build_world(make_scene(), SETTINGS)
        world.model.opt.timestep *= share
        found.append(make_trip(world, SETTINGS))
    return found


def test_tyre_force_at_rest_is_its_stiffness_times_deflection(make_scene, settled):
    world = settled(make_scene(), RecordSettings())
    model, data = world.model, world.data
    mujoco.mj_forward(model, data)
    for name, force_n in zip(WHEEL_BODIES, wheel_forces_n(world), strict=True):
        body = model.body(name).id
        tyre = (model.geom_bodyid == body) & (model.geom_group == CONTACT_GROUP)
        (radius_m,) = model.geom_size[tyre, 0]
        deflection_m = radius_m - data.xpos[body, 2]
        assert force_n == pytest.approx(STIFFNESS_N_PER_M * deflection_m, rel=0.01)
        assert force_n == pytest.approx(36, abs=3)


def test_bump_does_not_depend_on_the_time_step(trips):
    """Half the step changes peaks of acceleration and pitch rate, and the path, by under 5 %."""
    whole, half = (
        np.array([
            *np.abs(np.diff(motions.v_world_body, axis=0) * RATE_HZ).max(axis=0)[[0, 2]],
            np.abs(motions.w_world_body[:, 1]).max(),
            motions.T_world_body[:, 2, 3].max() - motions.T_world_body[0, 2, 3],
        ])
        for motions in (trip.motions for trip in trips)
    )  # fmt: skip
    np.testing.assert_allclose(whole, half, rtol=0.05)
    assert half[1] > 5  # m/s^2
    frames = min(map(len, trips))
    places = [trip.T_world_body[:frames, :3, 3] for trip in trips]
    assert np.linalg.norm(places[0] - places[1], axis=1).max() < 0.005


def test_wheel_load_over_bricks_does_not_chatter(trips):
    """A wheel leaves the ground and lands a few times at each brick, which has two edges."""
    rolling = trips[0].motions.wheel_forces_n[round(RATE_HZ) :] > 0
    landings = np.count_nonzero(~rolling[:-1] & rolling[1:])
    assert 2 <= landings <= 12
