"""Terrain: what is drawn is what the wheels feel, on its own stream of random numbers."""

import mujoco
import numpy as np
import pytest

from scenes.scene import COLLISION_GROUP, IMAGE_GROUP, LABEL_GROUP, Kind
from sim.settings import DriveSettings, RecordSettings, TerrainSettings
from sim.world.rover import PREFIX as ROVER
from sim.world.terrain import CLEAR_START_M, ICE_HEIGHT_M, PREFIX
from sim.world.trip import make_trip
from sim.world.world import World, build_world, thing_of
from vo.contract.arrays import Array

ROUTE = np.array([[0.0, 0.0], [2.0, 0.0], [4.0, 1.5]])
KINDS = {
    "brick": TerrainSettings(brick_mm=15.0, brick_std_mm=2.0, brick_gap_m=0.2),
    "sill": TerrainSettings(sill_mm=10.0, sill_gap_m=0.5),
    "ice": TerrainSettings(ice_share=0.5),
    "box": TerrainSettings(boxes_per_m=1.0),
}
ALL = TerrainSettings(brick_mm=15, sill_mm=10, ice_share=0.5, boxes_per_m=1.0)


@pytest.fixture(scope="module")
def laid(make_scene):
    """Compile the toy plane with terrain on its route."""

    def lay(terrain: TerrainSettings, seed: int = 0) -> World:
        return build_world(make_scene(route=ROUTE), RecordSettings(seed=seed, terrain=terrain))

    return lay


@pytest.mark.parametrize("kind", KINDS)
def test_terrain_contact_is_at_the_drawn_surface(laid, kind):
    world = laid(KINDS[kind])
    rng = np.random.default_rng(0)
    s = rng.uniform(CLEAR_START_M, world.path.length_m, 3000)
    points = world.path.at(s) + rng.uniform(-0.3, 0.3, (3000, 2))
    felt, drawn, painted = (
        _height_below(world, points, group) for group in (COLLISION_GROUP, LABEL_GROUP, IMAGE_GROUP)
    )
    np.testing.assert_allclose(painted, drawn, atol=1e-6)
    covered = np.isfinite(drawn) & (drawn > 0)
    assert 0.02 < covered.mean() < 0.9
    assert np.mean(np.abs(felt - drawn)[covered] < 5e-4) > 0.99
    nothing = ~np.isfinite(drawn)
    assert np.mean(~np.isfinite(felt[nothing])) > 0.995


@pytest.mark.parametrize(
    ("kind", "height_m", "spread_m"),
    [("brick", 0.015, 0.002), ("sill", 0.010, 0.0), ("ice", ICE_HEIGHT_M, 0.0)],
)
def test_terrain_has_the_set_height(laid, kind, height_m, spread_m):
    world = laid(KINDS[kind])
    tops = np.array([_top(world, name) for name in _felt(world, kind)])
    assert len(tops) >= 4
    assert tops.mean() == pytest.approx(height_m, abs=max(spread_m, 1e-6))
    assert tops.std() == pytest.approx(spread_m, abs=0.6 * spread_m + 1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_terrain_is_on_the_route_with_a_clear_start(laid, kind):
    world = laid(KINDS[kind])
    centres = np.array([world.data.geom(name).xpos[:2] for name in _felt(world, kind)])
    route = world.path.at(np.linspace(0, world.path.length_m, 500))
    beside = np.linalg.norm(centres[:, None] - route, axis=-1).min(axis=1)
    assert beside.max() < 0.3
    assert np.linalg.norm(centres, axis=1).min() > CLEAR_START_M - 0.05


def test_terrain_kinds_are_independent(laid):
    everything, other_seed = laid(ALL), laid(ALL, seed=1)
    fields = {"brick": "brick_mm", "sill": "sill_mm", "ice": "ice_share", "box": "boxes_per_m"}
    for kind, field in fields.items():
        alone = laid(TerrainSettings(**{field: getattr(ALL, field)}))
        names = _felt(alone, kind)
        assert names == _felt(everything, kind)
        places = [alone.data.geom(name).xpos for name in names]
        np.testing.assert_array_equal(places, [everything.data.geom(n).xpos for n in names])
        if kind != "ice":  # evenly spaced by design
            others = [other_seed.data.geom(n).xpos for n in _felt(other_seed, kind)]
            assert len(others) != len(places) or np.any(np.array(others) != places)


def test_terrain_geoms_have_their_things(laid):
    world = laid(ALL)
    seen = {thing_of(world, g) for g in range(world.model.ngeom) if world.model.geom_group[g] == 4}
    kinds = {thing.name.split("_")[0]: thing.kind for thing in seen}
    assert kinds == {
        "brick": Kind.GROUND,
        "sill": Kind.GROUND,
        "ice": Kind.GROUND,
        "box": Kind.MOVING,
    }


def test_terrain_switched_off_adds_no_geoms(laid):
    world = laid(TerrainSettings())
    names = {world.model.geom(g).name for g in range(world.model.ngeom)}
    assert not any(name.startswith(PREFIX) for name in names)


def test_terrain_bricks_shake_cartons_move_ice_slips(make_scene):
    route = np.array([[0.0, 0.0], [3.0, 0.0]])

    def drive(terrain: TerrainSettings):
        settings = RecordSettings(terrain=terrain, drive=DriveSettings(speed_mps=0.5))
        world = build_world(make_scene(route=route), settings)
        return world, make_trip(world, settings), settings

    _, flat, settings = drive(TerrainSettings())
    _, bumpy, _ = drive(TerrainSettings(brick_mm=14.0))
    _, icy, _ = drive(TerrainSettings(ice_share=1.0, ice_friction=0.001))
    pushed, crowded, _ = drive(TerrainSettings(boxes_per_m=1.0))
    rise_m = [trip.T_world_body[:, 2, 3].max() - 0.05 for trip in (flat, bumpy)]
    assert rise_m[0] < 0.001
    assert 0.005 < rise_m[1] < 0.02

    def wheels_m(trip) -> float:
        turns = trip.wheel_counts[-1].mean() / settings.encoders.ticks_per_turn
        return float(turns * 2 * np.pi * 0.05 - trip.length_m)

    assert abs(wheels_m(flat)) < 0.02
    assert wheels_m(icy) > 0.1
    box = pushed.model.joint(pushed.model.body(f"{PREFIX}box_0").jntadr[0]).qposadr[0]
    first, last = (crowded.states.qpos[k, box : box + 2] for k in (0, -1))
    assert np.linalg.norm(last - first) > 0.2


def _height_below(world: World, points: Array, group: int) -> Array:
    """Height of what a ray straight down meets first in a geom group; NaN for nothing."""
    groups = np.zeros(6, np.uint8)
    groups[group] = 1
    hits = world.model.geom_group == group
    mine = [g for g in np.flatnonzero(hits) if not world.model.geom(g).name.startswith(ROVER)]
    assert mine
    met = np.zeros(1, np.int32)
    down = np.array([0.0, 0.0, -1.0])
    distances = [
        mujoco.mj_ray(world.model, world.data, np.array([*p, 0.8]), down, groups, 1, -1, met)
        for p in points
    ]
    return np.where(np.array(distances) < 0, np.nan, 0.8 - np.array(distances))


def _felt(world: World, kind: str) -> list[str]:
    """Names of the geoms of a kind that collide."""
    names = [world.model.geom(g).name for g in range(world.model.ngeom)]
    prefix = f"{PREFIX}{kind}_"
    return [n for n in names if n.startswith(prefix)]


def _top(world: World, name: str) -> float:
    """Height of a geom's highest point above the plane, for upright boxes and lying capsules."""
    geom, model = world.data.geom(name), world.model.geom(name)
    capsule = model.type[0] == mujoco.mjtGeom.mjGEOM_CAPSULE
    return float(geom.xpos[2] + model.size[0 if capsule else 2])


@pytest.mark.parametrize(
    "terrain",
    [
        TerrainSettings(brick_mm=14, brick_gap_m=0.1),
        TerrainSettings(sill_mm=10, sill_gap_m=0.3),
        TerrainSettings(boxes_per_m=1.6),
    ],
)
def test_terrain_spares_the_start_that_a_loop_returns_to(make_scene, terrain):
    loop = np.array([[0, 0], [2, 0], [2, 2], [-1, 2], [-1, 0], [0, 0]], float)
    world = build_world(make_scene(route=loop), RecordSettings(terrain=terrain))
    laid = [k for k in range(world.model.ngeom) if world.model.geom(k).name.startswith(PREFIX)]
    model = world.model
    felt = [k for k in laid if model.geom_group[k] == COLLISION_GROUP]
    rover = model.body_rootid[model.geom_bodyid] == model.body(ROVER + "body").id
    assert len(felt) > 12
    mujoco.mj_step(model, world.data, 200)
    pairs = world.data.contact.geom
    assert rover[pairs].any()
    assert not (rover[pairs].any(axis=1) & np.isin(pairs, felt).any(axis=1)).any()
