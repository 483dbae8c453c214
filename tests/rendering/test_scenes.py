"""Scenes: they compile, can be driven, and look rich enough through the real rig."""

from collections.abc import Callable
from functools import cache

import cv2
import mujoco
import numpy as np
import pytest

from scenes import SCENES, build_scene
from scenes.routes import route_length
from scenes.scene import Scene
from scenes.scene import HIDDEN_GROUP
from sim.preview import Sights, contact_sheet, look_around
from sim.render import StereoRenderer
from sim.settings import RecordSettings
from sim.world import World, build_world
from vo.contract.arrays import Array

SEED = 11
FOOTPRINT_M = 0.35
"""Radius around the rover's axle that must stay clear."""
BLOCK_PX = 32
HORIZON_ROW = 64
"""First row of blocks below the horizon of the default rig."""

pytestmark = pytest.mark.slow


@cache
def scene_of(name: str) -> Scene:
    return build_scene(name, np.random.default_rng(SEED), {})


@pytest.fixture(scope="module", params=SCENES)
def scene(request) -> Scene:
    return scene_of(request.param)


@cache
def model_of(name: str) -> mujoco.MjModel:
    return scene_of(name).spec.compile()


@pytest.fixture
def model(scene) -> mujoco.MjModel:
    return model_of(scene.name)


def obstacles(model: mujoco.MjModel) -> list[mujoco.MjStruct]:
    geoms = (model.geom(k) for k in range(model.ngeom))
    return [g for g in geoms if g.contype[0] and not g.name.startswith(("brick_", "ground"))]


def gap_to_box(points: Array, geom: mujoco.MjStruct) -> Array:
    """Distance in the plane of (N, 2) points from a box turned about z, 0 inside."""
    c, s = geom.quat[0] ** 2 - geom.quat[3] ** 2, 2 * geom.quat[0] * geom.quat[3]
    offset = points - geom.pos[:2]
    local = np.stack([c * offset[:, 0] + s * offset[:, 1], c * offset[:, 1] - s * offset[:, 0]], 1)
    return np.linalg.norm(np.maximum(np.abs(local) - geom.size[:2], 0), axis=1)


def height_below(model: mujoco.MjModel, points: Array, group: int) -> Array:
    """Height of what a ray straight down meets first in a geom group, for (N, 2) points."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    groups = np.zeros(6, np.uint8)
    groups[group] = 1
    met = np.zeros(1, np.int32)
    down = np.array([0, 0, -1.0])
    return np.array(
        [0.2 - mujoco.mj_ray(model, data, (*p, 0.2), down, groups, 1, -1, met) for p in points]
    )


def test_the_default_route_is_closed_long_and_gentle(scene):
    route = scene.routes["default"]
    np.testing.assert_array_equal(route[0], route[-1])
    assert 30 < route_length(route) < 60
    heading = np.unwrap(np.arctan2(*np.diff(route, axis=0).T[::-1]))
    spacing = np.linalg.norm(np.diff(route, axis=0), axis=1).mean()
    assert np.abs(np.diff(heading)).max() < spacing / 0.6


def test_the_route_is_clear_of_everything_that_stands(scene, model):
    route = scene.routes["default"]
    standing = obstacles(model)
    assert len(standing) > 5
    for geom in standing:
        assert gap_to_box(route, geom).min() > FOOTPRINT_M, geom.name


def test_what_is_drawn_does_not_collide_and_what_collides_is_hidden(model):
    hidden = model.geom_group == HIDDEN_GROUP
    np.testing.assert_array_equal(model.geom_contype > 0, hidden)
    assert (~hidden).sum() < 60


def test_the_pictures_fit_into_memory(model):
    texels = int((model.tex_width.astype(np.int64) * model.tex_height).sum())
    assert texels * 4 * 4 / 3 < 250e6


def test_wheels_feel_the_ground_that_is_drawn(scene, model):
    rng = np.random.default_rng(0)
    route = scene.routes["default"]
    points = route[rng.integers(len(route), size=150)] + rng.uniform(-0.3, 0.3, (150, 2))
    drawn, felt = (height_below(model, points, group) for group in (0, HIDDEN_GROUP))
    assert np.median(np.abs(drawn - felt)) < 2e-4
    on_top = felt >= np.quantile(felt, 0.2)  # in the joints the bevel is drawn, not felt
    assert np.mean(np.abs(drawn - felt)[on_top] < 1e-3) > 0.85


def test_bricks_are_felt_along_the_whole_route():
    model, route = model_of("brick_court"), scene_of("brick_court").routes["default"]
    bricks = np.array(
        [model.geom(k).pos for k in range(model.ngeom) if model.geom(k).name.startswith("brick_")]
    )
    assert 1000 < len(bricks) < 2500
    assert bricks[:, 2].std() == pytest.approx(0.002, rel=0.15)
    nearest = np.linalg.norm(bricks[None, :, :2] - route[:, None], axis=-1).min(axis=1)
    assert nearest.max() < 0.1


def test_a_seed_gives_one_office_and_another_seed_another():
    again = build_scene("office", np.random.default_rng(SEED), {}).spec.compile()
    other = build_scene("office", np.random.default_rng(SEED + 1), {}).spec.compile()
    first = model_of("office")
    np.testing.assert_array_equal(first.mesh_vert, again.mesh_vert)
    np.testing.assert_array_equal(first.mesh_normal, again.mesh_normal)
    np.testing.assert_array_equal(first.tex_data, again.tex_data)
    assert first.mesh_vert.shape != other.mesh_vert.shape


@cache
def looked_around(name: str) -> tuple[World, Sights]:
    world = build_world(scene_of(name), RecordSettings())
    return world, look_around(world, RecordSettings())


@pytest.fixture
def sights(scene) -> Sights:
    return looked_around(scene.name)[1]


@pytest.fixture
def grey_views(sights) -> list[Array]:
    return [cv2.cvtColor(view, cv2.COLOR_RGB2GRAY) for view in sights.views]


def per_block(values: Array, reduce: Callable[..., Array]) -> Array:
    """Reduce (H, W) below the horizon over square blocks."""
    below = values[HORIZON_ROW:]
    rows, columns = (side // BLOCK_PX for side in below.shape)
    blocks = below[: rows * BLOCK_PX, : columns * BLOCK_PX]
    return reduce(blocks.reshape(rows, BLOCK_PX, columns, BLOCK_PX), axis=(1, 3))


@pytest.mark.gl
def test_the_ground_has_corners_in_nearly_every_block(grey_views):
    for grey in grey_views:
        # Smaller eigenvalue of the mean gradient tensor over 5 x 5 pixels; of sensor noise with
        # a deviation of 1 grey level it would be about 2e-5 in OpenCV's scale.
        corner = per_block(cv2.cornerMinEigenVal(grey, 5, 3), np.max)
        assert np.mean(corner > 2e-4) > 0.9


@pytest.mark.gl
def test_pictures_are_well_exposed(sights, grey_views):
    for view, grey in zip(sights.views, grey_views, strict=True):
        assert 60 < grey.mean() < 150
        assert np.mean(grey < 4) < 0.005
        assert np.mean(grey > 251) < 0.005
        saturation = cv2.cvtColor(view, cv2.COLOR_RGB2HSV)[..., 1]
        assert saturation.mean() < 140


@pytest.mark.gl
def test_the_ground_has_no_holes(sights):
    assert np.isfinite(sights.depth_m[HORIZON_ROW:]).all()


@pytest.mark.gl
def test_distant_ground_does_not_alias(scene):
    """Between two views 2 mm apart the far ground hardly changes: mipmaps work."""
    world = looked_around(scene.name)[0]
    views: list[StereoView] = []
    with StereoRenderer(world, RecordSettings().render) as renderer:
        mujoco.mj_resetData(world.model, world.data)
        for _ in range(2):
            world.place_bodies()
            views.append(renderer.stereo(depth=False))
            world.data.joint("rover/free").qpos[:2] += 0.002
    far = [view.left[90:130].astype(float) for view in views]
    assert 0 < np.abs(far[1] - far[0]).mean() < 0.25 * far[0].std()


@pytest.mark.gl
def test_the_contact_sheet_shows_everything(scene):
    world, sights = looked_around(scene.name)
    sheet = contact_sheet(world, sights)
    assert sheet.dtype == np.uint8
    assert sheet.shape == (1140, 1920, 3)
    assert len(np.unique(sheet.reshape(-1, 3), axis=0)) > 10_000
