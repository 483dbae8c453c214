"""Plants: grass of any length, flowers, trees and hedges."""

import numpy as np

from scenes.geometry.mesh import Mesh, Vector, merged, polygons, tube
from scenes.objects.props import ball, leaf_cloud
from scenes.pen import one_object
from scenes.stage import Stage
from vo.contract.arrays import Array

UV_BLADE = 0.05
"""Share of the grass texture that a blade shows: about one tone."""


def grass(rng: np.random.Generator, feet: Array, height_m: Array, width_m: Array) -> Mesh:
    """Grow one bent blade at each of (N, 3) feet, (N,) high and (N,) wide at the foot, metres.

    Returns:
        Two triangles for each blade: straight below, hanging over above.
    """
    count = len(feet)
    azimuth = rng.uniform(0, 2 * np.pi, count)
    out = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    lean = (rng.gamma(2.0, 0.13, count) * height_m)[:, None] * out
    side = 0.5 * width_m[:, None] * np.column_stack([-out[:, 1], out[:, 0]])
    knee = np.column_stack([0.35 * lean, 0.6 * height_m])
    tip = np.column_stack([lean, height_m])
    flat = np.zeros((count, 1))
    left, right = np.hstack([side, flat]), np.hstack([-side, flat])
    corners = np.stack([feet + left, feet + right, feet + tip, feet + knee + 0.8 * left], axis=1)
    along = np.array([(0, 0), (0.1, 0), (0.05, 1), (0, 0.6)]) * UV_BLADE
    uv = rng.random((count, 1, 2)) + along
    tilt = np.column_stack([rng.normal(0, 0.35, (count, 2)), np.ones(count)])
    tilt /= np.linalg.norm(tilt, axis=1, keepdims=True)  # blades catch the sun one by one
    return polygons(corners, uv, np.broadcast_to(tilt[:, None], corners.shape))


def flowers(
    rng: np.random.Generator, feet: Array, height_m: Array, radius_m: float, palette: Array
) -> tuple[Mesh, Mesh]:
    """Grow a flower at each of (N, 3) feet, (N,) high, of (K, 2) uv of the palette's colours.

    Returns:
        The stems, for the grass texture, and the blossoms, for the palette's.
    """
    count = len(feet)
    lean = np.column_stack([rng.normal(0, 0.1, (count, 2)), np.ones(count)])
    head = feet + height_m[:, None] * lean
    side = np.array([0.002, 0, 0])
    low, upright = np.stack([feet - side, feet + side, head], axis=1), np.array([0, 0, 1.0])
    tone = rng.random((count, 1, 2)) + np.zeros((1, 3, 1))
    stem = polygons(low, tone, np.broadcast_to(upright, low.shape))
    up = lean + rng.normal(0, 0.35, (count, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    e1 = np.cross(up, [1.0, 0, 0])
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    e2 = np.cross(up, e1)
    angle = np.arange(6) * np.pi / 3
    size = radius_m * rng.uniform(0.7, 1.2, (count, 1, 1))
    petals = np.cos(angle)[:, None] * e1[:, None] + np.sin(angle)[:, None] * e2[:, None]
    corners = head[:, None] + size * petals
    uv = np.repeat(palette[rng.integers(len(palette), size=count)][:, None], 6, axis=1)
    return stem, polygons(corners, uv, np.repeat(up[:, None], 6, axis=1))


@one_object
def tree(stage: Stage, name: str, rng: np.random.Generator, foot: Vector, height_m: float) -> None:
    """Plant a broad-leaved tree at (3,) metres: a trunk, boughs and a crown of lobes."""
    base, up = np.asarray(foot, dtype=float), np.array((0, 0, height_m))
    crown = base + np.array((0, 0, 0.62 * height_m))
    reach = 0.3 * height_m
    stage.draw("bark", tube(base, base + 0.55 * up, 0.035 * height_m, 9, 0.6))
    lobes: list[Mesh] = [ball(rng, crown, 0.75 * reach, period_m=2.2)]
    for _ in range(6):
        out = rng.standard_normal(3) * (1, 1, 0.8)
        at = crown + 0.75 * reach * out / np.linalg.norm(out)
        lobes.append(ball(rng, at, rng.uniform(0.4, 0.62) * reach, period_m=2.2))
    for turn in rng.uniform(0, 2 * np.pi, 3):
        end = crown + 0.5 * reach * np.array([np.cos(turn), np.sin(turn), 0.1])
        stage.draw("bark", tube(base + 0.4 * up, end, 0.018 * height_m, 6, 0.5))
    stage.draw("foliage", *lobes)
    stage.obstacle(name, base + 0.3 * up, (0.2, 0.2, 0.6 * height_m), shadow=False)
    stage.occluder(base + 0.25 * up, np.array([0.06, 0.06, 0.5]) * height_m)
    stage.occluder(crown, np.array([1.9, 1.9, 1.6]) * reach, rng.uniform(0, 1.5), 0.75)


@one_object
def hedge(
    stage: Stage, name: str, rng: np.random.Generator, start: Vector, end: Vector, height_m: float
) -> None:
    """Grow a clipped hedge, 0.6 m thick, from (2,) `start` to (2,) `end` metres."""
    a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    length = float(np.linalg.norm(b - a))
    yaw = float(np.arctan2(*(b - a)[::-1]))
    lobes: list[Mesh] = []
    for along in np.arange(0.25, length, 0.42):
        centre = (along, rng.normal(0, 0.03), 0.42 * height_m)
        lobe = ball(rng, (0, 0, 0), 0.36, period_m=0.7)
        stretched = lobe.points * (1.0, 0.85, 0.55 * height_m / 0.36) + centre
        lobes.append(Mesh(stretched, lobe.normals, lobe.uv, lobe.faces))
    for along in np.arange(0.3, length, 0.6):
        lobes.append(leaf_cloud(rng, (along, 0, 0.7 * height_m), 0.36, 60))
    stage.draw("leaves", merged(lobes).moved((*a, 0.0), yaw))
    centre = (*(a + b) / 2, height_m / 2)
    stage.obstacle(name, centre, (length, 0.6, height_m), yaw)


@one_object
def street_tree(
    stage: Stage, name: str, rng: np.random.Generator, foot: Vector, height_m: float, leaves: int
) -> None:
    """Plant a young tree at (3,) metres between three stakes, its crown of single leaves."""
    base, up = np.asarray(foot, dtype=float), np.array((0, 0, height_m))
    crown, reach = base + 0.64 * up, height_m * np.array([0.24, 0.24, 0.32])
    stage.draw("bark", tube(base, base + 0.8 * up, 0.016 * height_m, 7, 0.4))
    for turn in rng.uniform(0, 2 * np.pi, 6):
        way = np.array([np.cos(turn), np.sin(turn), rng.uniform(0.4, 1.2)])
        fork = base + rng.uniform(0.38, 0.6) * up
        stage.draw("bark", tube(fork, fork + 0.2 * height_m * way, 0.006 * height_m, 5, 0.4))
    high = np.array([0, 0, 1.75])
    for turn in 2 * np.pi * (np.arange(3) / 3) + rng.uniform(0, 6):
        out = np.array([np.cos(turn), np.sin(turn), 0.0])
        stage.draw("timber", tube(base + 0.55 * out, base + 0.4 * out + 1.08 * high, 0.04, 6))
        across = np.array([np.cos(turn + 2.1), np.sin(turn + 2.1), 0.0])
        stage.draw("timber", tube(base + 0.41 * out + high, base + 0.41 * across + high, 0.03, 5))
    stage.draw("foliage", leafy(rng, crown, reach, leaves, 0.075))
    stage.obstacle(name, base + 0.57 * high, (1.0, 1.0, 2.0), shadow=False)
    stage.occluder(base + 0.25 * up, np.array([0.03, 0.03, 0.5]) * height_m)
    for _ in range(5):
        at = crown + rng.uniform(-0.55, 0.55, 3) * reach
        stage.occluder(at, reach * rng.uniform(0.5, 1.0, 3), rng.uniform(0, 1.5), 0.62)


def leafy(
    rng: np.random.Generator, centre: Vector, reach: Vector, count: int, leaf_m: float
) -> Mesh:
    """Fill an ellipsoid of (3,) half sizes with leaves that face outwards, each lit on its own.

    They crowd in clusters, so that the sky shows between them.
    """
    heart = rng.standard_normal((max(6, count // 22), 3))
    heart *= rng.uniform(0.3, 1, (len(heart), 1)) / np.linalg.norm(heart, axis=1, keepdims=True)
    at = heart[rng.integers(len(heart), size=count)] + rng.normal(0, 0.13, (count, 3))
    normal = _unit(_unit(at) + 0.6 * rng.standard_normal((count, 3)))
    along = _unit(np.cross(normal, rng.standard_normal((count, 3))))
    across = np.cross(normal, along)
    size = leaf_m * rng.uniform(0.6, 1.4, (count, 1))
    root = np.asarray(centre) + at * np.asarray(reach)
    rim = (1.3 * along, 0.8 * across - along, -0.8 * across - along)
    corners = np.stack([root + size * way for way in rim], axis=1)
    uv = rng.random((count, 1, 2)) + np.array([(0, 0), (0.06, -0.03), (0.06, 0.03)])
    lit = _unit(normal + 0.9 * rng.standard_normal((count, 3)))  # leaves catch the sun one by one
    return polygons(corners, uv, np.repeat(lit[:, None], 3, axis=1))


def _unit(vectors: Array) -> Array:
    """Scale (N, 3) vectors to length one."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
