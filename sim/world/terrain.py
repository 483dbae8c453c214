"""Terrain: bricks, sills, ice and cartons along a route, on any scene."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import cv2
import mujoco
import numpy as np

from scenes.geometry.mesh import box, patch, tube
from scenes.scene import Kind, Scene, Thing
from scenes.stage import Stage
from scenes.surfaces import masonry, prints, timber
from scenes.surfaces.atlas import pack
from sim.settings import RecordSettings, TerrainSettings
from sim.world.path import Path
from sim.world.random_streams import stream
from sim.world.rover import TRACK_M
from vo.contract.arrays import Array

PREFIX = "terrain/"
CLEAR_START_M = 0.6
"""Length of the route that stays clear at the start."""
FOOTPRINT_M, FOOTPRINT_X_M = (0.40, 0.42), -0.14
"""Length and width of what the wheels of the rover stand on, and its middle in the body frame."""
BRICK_M = (0.20, 0.10)
BURIED_M = 0.03
"""Depth of the bricks in the ground, so that no wheel gets under them."""
SILL_WIDTH_M, SILL_LENGTH_M = 0.05, 1.1
ICE_M = (0.5, 1.0)
"""Length along and width across the route of a slippery patch."""
ICE_HEIGHT_M = 0.0005
UP: Array = np.array([0.0, 0.0, 1.0])
BOX_MASS_KG, BOX_CLEARANCE_M = 0.6, 0.006


def lay_terrain(
    spec: mujoco.MjSpec, scene: Scene, path: Path, settings: RecordSettings
) -> Mapping[str, Thing]:
    """Add bricks, sills, ice and cartons to a scene's spec; return things by name of their geoms.

    Each kind has its own random stream, so that adding one does not move the others.
    """
    terrain = settings.terrain
    stage = Stage("terrain")
    layers = (
        ("bricks", terrain.brick_mm > 0, _lay_bricks),
        ("sills", terrain.sill_mm > 0, _lay_sills),
        ("ice", terrain.ice_share > 0, _lay_ice),
        ("boxes", terrain.boxes_per_m > 0, _lay_boxes),
    )
    wanted = [(name, lay) for name, is_on, lay in layers if is_on]
    if not wanted:
        return {}
    for name, lay in wanted:
        lay(stage, stream(settings.seed, name), _Way(scene, path), terrain)
    stage.finish(None, None)
    spec.attach(stage.spec, prefix=PREFIX, frame=spec.worldbody.add_frame())
    return {PREFIX + name: thing for name, thing in stage.things.items()}


class _Way:
    """The route with its heading and the ground under it."""

    def __init__(self, scene: Scene, path: Path) -> None:
        self._scene, self._path = scene, path
        self.length_m = path.length_m
        start, ahead = path.waypoints[:2]
        yaw = math.atan2(*(ahead - start)[::-1])
        middle = start + FOOTPRINT_X_M * np.array([math.cos(yaw), math.sin(yaw)])
        self._start = _rectangle(middle, FOOTPRINT_M, yaw)

    def at(self, s_m: float, left_m: float = 0.0) -> tuple[Array, float]:
        """Return the (3,) ground `left_m` beside the route at an arc length, and the heading."""
        here, ahead = self._path.at(s_m), self._path.at(min(s_m + 0.05, self.length_m))
        if np.allclose(here, ahead):
            here = self._path.at(s_m - 0.05)
        yaw = math.atan2(*(ahead - here)[::-1])
        xy = self._path.at(s_m) + left_m * np.array([-math.sin(yaw), math.cos(yaw)])
        return np.array([*xy, float(self._scene.elevation(xy))]), yaw

    def is_clear(self, centre: Array, size: Sequence[float] | Array, yaw: float) -> bool:
        """Whether a thing of a size is beside the rover at its start, to which a loop returns."""
        touch, _ = cv2.rotatedRectangleIntersection(self._start, _rectangle(centre, size, yaw))
        return touch == cv2.INTERSECT_NONE


def _rectangle(centre: Array, size: Sequence[float] | Array, yaw: float) -> cv2.typing.RotatedRect:
    x, y = centre[:2].tolist()
    return (x, y), (float(size[0]), float(size[1])), math.degrees(yaw)


def _steps(way: _Way, step_m: Callable[[], float], most: int = 10_000) -> Iterator[float]:
    """Yield the arc lengths of random steps along the route, beyond its clear start."""
    s = CLEAR_START_M
    for _ in range(most):
        s += step_m()
        if s > way.length_m:
            return
        yield s


def _lay_bricks(
    stage: Stage, rng: np.random.Generator, way: _Way, terrain: TerrainSettings
) -> None:
    """Lay single bricks on the tracks of the wheels, left or right, with random headings."""
    faces = pack(masonry.paving_bricks(rng, 12, (100, 200)))
    stage.material("loose_bricks", faces.image)
    gaps = _steps(way, lambda: terrain.brick_gap_m * rng.uniform(0.5, 1.5))
    for k, s in enumerate(gaps):
        side = rng.choice([-1, 1]) * TRACK_M / 2 + rng.normal(0, 0.02)
        turn, height_mm = rng.uniform(-0.6, 0.6), rng.normal(terrain.brick_mm, terrain.brick_std_mm)
        cell = faces.pick(rng)
        ground, yaw = way.at(s, float(side))
        height = max(height_mm, 0.3 * terrain.brick_mm) * 1e-3
        size = (*BRICK_M, height + BURIED_M)
        centre = ground + (height - BURIED_M) / 2 * UP
        if not way.is_clear(centre, size, yaw + turn):
            continue
        with stage.object(f"brick_{k}", Kind.GROUND):
            brick = box((0, 0, 0), size).textured(cell)
            stage.draw("loose_bricks", brick.moved(centre, yaw + turn))
        stage.obstacle(f"brick_{k}", centre, size, yaw + turn)


def _lay_sills(stage: Stage, rng: np.random.Generator, way: _Way, terrain: TerrainSettings) -> None:
    """Lay door sills and cables across the route in turn, with random headings."""
    stage.material("sill", timber.wood(rng, (128, 512), (150, 116, 80)))
    stage.material("cable", timber.painted(rng, (64, 64), (46, 46, 50)))
    gaps = _steps(way, lambda: terrain.sill_gap_m * rng.uniform(0.6, 1.4))
    for k, s in enumerate(gaps):
        askew = rng.uniform(-0.2, 0.2)
        ground, yaw = way.at(s)
        height = terrain.sill_mm * 1e-3
        if not way.is_clear(ground, (SILL_WIDTH_M, SILL_LENGTH_M), yaw + askew):
            continue
        with stage.object(f"sill_{k}", Kind.GROUND):
            if k % 2 == 0:
                size = (SILL_WIDTH_M, SILL_LENGTH_M, height + BURIED_M)
                centre = ground + (height - BURIED_M) / 2 * UP
                stage.draw("sill", box((0, 0, 0), size, (0.3, 0.1)).moved(centre, yaw + askew))
                stage.obstacle(f"sill_{k}", centre, size, yaw + askew)
            else:
                _lay_cable(stage, f"sill_{k}", ground, yaw + askew, height)


def _lay_cable(stage: Stage, name: str, ground: Array, yaw: float, height_m: float) -> None:
    """Lay a straight cable whose diameter is the height."""
    half = SILL_LENGTH_M / 2 * np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    middle = ground + height_m / 2 * UP
    a, b, radius_m = middle - half, middle + half, height_m / 2
    stage.draw("cable", tube(a, b, radius_m, 12))
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    stage.collision(name, capsule, fromto=[*a, *b], size=(radius_m, 0, 0))


def _lay_ice(stage: Stage, rng: np.random.Generator, way: _Way, terrain: TerrainSettings) -> None:
    """Cover a share of the route with slippery patches."""
    stage.material("ice", masonry.concrete(rng, (512, 512), 176.0))
    pitch = ICE_M[0] / terrain.ice_share
    for k, s in enumerate(np.arange(CLEAR_START_M, way.length_m - ICE_M[0], pitch)):
        ground, yaw = way.at(float(s) + ICE_M[0] / 2)
        size = (*ICE_M, BURIED_M)
        centre = ground + (ICE_HEIGHT_M - BURIED_M / 2) * UP
        with stage.object(f"ice_{k}", Kind.GROUND):
            length, width = (ICE_M[0], 0, 0), (0, ICE_M[1], 0)
            origin = (-ICE_M[0] / 2, -ICE_M[1] / 2, 0.0)
            sheet = patch(origin, length, width, (1, 1), (1.0, 1.0), rng.random(2))
            stage.draw("ice", sheet.moved(ground + ICE_HEIGHT_M * UP, yaw))
        stage.obstacle(f"ice_{k}", centre, size, yaw)
        slippery = stage.spec.geom(f"ice_{k}")
        slippery.friction = (terrain.ice_friction, 0.0002, 0.00001)
        slippery.priority = 1  # its friction, not the larger of the two


def _lay_boxes(stage: Stage, rng: np.random.Generator, way: _Way, terrain: TerrainSettings) -> None:
    """Place light cartons on the route."""
    sides = pack(prints.cartons(rng, 6, 256))
    stage.material("loose_cartons", sides.image)
    gaps = _steps(way, lambda: rng.uniform(0.6, 1.4) / terrain.boxes_per_m, 1_000)
    for k, s in enumerate(gaps):
        size = rng.uniform((0.24, 0.28, 0.28), (0.34, 0.42, 0.44))
        side, turn = rng.uniform(-0.12, 0.12), rng.uniform(-0.4, 0.4)
        cell = sides.pick(rng)
        ground, yaw = way.at(s, side)
        centre = ground + (size[2] / 2 + BOX_CLEARANCE_M) * UP
        if not way.is_clear(centre, size, yaw + turn):
            continue
        with stage.free_body(f"box_{k}", centre, yaw + turn):
            stage.draw("loose_cartons", box((0, 0, 0), size, bottom=True).textured(cell))
            stage.obstacle(f"box_{k}/hull", (0, 0, 0), size, mass_kg=BOX_MASS_KG)
