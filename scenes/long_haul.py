"""Once around a block of houses, three hundred metres, on five kinds of path."""

from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.spatial import KDTree

from scenes.geometry.routes import Ribbon, rounded_loop, route_length
from scenes.lighting.baked_light import sun
from scenes.objects.plants import hedge, tree
from scenes.objects.props import bench, bush, lamp_post, planter
from scenes.objects.vehicles import PAINTS, car
from scenes.pen import Place
from scenes.scene import Kind, Scene
from scenes.stage import Stage
from scenes.structures.facade import facade
from scenes.structures.paths import PATH_M, BlockGround, lawn, pave
from scenes.structures.surround import brick_wall
from scenes.surfaces import floor, greenery, masonry, prints, sky, timber
from vo.contract.arrays import Array
from vo.contract.settings import Settings

TESTS = "A loop of 300 m around a block: drift accumulates, and the end revisits the start."
TAGS = "outdoor level long textured"
MARGIN_M = 12.0
"""Distance that the lawn reaches beyond the route."""
HALF_M = np.array([46.0, 29.0])
"""Half sizes of the route's rectangle, before it is scaled to its length."""


class Options(Settings):
    """Options of the block."""

    length_m: Annotated[float, Field(ge=290, le=320)] = 305.0
    """Length of the route, m."""
    trees: Annotated[int, Field(ge=0, le=80)] = 38
    """Number of trees."""
    houses: Annotated[float, Field(ge=0, le=1)] = 0.8
    """Share of the places for houses that are built up."""


class _Plots:
    """Free space: keeps things off the path and off one another."""

    def __init__(self, route: Array) -> None:
        self._tree = KDTree(route)
        self._taken: list[tuple[Array, float]] = []

    def take(self, spots: Array, radius_m: float) -> bool:
        """Claim circles at (..., 2) metres, unless the path or something else is at one of them."""
        spots = spots.reshape(-1, 2)
        if self._tree.query(spots)[0].min() < radius_m + PATH_M / 2 + 0.1:
            return False
        if any(np.linalg.norm(spots - p, axis=1).min() < radius_m + r for p, r in self._taken):
            return False
        self._taken += [(spot, radius_m) for spot in spots]
        return True

    def take_row(self, start: Array, end: Array, radius_m: float) -> bool:
        """Claim a row of circles from (2,) to (2,) metres, all or none."""
        count = max(2, int(np.ceil(np.linalg.norm(end - start) / radius_m)) + 1)
        return self.take(np.linspace(start, end, count), radius_m)


def build(rng: np.random.Generator, settings: Options) -> Scene:
    """Build the block; route, houses, gardens, textures and light follow the generator."""
    stage = Stage("long_haul")
    ribbon = Ribbon(_route(rng, settings.length_m))
    light = sun(rng, (38, 54))
    _define_materials(stage, rng)
    plots = _Plots(ribbon.route)
    _build_up(stage, rng, plots, ribbon, settings.houses)
    _furnish(stage, rng, plots, ribbon)
    _plant(stage, rng, plots, ribbon, settings.trees)
    low, high = ribbon.route.min(axis=0), ribbon.route.max(axis=0)
    ground = BlockGround(stage, rng, light, low - MARGIN_M, high + MARGIN_M)
    with stage.object("path", Kind.GROUND):
        pave(ground, rng, ribbon)
    with stage.object("lawn", Kind.GROUND):
        lawn(ground, rng, ribbon)
    around = (*(low - 8), *(high + 8))
    return stage.scene(TESTS, TAGS, light, sky.town_sky(rng), route=ribbon.route, reach_m=around)


def _route(rng: np.random.Generator, length_m: float) -> Array:
    """Go around the block counter-clockwise, with a few jogs, scaled to the length."""
    x, y = HALF_M
    jog = rng.uniform(1.0, 2.2, 6)
    corners = np.array([
        (0.1 * x, -y), (0.2 * x, -y + jog[0]), (0.55 * x, -y + jog[0]), (0.65 * x, -y), (x, -y),
        (x, -0.25 * y), (x - jog[1], -0.05 * y), (x - jog[1], 0.35 * y), (x, 0.55 * y), (x, y),
        (0.45 * x, y), (0.3 * x, y - jog[2]), (-0.2 * x, y - jog[2] - jog[3] / 2),
        (-0.35 * x, y), (-x, y),
        (-x, 0.2 * y), (-x + jog[4], -0.1 * y), (-x + jog[4] / 2, -0.5 * y), (-x, -0.65 * y),
        (-x, -y), (-0.5 * x, -y), (-0.4 * x, -y + jog[5]), (-0.15 * x, -y + jog[5]),
    ])  # fmt: skip
    corners[:, 0] *= rng.uniform(0.97, 1.03)
    path = rounded_loop(corners, radius_m=3.0)
    for _ in range(3):  # arcs keep their radius: the scale converges, not at once
        corners *= length_m / route_length(path)
        path = rounded_loop(corners, radius_m=3.0)
    return path


def _define_materials(stage: Stage, rng: np.random.Generator) -> None:
    stage.material("slabs", floor.paving_slabs(rng, 20, 400))
    stage.material("bricks", masonry.paving_bricks(rng, 80, (100, 200)))
    stage.material("setts", floor.granite_setts(rng, 64, 104))
    stage.material("litter", greenery.fallen_leaves(rng, 16, 64))
    stage.material("wall_bricks", masonry.wall_bricks(rng, 40, (48, 140)))
    stage.material("asphalt", floor.asphalt(rng, 1024))
    stage.material("gravel", masonry.gravel(rng, 1024))
    stage.material("concrete", masonry.concrete(rng, (1024, 1024)))
    stage.material("lawn", greenery.lawn(rng, 1024, patchy=0.4))
    stage.material("cover", floor.iron_cover(rng, 384))
    stage.material("mortar", masonry.concrete(rng, (512, 512), 168.0))
    stage.material("leaves", greenery.leaves(rng, 1, 512)[0])
    stage.material("foliage", greenery.foliage(rng, 512, 0.08))
    stage.material("bark", timber.wood(rng, (256, 256), (100, 84, 68)))
    stage.material("timber", timber.wood(rng, (256, 1024), (142, 108, 74)))
    stage.material("iron", timber.painted(rng, (256, 256), (66, 70, 70)))
    stage.material("soil", greenery.soil(rng, 256))
    for k, rgb in enumerate(((206, 186, 150), (190, 160, 138), (184, 188, 180))):
        stage.material(f"plaster_{k}", masonry.plaster(rng, (512, 1024), rgb))
    for k, rgb in enumerate(((84, 104, 92), (112, 82, 60))):
        stage.material(f"wood_{k}", timber.wood(rng, (256, 256), rgb))
    stage.material("roof", timber.painted(rng, (256, 256), (96, 84, 76)))
    stage.material("glass", timber.painted(rng, (128, 128), (58, 66, 74)))
    stage.material("rubber", timber.painted(rng, (128, 128), (34, 34, 36)))
    stage.material("lamps", timber.painted(rng, (64, 64), (188, 150, 140)))
    stage.material("plates", prints.door_signs(rng, 1, 96)[0])
    for k in range(3):
        stage.material(f"paint_{k}", timber.painted(rng, (128, 128), PAINTS[k + 2]))


def _build_up(
    stage: Stage, rng: np.random.Generator, plots: _Plots, ribbon: Ribbon, share: float
) -> None:
    """Line the outside of the route with houses, garden walls and hedges, side by side."""
    low, high = ribbon.route.min(axis=0), ribbon.route.max(axis=0)
    sides = (  # where a row begins, which way it runs: fronts are seen from its right-hand side
        (np.array([low[0], high[1]]), 0.0, high[0] - low[0]),
        (np.array([high[0], high[1]]), -np.pi / 2, high[1] - low[1]),
        (np.array([high[0], low[1]]), np.pi, high[0] - low[0]),
        (np.array([low[0], low[1]]), np.pi / 2, high[1] - low[1]),
    )
    number = 0
    for corner, yaw, run in sides:
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        out = np.array([-ahead[1], ahead[0]])
        along = rng.uniform(0, 3)
        while along < run - 8:
            wide = min(float(rng.uniform(8, 13)), run - along)
            start = corner + along * ahead + rng.uniform(3.6, 6.5) * out
            name, end = f"{number}", start + wide * ahead
            kind = "house" if rng.random() < share else str(rng.choice(["wall", "hedge"]))
            place: Place = (start[0], start[1], yaw)
            if not plots.take_row(start + 0.6 * out, end + 0.6 * out, 0.7):
                pass
            elif kind == "house":
                plaster, wood = f"plaster_{rng.integers(3)}", f"wood_{rng.integers(2)}"
                facade(stage, f"house_{name}", place, rng, wide, 2, plaster, wood)
            elif kind == "wall":
                brick_wall(stage, f"wall_{name}", place, rng, wide, 1.6)
            else:
                hedge(stage, f"hedge_{name}", rng, start, end, rng.uniform(1.0, 1.6))
            along += wide + float(rng.choice([0.4, rng.uniform(2, 5)]))
            number += 1


def _furnish(stage: Stage, rng: np.random.Generator, plots: _Plots, ribbon: Ribbon) -> None:
    """Stand lamps, benches, planters, bushes and cars beside the path."""
    for k, s in enumerate(np.arange(6.0, ribbon.length_m, 17.0)):
        spot = ribbon.at(np.array([s, (1.75, -1.75)[k % 2]]))
        if plots.take(spot, 0.2):
            lamp_post(stage, f"lamp_{k}", spot)
    for k, s in enumerate(np.arange(3.0, ribbon.length_m, 4.3)):
        side = float(rng.choice([-1, 1]))
        kind = rng.choice(
            ["bench", "planter", "bush", "car", "none"], p=[0.14, 0.1, 0.44, 0.14, 0.18]
        )
        reach = {"bench": 0.9, "planter": 0.9, "bush": 0.6, "car": 2.2}.get(str(kind), 0.0)
        off = side * (PATH_M / 2 + reach + rng.uniform(0.15, 0.5))
        spot = ribbon.at(np.array([s + rng.uniform(-0.8, 0.8), off]))
        if not reach or not plots.take(spot, reach):
            continue
        yaw = ribbon.yaw(s)
        if kind == "bench":
            bench(stage, f"bench_{k}", (spot[0], spot[1], yaw + (0.0 if side > 0 else np.pi)), rng)
        elif kind == "planter":
            planter(stage, f"planter_{k}", rng, spot, (1.1, 1.1, 0.42))
        elif kind == "car":
            car(stage, f"car_{k}", (spot[0], spot[1], yaw), rng, f"paint_{rng.integers(3)}")
        else:
            bush(stage, f"bush_{k}", rng, np.array([*spot, 0.0]), float(rng.uniform(0.3, 0.55)))


def _plant(
    stage: Stage, rng: np.random.Generator, plots: _Plots, ribbon: Ribbon, count: int
) -> None:
    """Plant trees: most along the path, the rest in the middle of the block; and inner hedges."""
    for k, s in enumerate(np.arange(10.0, ribbon.length_m, 33.0)):
        ends = ribbon.at(np.array([(s, 2.3), (s + rng.uniform(5, 8), 2.3)]))
        if plots.take_row(ends[0], ends[1], 0.45):
            hedge(stage, f"inner_hedge_{k}", rng, ends[0], ends[1], rng.uniform(0.7, 1.1))
    for k in range(count):
        for _ in range(20):
            if k % 4:
                off = rng.choice([-1, 1]) * rng.uniform(2.4, 7)
                spot = ribbon.at(np.array([rng.uniform(0, ribbon.length_m), off]))
            else:
                spot = rng.uniform(-0.8, 0.8, 2) * HALF_M
            if plots.take(spot, 0.9):
                tree(stage, f"tree_{k}", rng, (*spot, 0.0), rng.uniform(4.0, 8.0))
                break
