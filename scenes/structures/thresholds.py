"""Thresholds on a floor: sills, cable ramps, cables and rugs, with collision geoms as drawn."""

from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np

from scenes.geometry.mesh import Mesh, Vector, box, merged, patch, polygons, tube
from scenes.pen import Pen, Place, local
from scenes.scene import Kind
from scenes.stage import Stage
from vo.contract.arrays import Array

BURIED_M = 0.01
"""Depth that rugs' boxes reach below the floor, so that nothing gets under them."""


def sill(
    stage: Stage, name: str, rng: np.random.Generator, place: Place, size: Array, bevel_m: float
) -> None:
    """Screw a sill onto the floor: (3,) length along x, width, height; its long edges bevelled."""
    with stage.object(name, Kind.GROUND):
        put = Pen(stage, place)
        body = merged([_top(size, bevel_m, (0.8, 0.2)), *_bevels(size, bevel_m, (0.8, 0.2))])
        put("sill", replace(body, uv=body.uv + rng.random(2)))
        for x in np.linspace(-0.42, 0.42, 3) * size[0]:
            put("steel", tube((x, 0, size[2] - 0.001), (x, 0, size[2] + 0.0004), 0.006, 10))
    _add_hull(stage, name, place, size, bevel_m)


def cable_ramp(stage: Stage, name: str, place: Place, size: Array, bevel_m: float) -> None:
    """Cover a cable by a rubber ramp of (3,) length along x, width, height; its edges striped."""
    with stage.object(name, Kind.GROUND):
        put = Pen(stage, place)
        put("rubber", _top(size, bevel_m, (0.25, 0.25)))
        for bevel in _bevels(size, bevel_m, (0.2, 0.2)):
            put("hazard", bevel)
    _add_hull(stage, name, place, size, bevel_m)


def cable(stage: Stage, name: str, points: Array, radius_m: float) -> None:
    """Lay a cable on the floor along (N, 2) points, metres, N >= 2."""
    bends = np.column_stack([points, np.full(len(points), radius_m)])
    for k, (a, b) in enumerate(pairwise(bends)):
        with stage.object(name, Kind.GROUND):
            stage.draw("cable", tube(a, b, radius_m, 10))
        capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
        stage.collision(f"{name}_{k}", capsule, fromto=[*a, *b], size=(radius_m, 0, 0))


def rug(stage: Stage, name: str, rng: np.random.Generator, place: Place, size: Array) -> None:
    """Lay a rug of (3,) length, width and thickness, a border woven around its field."""
    length, width, thick = size
    rect = stage.pick("rugs", rng)
    with stage.object(name, Kind.GROUND):
        cells = (int(length / 0.2), int(width / 0.2))
        low = (-length / 2, -width / 2, thick)
        top = patch(low, (length, 0, 0), (0, width, 0), cells)
        put = Pen(stage, place)
        put("rugs", top.textured(rect))
        put("rug_edge", box((0, 0, thick / 2 - 0.0005), (length, width, thick - 0.001), (0.3, 0.3)))
    centre = (place[0], place[1], (thick - BURIED_M) / 2)
    stage.obstacle(name, centre, (length, width, thick + BURIED_M), place[2], shadow=False)


def _top(size: Array, bevel_m: float, period_m: tuple[float, float]) -> Mesh:
    length, width, height = size
    low = (-length / 2, -width / 2 + bevel_m, height)
    return patch(low, (length, 0, 0), (0, width - 2 * bevel_m, 0), (6, 1), period_m)


def _bevels(size: Array, bevel_m: float, period_m: tuple[float, float]) -> list[Mesh]:
    """Build the two sloping sides and the two ends of a prism along x."""
    length, width, height = size
    x, y, run = length / 2, width / 2, (length, 0, 0)
    slopes = [
        patch((-x, -y, 0), run, (0, bevel_m, height), (6, 1), period_m),
        patch((-x, y - bevel_m, height), run, (0, bevel_m, -height), (6, 1), period_m),
    ]
    profile = np.array([(y, 0), (y - bevel_m, height), (bevel_m - y, height), (-y, 0)])
    outlines = ((x, profile), (-x, profile[::-1]))
    ends = np.stack([np.column_stack([np.full(4, side), o]) for side, o in outlines])
    return [*slopes, polygons(ends, np.tile(profile, (2, 1, 1)))]


def _add_hull(stage: Stage, name: str, place: Place, size: Array, bevel_m: float) -> None:
    """Add the convex body of a bevelled prism, standing a little into the floor."""
    x, y, height = size[0] / 2, size[1] / 2, size[2]
    sink = BURIED_M * bevel_m / height  # the slopes go on below the floor
    edges = ((y + sink, -BURIED_M), (y - bevel_m, height))
    signs = ((-1, -1), (-1, 1), (1, -1), (1, 1))
    corners = [(sx * x, sy * half, z) for sx, sy in signs for half, z in edges]
    mesh = stage.spec.add_mesh(name=f"felt/{name}")
    mesh.uservert = np.array(corners, dtype=np.float32).ravel()
    turn = (np.cos(place[2] / 2), 0, 0, np.sin(place[2] / 2))
    shape = mujoco.mjtGeom.mjGEOM_MESH
    stage.collision(name, shape, meshname=mesh.name, pos=(*place[:2], 0.0), quat=turn)


def bridged_cable(
    stage: Stage, name: str, place: Place, ramp_m: Array, bevel_m: float, reach_m: Vector
) -> None:
    """Lay a cable along x under a ramp, out to `reach_m` beyond both of the ramp's ends."""
    cable_ramp(stage, f"{name}_ramp", place, ramp_m, bevel_m)
    for side, reach in zip((-1.0, 1.0), reach_m, strict=True):
        ends = [local(place, side * (ramp_m[0] / 2 + d), 0.0)[:2] for d in (-0.03, reach)]
        cable(stage, f"{name}_{'left' if side < 0 else 'right'}", np.array(ends), 0.0025)
