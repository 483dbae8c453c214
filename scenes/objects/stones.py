"""Stones and pebbles with facets, and a shovel."""

import numpy as np
from scipy.spatial import ConvexHull

from scenes.geometry.mesh import Mesh, Vector, box, merged, polygons, tube
from scenes.pen import Pen, one_object, piece
from scenes.stage import Stage
from vo.contract.arrays import Array

PERIOD_M = 0.6
"""Period of the texture of stones."""


def facets(rng: np.random.Generator, centre: Array, half: Array, corners: int) -> Mesh:
    """Build a convex stone of about (3,) half sizes from random corners on an ellipsoid."""
    out = rng.standard_normal((corners, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    hull = ConvexHull(out * half * rng.uniform(0.8, 1.0, (corners, 1)))
    faces = hull.points[hull.simplices]
    a, b, c = np.moveaxis(faces, 1, 0)
    inward = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    uv = (faces[..., :2] + faces[..., 2:] * 0.7) / PERIOD_M + rng.random(2)
    return polygons(faces + centre, uv)


@one_object
def stone(stage: Stage, name: str, rng: np.random.Generator, foot: Array, radius_m: float) -> None:
    """Put a stone, a third of it in the ground, at (3,) metres."""
    half = radius_m * rng.uniform((0.8, 0.8, 0.55), (1.25, 1.0, 0.8))
    yaw = rng.uniform(0, 2 * np.pi)
    centre = np.asarray(foot) + np.array((0, 0, 0.35 * half[2]))
    stage.draw("rock", facets(rng, np.zeros(3), half, 44).moved(centre, yaw))
    stage.obstacle(name, centre, 1.75 * half, yaw, shadow=False)
    stage.occluder(centre, 1.5 * half, yaw)


def pebbles(rng: np.random.Generator, feet: Array, radius_m: Vector) -> Mesh:
    """Scatter pebbles of two radii and between at (N, 3) feet, half of each in the ground."""
    radii = rng.uniform(radius_m[0], radius_m[1], (len(feet), 1)) * np.array((1.0, 1.0, 0.8))
    return merged([facets(rng, foot, r, 12) for foot, r in zip(feet, radii, strict=True)])


@piece
def shovel(put: Pen) -> None:
    """Stick a shovel into the ground, its blade towards -y before the turn."""
    put("plastic", box((0, 0, 0.16), (0.26, 0.018, 0.36), (1.0, 1.0), cell_m=0.1))
    put("timber", tube((0, 0.01, 0.3), (0, 0.10, 1.05), 0.017, 10))
    put("timber", tube((-0.08, 0.10, 1.05), (0.08, 0.10, 1.05), 0.015, 8))
    put.solid((0.26, 0.12, 1.05), (0.0, 0.05), shadow=False)
    put.shade(0.16, (0.26, 0.03, 0.36))
    put.shade(0.68, (0.04, 0.06, 0.75), offset=(0.0, 0.05))
