"""Outdoor furniture: planters, benches, lamp posts, shrubs and litter."""

import numpy as np

from scenes.geometry.mesh import Mesh, Vector, box, grid, merged, patch, polygons, sphere, tube
from scenes.pen import Pen, one_object, piece
from scenes.stage import Stage
from scenes.surfaces.atlas import Atlas
from vo.contract.arrays import Array


@one_object
def planter(stage: Stage, name: str, rng: np.random.Generator, centre: Array, size: Vector) -> None:
    """Put a concrete trough of (3,) full size at (2,) centre, filled with soil and shrubs."""
    length, width, height = size
    x, y = centre
    wall = 0.07
    for dx, dy, sx, sy in (
        (0, (width - wall) / 2, length, wall),
        (0, -(width - wall) / 2, length, wall),
        ((length - wall) / 2, 0, wall, width - 2 * wall),
        (-(length - wall) / 2, 0, wall, width - 2 * wall),
    ):
        side = box((x + dx, y + dy, height / 2), (sx, sy, height), (1.2, 1.2), rng.random(2), 0.15)
        stage.draw("concrete", side)
    inner = (length - 1.9 * wall, width - 1.9 * wall, 0.01)
    stage.draw("soil", box((x, y, height - 0.06), inner, (0.8, 0.8), rng.random(2)))
    stage.obstacle(name, (x, y, height / 2), size)
    count = max(2, int(length * width * 4))
    for _ in range(count):
        at = centre + rng.uniform(-0.5, 0.5, 2) * np.array([length - 0.5, width - 0.45])
        radius = rng.uniform(0.18, 0.30)
        shrub(stage, rng, (at[0], at[1], height + 0.45 * radius), radius)


def shrub(stage: Stage, rng: np.random.Generator, centre: Vector, radius_m: float) -> None:
    """Grow a bush: a few balls of foliage and loose leaves around them."""
    core = np.asarray(centre)
    stage.draw("leaves", ball(rng, core - (0, 0, 0.3 * radius_m), 0.7 * radius_m))  # rooted
    for _ in range(2):
        lobe = core + radius_m * rng.uniform((-0.5, -0.5, -0.3), (0.5, 0.5, 0.4))
        stage.draw("leaves", ball(rng, lobe, radius_m * rng.uniform(0.5, 0.7)))
    stage.draw("leaves", leaf_cloud(rng, centre, radius_m, int(700 * radius_m)))
    stage.occluder(centre, np.full(3, 1.5 * radius_m).tolist(), rng.uniform(0, 1.5), 0.8)


@one_object
def bush(stage: Stage, name: str, rng: np.random.Generator, foot: Array, radius_m: float) -> None:
    """Grow a shrub on (3,) ground, with its obstacle."""
    centre = foot + np.array((0, 0, 0.7 * radius_m))
    shrub(stage, rng, centre, radius_m)
    stage.obstacle(name, centre, np.array([1.3, 1.3, 1.4]) * radius_m, shadow=False)


@one_object
def potted_plant(stage: Stage, name: str, rng: np.random.Generator, centre: Vector) -> None:
    """Put a pot with a leafy plant, about 1 m high, at (2,) metres."""
    x, y = centre
    stage.draw("pot", tube((x, y, 0.0), (x, y, 0.34), 0.14, 16, 1.3))
    stage.draw("soil", patch((x - 0.12, y - 0.12, 0.345), (0.24, 0, 0), (0, 0.24, 0)))
    for _ in range(5):
        lean = rng.normal(0, 0.12, 2)
        stage.draw("pot", tube((x, y, 0.3), (x + lean[0], y + lean[1], 0.75), 0.012, 6, 0.6))
        crown = (x + 1.2 * lean[0], y + 1.2 * lean[1], rng.uniform(0.6, 0.95))
        stage.draw("leaves", leaf_cloud(rng, crown, 0.22, 110))
    stage.draw("leaves", ball(rng, (x, y, 0.78), 0.13))
    stage.obstacle(name, (x, y, 0.5), (0.34, 0.34, 1.0), shadow=False)
    stage.occluder((x, y, 0.17), (0.3, 0.3, 0.34))
    stage.occluder((x, y, 0.78), (0.4, 0.4, 0.4), 0.5, 0.6)


def ball(rng: np.random.Generator, centre: Vector, radius_m: float, period_m: float = 0.35) -> Mesh:
    """Build a lumpy sphere; its texture repeats every `period_m`."""
    theta, phi, unit = sphere(6, 10)
    swell = 1 + 0.13 * np.sin(5 * unit + rng.uniform(0, 6.28, 3)).sum(axis=-1)
    points = np.asarray(centre) + radius_m * swell[..., None] * unit
    uv = np.stack([phi, theta], axis=-1) * radius_m / period_m + rng.random(2)
    return grid(points, uv, unit)


def leaf_cloud(rng: np.random.Generator, centre: Vector, radius_m: float, count: int) -> Mesh:
    """Scatter small pointed leaves over a sphere, facing outward more or less."""
    out = rng.standard_normal((count, 3))
    out[:, 2] = np.abs(out[:, 2]) - 0.3
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    along = np.cross(out, rng.standard_normal((count, 3)))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    facing = out + 0.5 * rng.standard_normal((count, 3))
    across = np.cross(facing, along)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    root = np.asarray(centre) + radius_m * rng.uniform(0.7, 1.08, (count, 1)) * out
    length = rng.uniform(0.025, 0.05, (count, 1))
    corners = np.stack(
        [root - 0.5 * across * length, root + length * 1.8 * along, root + 0.5 * across * length],
        axis=1,
    )
    uv = rng.random((count, 1, 2)) + np.array([[0, 0.08], [0.2, 0], [0, -0.08]])
    normals = np.repeat(out[:, None], 3, axis=1)
    inward = (np.cross(along, across) * out).sum(axis=1) < 0
    corners[inward] = corners[inward][:, ::-1]
    return polygons(corners, uv, normals)


def grass_tufts(rng: np.random.Generator, places: Array, blades: int = 9) -> Mesh:
    """Grow blades of grass, 5 to 12 cm, at (N, 2) x, y metres on z = 0."""
    at = np.repeat(places, blades, axis=0) + rng.normal(0, 0.018, (len(places) * blades, 2))
    count = len(at)
    lean = rng.normal(0, 0.025, (count, 2))
    side = rng.standard_normal((count, 2))
    side *= 0.003 / np.linalg.norm(side, axis=1, keepdims=True)
    height = rng.uniform(0.03, 0.10, count)
    foot = np.zeros(count)
    blade = ((at - side, foot), (at + side, foot), (at + lean, height))
    corners = np.stack([np.column_stack([xy, z]) for xy, z in blade], axis=1)
    uv = rng.random((count, 1, 2)) + np.array([[0, 0], [0.01, 0], [0, 0.06]])
    tilt = np.column_stack([rng.normal(0, 0.5, (count, 2)), np.ones(count)])
    tilt /= np.linalg.norm(tilt, axis=1, keepdims=True)  # blades catch the sun one by one
    return polygons(corners, uv, np.broadcast_to(tilt[:, None], corners.shape))


def litter(rng: np.random.Generator, places: Array, atlas: Atlas) -> Mesh:
    """Drop dry leaves at (N, 3) metres: folded along the midrib, edges curled up."""
    count = len(places)
    yaw = rng.uniform(0, 2 * np.pi, count)
    length, width = rng.uniform(0.02, 0.04, (2, count)) * np.array([[1.0], [0.55]])
    share = np.array([-1, -0.5, 0.2, 1.0])
    spread = np.array([0.0, 1.0, 0.85, 0.0])
    curl = rng.uniform(0.15, 0.6, count)
    e1 = np.stack([np.cos(yaw), np.sin(yaw), np.zeros(count)], axis=1)
    e2 = np.stack([-np.sin(yaw), np.cos(yaw), np.zeros(count)], axis=1)
    spine = places[:, None] + length[:, None, None] * share[:, None] * e1[:, None]
    lift = (curl * width)[:, None, None] * spread[:, None] * np.array([0, 0, 1.0])
    reach = width[:, None, None] * spread[:, None] * e2[:, None]
    left, right = spine + reach + lift, spine - reach + lift
    cell = atlas.pick(rng, count)
    plain = np.stack([share / 2 + 0.5, np.full(4, 0.5)], axis=1)
    halves: list[Mesh] = []
    for rim, sign in ((left, 0.5), (right, -0.5)):
        corners = np.stack([spine[:, 0], rim[:, 1], rim[:, 2], spine[:, 3]], axis=1)
        uv = plain + np.column_stack([np.zeros(4), sign * spread])
        uv = cell[:, None, :2] + uv * (cell[:, 2:] - cell[:, :2])[:, None]
        up = np.broadcast_to(np.array([0, 0, 1.0]), corners.shape)
        if sign > 0:
            corners, uv = corners[:, ::-1], uv[:, ::-1]
        halves.append(polygons(corners, uv, up))
    return merged(halves)


@piece
def bench(put: Pen, rng: np.random.Generator) -> None:
    """Put a slatted bench, 1.6 m long; its back is towards +y before the turn."""
    for y in (-0.18, -0.06, 0.06, 0.18):
        seat = box((0, y, 0.44), (1.6, 0.095, 0.035), (1.0, 0.25), rng.random(2), bottom=True)
        put("timber", seat)
    for z in (0.6, 0.74):
        put("timber", box((0, 0.26, z), (1.6, 0.035, 0.1), (1.0, 0.25), rng.random(2), bottom=True))
    for x in (-0.6, 0.6):
        put("iron", box((x, -0.16, 0.21), (0.05, 0.05, 0.42), (0.5, 0.5), rng.random(2)))
        put("iron", box((x, 0.22, 0.4), (0.05, 0.05, 0.8), (0.5, 0.5), rng.random(2)))
        arm = box((x, 0.03, 0.395), (0.045, 0.42, 0.05), (0.5, 0.5), rng.random(2), bottom=True)
        put("iron", arm)
    put.solid((1.6, 0.55, 0.8), shadow=False)
    put.shade(0.44, (1.6, 0.46, 0.04), 0.85)
    put.shade(0.67, (1.6, 0.04, 0.25), 0.85, (0.0, 0.26))


@one_object
def lamp_post(stage: Stage, name: str, centre: Array) -> None:
    """Put an iron lamp post, 3.4 m high, at (2,) metres."""
    x, y = centre
    stage.draw("iron", tube((x, y, 0.0), (x, y, 0.5), 0.075, 14, 0.75))
    stage.draw("iron", tube((x, y, 0.5), (x, y, 3.2), 0.05, 12, 0.7))
    stage.draw("iron", tube((x, y, 3.2), (x, y, 3.4), 0.12, 12, 0.4))
    stage.draw("iron", box((x, y, 0.02), (0.26, 0.26, 0.04), (0.5, 0.5)))
    stage.obstacle(name, (x, y, 1.7), (0.12, 0.12, 3.4))
