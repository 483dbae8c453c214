"""Scenes: they compile, can be driven, feel as they look, and look as they promise."""

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256

import cv2
import mujoco
import numpy as np
import pytest
from scipy.spatial import cKDTree

from scenes import SCENES, build_scene
from scenes.geometry.routes import route_length
from scenes.scene import COLLISION_GROUP, IMAGE_GROUP, LABEL_GROUP, Kind, Scene
from sim.camera.render import GeometryBuffers, StereoRenderer
from sim.settings import RecordSettings
from sim.world.rover import PREFIX, WHEEL_RADIUS_M
from sim.world.world import World, build_world
from vo.contract.arrays import Array, Image

SEED = 11
FOOTPRINT_M = 0.35
"""Radius around the rover's axle that must stay clear."""
STANDS_M = 0.05
"""What is higher above the ground than this stands in the way."""
PASSES_UNDER_M = 1.9
"""The rover and a person's hands pass below what is higher than this."""
REPEATED = "crowded"
"""Scene that is built again in another process: it uses most objects and surfaces."""
RESEEDED = "stop_and_go"
"""Scene that is built from another seed, since it is built fastest."""
LONG_M = {"long_haul": (250, 360), "street": (140, 260)}
"""Shortest and longest route of the scenes that are not of the usual size."""
STOPS = 3
BLOCK_PX = 32
RIM_PX = 20
"""Rows below the horizon in which the ground may end: it reaches at least 12 m."""
CORNER = 2e-4
"""Smaller eigenvalue of the mean gradient tensor over 5 x 5 pixels, in OpenCV's scale; of sensor
noise with a deviation of 1 grey level it would be about 2e-5."""

pytestmark = [pytest.mark.slow, pytest.mark.gl]


@dataclass(frozen=True)
class Tour:
    """A scene, and what the rig sees in it.

    Attributes:
        scene: As built, with its default options.
        world: With the rover at the start.
        views: STOPS left images, RGB.
        geometries: Depth and geoms of the same views.
        nudged: Two grey left images, the second from 2 mm further ahead.
    """

    scene: Scene
    world: World
    views: list[Image]
    geometries: list[GeometryBuffers]
    nudged: list[Image]

    @property
    def model(self) -> mujoco.MjModel:
        return self.world.model

    @cached_property
    def greys(self) -> list[Image]:
        return [cv2.cvtColor(view, cv2.COLOR_RGB2GRAY) for view in self.views]

    @cached_property
    def names(self) -> list[str]:
        return [self.model.geom(k).name for k in range(self.model.ngeom)]

    @cached_property
    def own(self) -> Array:
        """(ngeom,) whether a geom belongs to the scene, not to the rover."""
        rover = self.model.body(PREFIX + "body").id
        return self.model.body_rootid[self.model.geom_bodyid] != rover

    @property
    def horizon_row(self) -> int:
        rig = self.world.rig
        tilt = np.radians(settings_of(self.scene.name).rig.tilt_deg)
        return max(0, int((rig.height_px - 1) / 2 - rig.f_px * np.tan(tilt)) + 1)

    def kinds(self, geometry: GeometryBuffers) -> Array:
        """Kind of every pixel of the left image; SKY where nothing is hit."""
        table = np.zeros(self.model.ngeom + 1, int)
        for k, name in enumerate(self.names):
            if name in self.scene.things:
                table[k] = self.scene.things[name].kind
        return table[np.where(geometry.geoms_left < 0, self.model.ngeom, geometry.geoms_left)]


def settings_of(name: str) -> RecordSettings:
    """The rig as the scene wants it; light and lens are perfect, and the rover carries it."""
    rig = {k[4:]: v for k, v in SCENES[name].defaults.items() if k.startswith("rig.")}
    return RecordSettings.model_validate({"rig": rig})


def stand(world: World, along: float, ahead_m: float = 0.0) -> None:
    """Put the rover on its route at a share of the length, flat on the ground."""
    route = world.scene.routes["default"]
    k = int(along * (len(route) - 2))
    way = (route[k + 1] - route[k]) / np.linalg.norm(route[k + 1] - route[k])
    x, y = route[k] + ahead_m * way
    rise = np.diff(world.scene.elevation(route[k : k + 2]))[0]
    yaw, pitch = np.arctan2(*way[::-1]), -np.arctan2(rise, np.linalg.norm(route[k + 1] - route[k]))
    turn = np.zeros(4)
    about_z = np.array([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])
    mujoco.mju_mulQuat(turn, about_z, np.array([np.cos(pitch / 2), 0, np.sin(pitch / 2), 0]))
    height = float(world.scene.elevation(np.array([x, y]))) + WHEEL_RADIUS_M
    mujoco.mj_resetData(world.model, world.data)
    world.data.joint(PREFIX + "free").qpos = (x, y, height, *turn)
    world.place(0.0, world.data.qpos)


@pytest.fixture(scope="module")
def built_elsewhere() -> Iterator[Future[dict[str, str]]]:
    """Digests of a scene, as another process builds it meanwhile."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as other:
        yield other.submit(digests, REPEATED, SEED)


def digests(name: str, seed: int) -> dict[str, str]:
    return digests_of(build_scene(name, np.random.default_rng(seed), {}))


def digests_of(scene: Scene) -> dict[str, str]:
    model = scene.spec.compile()
    fields = ("mesh_vert", "mesh_normal", "mesh_texcoord", "tex_data", "geom_pos", "geom_size")
    return {field: sha256(getattr(model, field).tobytes()).hexdigest() for field in fields}


@pytest.fixture(scope="module", params=SCENES)
def tour(request, built_elsewhere) -> Tour:
    del built_elsewhere  # only asked for so that it starts early
    name = request.param
    scene = build_scene(name, np.random.default_rng(SEED), {})
    world = build_world(scene, settings_of(name))
    views: list[Image] = []
    geometries: list[GeometryBuffers] = []
    nudged: list[Image] = []
    with StereoRenderer(world, RecordSettings().render, color=True) as renderer:
        for along in np.arange(STOPS) / STOPS:
            stand(world, along)
            views.append(renderer.render_images()[0])
            geometries.append(renderer.render_geometry())
        for ahead_m in (0.0, 0.002):
            stand(world, 0.1, ahead_m)
            nudged.append(cv2.cvtColor(renderer.render_images()[0], cv2.COLOR_RGB2GRAY))
    return Tour(scene, world, views, geometries, nudged)


def test_scene_carries_its_defaults(tour):
    assert tour.scene.defaults == SCENES[tour.scene.name].defaults


def test_route_is_closed_long_and_gentle(tour):
    route = tour.scene.routes["default"]
    np.testing.assert_array_equal(route[0], route[-1])
    low, high = LONG_M.get(tour.scene.name, (30, 60))
    assert low < route_length(route) < high
    steps = np.linalg.norm(np.diff(route, axis=0), axis=1)
    assert steps.max() < 0.2
    heading = np.unwrap(np.arctan2(*np.diff(route, axis=0).T[::-1]))
    sharpest = np.abs(np.diff(heading)).max()
    if "sharp" in tour.scene.tags:
        assert sharpest > np.radians(60)
    else:
        assert sharpest < steps.mean() / 0.6


def test_route_is_clear_of_obstacles(tour):
    model, route = tour.model, tour.scene.routes["default"]
    standing = 0
    for k in np.flatnonzero(tour.own & (model.geom_contype > 0) & (model.geom_bodyid == 0)):
        if model.geom_type[k] == mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        corners = box_corners(model, k)
        ground = tour.scene.elevation(corners[:, :2])
        if (corners[:, 2] - ground < STANDS_M).all():
            continue
        if corners[:, 2].min() > ground.max() + PASSES_UNDER_M:
            continue
        standing += 1
        assert gap_to_box(route, model, k).min() > FOOTPRINT_M, tour.names[k]
    assert standing > 5


def box_corners(model: mujoco.MjModel, geom: int) -> Array:
    """(8, 3) corners in the world of the box around a geom in its own frame."""
    signs = np.stack(np.meshgrid(*[(-1, 1)] * 3), axis=-1).reshape(-1, 3)
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    return model.geom_pos[geom] + (middle + signs * half) @ turn_of(model, geom).T


def turn_of(model: mujoco.MjModel, geom: int) -> Array:
    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, model.geom_quat[geom])
    return flat.reshape(3, 3)


def gap_to_box(points: Array, model: mujoco.MjModel, geom: int) -> Array:
    """Distance in the plane of (N, 2) points from a geom's box, turned about z; 0 inside."""
    middle, half = model.geom_aabb[geom, :2], model.geom_aabb[geom, 3:5]
    local = (points - model.geom_pos[geom, :2]) @ turn_of(model, geom)[:2, :2] - middle
    return np.linalg.norm(np.maximum(np.abs(local) - half, 0), axis=1)


def test_drawn_geoms_do_not_collide_colliding_are_hidden(tour):
    group, collides = tour.model.geom_group, tour.model.geom_contype > 0
    assert set(group[tour.own]) == {COLLISION_GROUP, LABEL_GROUP, IMAGE_GROUP}
    np.testing.assert_array_equal(collides[tour.own], group[tour.own] == COLLISION_GROUP)
    named = {name for name, g in zip(tour.names, group, strict=True) if g == LABEL_GROUP}
    assert named == set(tour.scene.things)


def test_labels_have_the_triangles_of_the_images(tour):
    painted, labelled = (triangle_moments(tour, group) for group in (IMAGE_GROUP, LABEL_GROUP))
    assert painted.keys() == labelled.keys()
    for body, moments in painted.items():
        np.testing.assert_allclose(moments, labelled[body], rtol=1e-4, atol=1e-2)


def triangle_moments(tour: Tour, group: int) -> dict[int, Array]:
    """For each body: number of triangles, their area, its first and second moments."""
    model = tour.model
    sums: dict[int, Array] = {}
    for k in np.flatnonzero(tour.own & (model.geom_group == group)):
        mesh = model.geom_dataid[k]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        points = model.mesh_vert[first : first + count] @ turn_of(model, k).T + model.geom_pos[k]
        first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        a, b, c = (points[model.mesh_face[first : first + count, i]] for i in range(3))
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        middle = (a + b + c) / 3
        moments = np.concatenate([[count, area.sum()], area @ middle, area @ middle**2])
        body = model.geom_bodyid[k]
        sums[body] = sums.get(body, 0) + moments
    return sums


def test_scene_fits_memory_and_frame_time(tour):
    model = tour.model
    texels = int((model.tex_width.astype(np.int64) * model.tex_height).sum())
    assert texels * 4 * 4 / 3 < 250e6
    painted = model.geom_dataid[tour.own & (model.geom_group == IMAGE_GROUP)]
    assert model.mesh_facenum[painted].sum() < 300_000
    assert model.nmat <= 50


def test_wheel_contact_is_at_the_drawn_ground(tour):
    rng = np.random.default_rng(0)
    route = tour.scene.routes["default"]
    points = route[rng.integers(len(route), size=150)] + rng.uniform(-0.2, 0.2, (150, 2))
    drawn, shown = ray_down(tour, points, LABEL_GROUP)
    felt, _ = ray_down(tour, points, COLLISION_GROUP)
    ground = np.array([tour.scene.things[tour.names[k]].kind == Kind.GROUND for k in shown])
    assert ground.mean() > 0.8  # else leaves and people
    apart, level = (drawn - felt)[ground], felt[ground]
    assert np.median(np.abs(apart)) < 2e-4
    on_top = level >= np.quantile(level, 0.2)  # in the joints the bevel is drawn, not felt
    assert np.mean(np.abs(apart)[on_top] < 1.3e-3) > 0.85
    tops = tour.scene.elevation(points[ground][on_top])
    assert np.mean(np.abs(level[on_top] - tops) < 0.012) > 0.95


def ray_down(tour: Tour, points: Array, group: int) -> tuple[Array, Array]:
    """Height of what a ray straight down meets first in a geom group, and which geom it is."""
    groups = np.zeros(6, np.uint8)
    groups[group] = 1
    met = np.zeros(1, np.int32)
    down = np.array([0, 0, -1.0])
    rover = tour.model.body(PREFIX + "body").id
    stand(tour.world, 0.0)
    heights: list[float] = []
    geoms: list[int] = []
    for x, y in points:
        start = np.array([x, y, float(tour.scene.elevation(np.array([x, y]))) + 0.2])
        way = mujoco.mj_ray(tour.model, tour.world.data, start, down, groups, 1, rover, met)
        heights.append(start[2] - way)
        geoms.append(int(met[0]))
    return np.array(heights), np.array(geoms)


def test_objects_have_unique_names_above_the_ground(tour):
    kind_of: dict[str, set[Kind]] = {}
    for thing in tour.scene.things.values():
        kind_of.setdefault(thing.name, set()).add(thing.kind)
    assert all(len(kinds) == 1 for kinds in kind_of.values())
    assert len(kind_of) > 8
    assert {Kind.GROUND} in kind_of.values()
    moving = {name for name, kinds in kind_of.items() if kinds == {Kind.MOVING}}
    assert bool(moving) == bool(tour.scene.movers)
    below = np.stack([tour.kinds(geometry)[-BLOCK_PX:] for geometry in tour.geometries])
    assert np.mean(below == Kind.GROUND) > 0.75
    assert (below != Kind.SKY).all()


def test_world_has_no_holes(tour):
    """Rooms are closed, and outdoors everything below the horizon is something.

    Hairlines remain where surfaces meet that share no vertices.
    """
    first = 0 if "indoor" in tour.scene.tags else min(tour.horizon_row + RIM_PX, 400)
    for geometry in tour.geometries:
        assert np.isfinite(geometry.depth_left_m[-BLOCK_PX:]).all()
        assert np.mean(np.isnan(geometry.depth_left_m[first:])) < 3e-4


def test_images_are_well_exposed(tour):
    means = [grey.mean() for grey in tour.greys]
    if "dark" not in tour.scene.tags:
        assert min(means) > 55
        assert max(means) < 170
    for view, grey in zip(tour.views, tour.greys, strict=True):
        assert np.mean(grey > 251) < 0.01
        saturation = cv2.cvtColor(view, cv2.COLOR_RGB2HSV)[..., 1]
        assert saturation.mean() < 140


def test_texture_is_as_rich_as_the_scene_states(tour):
    shares = [cornered_blocks(grey[tour.horizon_row :]) for grey in tour.greys]
    corners = [len(strong_corners(grey)) for grey in tour.greys]
    if "plain" in tour.scene.tags:
        assert min(corners) > 10
        assert np.mean(corners) < 120
        assert np.mean(shares) < 0.5
    elif "textured" in tour.scene.tags:
        assert min(corners) > 150
        assert np.mean(shares) > 0.6
    else:
        assert min(corners) > 60


def strong_corners(grey: Image) -> Array:
    """(N, 2) pixels where the corner strength is over `CORNER`, at least 12 px apart."""
    strength = cv2.cornerMinEigenVal(grey, 5, 3)
    peak = strength == cv2.dilate(strength, np.ones((25, 25)))
    return np.argwhere(peak & (strength > CORNER))


def cornered_blocks(grey: Image) -> float:
    """Share of square blocks that have a strong corner."""
    rows, columns = (side // BLOCK_PX for side in grey.shape)
    strength = cv2.cornerMinEigenVal(grey, 5, 3)[: rows * BLOCK_PX, : columns * BLOCK_PX]
    blocks = strength.reshape(rows, BLOCK_PX, columns, BLOCK_PX).max(axis=(1, 3))
    return float(np.mean(blocks > CORNER))


def test_distant_surfaces_do_not_alias(tour):
    """Between two views 2 mm apart what is far hardly changes: mipmaps work."""
    first = tour.horizon_row + 20
    far = [view[first : first + 50].astype(float) for view in tour.nudged]
    assert 0 < np.abs(far[1] - far[0]).mean() < 0.25 * far[0].std() + 0.5


@pytest.mark.parametrize("tour", [REPEATED], indirect=True)
def test_world_repeats_with_its_seed(tour, built_elsewhere):
    assert built_elsewhere.result() == digests_of(tour.scene)


@pytest.mark.parametrize("tour", [RESEEDED], indirect=True)
def test_world_of_another_seed_differs(tour):
    theirs = digests(RESEEDED, SEED + 1)
    assert all(theirs[field] != mine for field, mine in digests_of(tour.scene).items())


def test_bricks_shake_the_rover_along_the_route(tour):
    laid = np.flatnonzero([name.startswith("brick_") for name in tour.names])
    if not len(laid):
        assert tour.scene.name != "brick_court"
        return
    route = tour.scene.routes["default"]
    bricks = tour.model.geom_pos[laid]
    assert 1000 < len(bricks) < 2500
    assert bricks[:, 2].std() == pytest.approx(0.002, rel=0.15)
    nearest, _ = cKDTree(bricks[:, :2]).query(route)
    assert nearest.max() < 0.1
