"""Triangle meshes with texture coordinates."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from vo.contract.arrays import Array, Indices

Vector: TypeAlias = Sequence[float] | Array
"""A few numbers, as a tuple or an array."""


@dataclass(frozen=True)
class Mesh:
    """Triangles, counter-clockwise seen from outside.

    Attributes:
        points: (V, 3) metres.
        normals: (V, 3) unit, for shading.
        uv: (V, 2) texture coordinates, v down the image; outside [0, 1] the texture repeats.
        faces: (F, 3) indices of points.
    """

    points: Array
    normals: Array
    uv: Array
    faces: Indices

    def moved(self, position: Vector, yaw_rad: float = 0.0) -> "Mesh":
        """Turn about z, then shift by (3,) metres."""
        c, s = np.cos(yaw_rad), np.sin(yaw_rad)
        R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        points = self.points @ R.T + np.asarray(position)
        return replace(self, points=points, normals=self.normals @ R.T)

    def textured(self, rect: Array) -> "Mesh":
        """Squeeze uv in [0, 1] into an atlas cell, (4,) u0, v0, u1, v1."""
        return replace(self, uv=rect[:2] + self.uv * (rect[2:] - rect[:2]))


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """Join one or more meshes into one."""
    offsets = np.cumsum([0, *(len(mesh.points) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.points for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.uv for mesh in meshes]),
        np.concatenate([m.faces + o for m, o in zip(meshes, offsets, strict=True)]),
    )


def cut_into_cells(mesh: Mesh, max_faces: int) -> list[Mesh]:
    """Halve a mesh along the longer side of its plan until no piece has more than `max_faces`."""
    middles = mesh.points[mesh.faces][:, :, :2].mean(axis=1)
    cells: list[Mesh] = []
    pending = [np.arange(len(mesh.faces))]
    while pending:
        mine = pending.pop()
        if len(mine) > max_faces:
            axis = np.argmax(np.ptp(middles[mine], axis=0))
            order = mine[np.argsort(middles[mine, axis], kind="stable")]
            pending += [order[: len(mine) // 2], order[len(mine) // 2 :]]
            continue
        used, index = np.unique(mesh.faces[mine], return_inverse=True)
        faces = index.reshape(-1, 3)
        cells.append(Mesh(mesh.points[used], mesh.normals[used], mesh.uv[used], faces))
    return cells


def polygons(corners: Array, uv: Array, normals: Array | None = None) -> Mesh:
    """Build N flat convex polygons of (N, K, 3) corners, counter-clockwise seen from outside.

    Each corner has (N, K, 2) texture coordinates and a shading normal, by default the polygon's.
    """
    count, sides, _ = corners.shape
    if normals is None:
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        normals = np.broadcast_to(normal[:, None], corners.shape)
    fan = np.array([[0, k, k + 1] for k in range(1, sides - 1)])
    faces = (np.arange(count)[:, None, None] * sides + fan).reshape(-1, 3)
    return Mesh(corners.reshape(-1, 3), normals.reshape(-1, 3), uv.reshape(-1, 2), faces)


def grid(points: Array, uv: Array, normals: Array) -> Mesh:
    """Join a (R, C, 3) grid of points, with (R, C, 2) uv and (R, C, 3) normals, into quads."""
    corners = [
        np.stack([v[:-1, :-1], v[:-1, 1:], v[1:, 1:], v[1:, :-1]], axis=2)
        for v in (points, uv, normals)
    ]
    return polygons(*(v.reshape(-1, 4, v.shape[-1]) for v in corners))


def sphere(rings: int, columns: int) -> tuple[Array, Array, Array]:
    """Sample polar angle, azimuth and (columns, rings, 3) points of the unit sphere."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rings), np.linspace(0, 2 * np.pi, columns))
    s = np.sin(theta)
    return theta, phi, np.stack([s * np.cos(phi), s * np.sin(phi), np.cos(theta)], axis=-1)


def patch(
    origin: Vector,
    side_u: Vector,
    side_v: Vector,
    cells: tuple[int, int] = (1, 1),
    texture_m: tuple[float, float] | None = None,
    offset: Vector = (0.0, 0.0),
) -> Mesh:
    """Build a parallelogram as a grid of cells; it faces along side_u x side_v.

    From a corner, u grows along one edge and v falls (up the image) along the other, (3,) metres
    each. By default the whole image fits once, or else periods of the texture's size; the offset
    (2,) is added to the texture coordinates.
    """
    corner, edge_u, edge_v = (np.asarray(x, dtype=float)[None] for x in (origin, side_u, side_v))
    return _parallelograms(corner, edge_u, edge_v, (cells,), texture_m, offset)


def _parallelograms(
    corners: Array,
    edges_u: Array,
    edges_v: Array,
    cells: tuple[tuple[int, int], ...],
    texture_m: tuple[float, float] | None,
    offset: Vector,
) -> Mesh:
    """Build N parallelograms as `patch`, each from rows of (N, 3) arrays."""
    a, b, owner, faces = _grids(cells)
    points = corners[owner] + a * edges_u[owner] + b * edges_v[owner]
    uv = np.concatenate([a, 1 - b], axis=1)
    if texture_m is not None:
        lengths = [[_length(x) for x in edges] for edges in (edges_u, edges_v)]
        uv = uv * (np.transpose(lengths) / np.asarray(texture_m))[owner]
    (ux, uy, uz), (vx, vy, vz) = edges_u.T, edges_v.T
    normals = np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=1)
    normals /= np.array([[_length(x)] for x in normals])
    return Mesh(points, normals[owner], uv + np.asarray(offset), faces)


# For single vectors, NumPy's own take ten times as long.


def _length(v: Array) -> float:
    return math.sqrt(v.dot(v))


def _cross(v: Array, w: Array) -> Array:
    (a, b, c), (d, e, f) = v.tolist(), w.tolist()
    return np.array([b * f - c * e, c * d - a * f, a * e - b * d])


@lru_cache(maxsize=256)
def _grids(cells: tuple[tuple[int, int], ...]) -> tuple[Array, Array, Indices, Indices]:
    """Return u and v (V, 1) of the corners of N grids, to which each belongs, and triangles (F, 3).

    The cells of each grid are counted along u and v.
    """
    parts: list[tuple[Array, ...]] = []
    first = 0
    for k, (across, up) in enumerate(cells):
        a, b = np.meshgrid(np.linspace(0, 1, across + 1), np.linspace(0, 1, up + 1), indexing="ij")
        index = first + np.arange(a.size).reshape(a.shape)
        first += a.size
        quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)
        faces = quads[..., [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
        parts.append((a.reshape(-1, 1), b.reshape(-1, 1), np.full(a.size, k), faces))
    a, b, owner, faces = (np.concatenate(x) for x in zip(*parts, strict=True))
    for shared in (a, b, owner, faces):
        shared.flags.writeable = False
    return a, b, owner, faces


SIDES = {
    "corner": ((-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (-1, 1, -1)),
    "u": ((1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (1, 0, 0), (1, 0, 0)),
    "v": ((0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 1, 0), (0, -1, 0)),
}
"""Corner of each side of a box, and its edges: four walls, top and underside."""
CORNERS, EDGES_U, EDGES_V = (np.array(x, dtype=float) for x in SIDES.values())


def box(
    centre: Vector,
    size: Vector,
    texture_m: tuple[float, float] | None = None,
    offset: Vector = (0.0, 0.0),
    cell_m: float = 0.4,
    bottom: bool = False,
) -> Mesh:
    """Build an axis-aligned box of (3,) full size; every face carries the texture upright.

    Period and offset of the texture are as in `patch`. For baked light, faces are divided into
    cells of at most `cell_m`. The underside is drawn only where `bottom` is set.
    """
    extent = np.asarray(size, dtype=float)
    x, y, z = (max(1, math.ceil(abs(float(length)) / cell_m)) for length in extent)
    cells = ((x, z), (y, z), (x, z), (y, z), (x, y), (x, y))
    drawn = 6 if bottom else 5
    corners = np.asarray(centre, dtype=float) + CORNERS[:drawn] * (extent / 2)
    edges_u, edges_v = EDGES_U[:drawn] * extent, EDGES_V[:drawn] * extent
    return _parallelograms(corners, edges_u, edges_v, cells[:drawn], texture_m, offset)


def boxes(lows: Array, highs: Array, texture_m: float = 1.0, offset: Vector = (0.0, 0.0)) -> Mesh:
    """Build N axis-aligned boxes between (N, 3) corners, undersides included.

    Sides are not divided: baked light varies from corner to corner only. The texture has a period
    of `texture_m`, shifted by `offset` (2,).
    """
    extent = (highs - lows)[:, None]
    corner = (lows + highs)[:, None] / 2 + CORNERS * extent / 2
    along, up = EDGES_U * extent, EDGES_V * extent
    wide, high = (np.linalg.norm(side, axis=-1) / texture_m for side in (along, up))
    flat = 0 * wide
    rim = ((flat, flat), (wide, flat), (wide, -high), (flat, -high))
    uv = np.stack([np.stack(place, axis=-1) for place in rim], axis=2) + np.asarray(offset)
    corners = np.stack([corner, corner + along, corner + along + up, corner + up], axis=2)
    return polygons(corners.reshape(-1, 4, 3), uv.reshape(-1, 4, 2))


def tube(start: Vector, end: Vector, radius_m: float, sides: int = 10, taper: float = 1.0) -> Mesh:
    """Build a round bar; u runs once around, v along; `taper` scales the end's radius."""
    a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    axis = (b - a) / np.linalg.norm(b - a)
    helper = np.array([1.0, 0, 0]) if abs(axis[0]) < 0.9 else np.array([0, 1.0, 0])
    e1 = np.cross(axis, helper)
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(axis, e1)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    radial = np.cos(angle)[:, None] * e1 + np.sin(angle)[:, None] * e2
    ring = np.stack([a + radius_m * radial, b + radius_m * taper * radial], axis=1)
    around = angle / (2 * np.pi)
    uv = np.stack([np.column_stack([around, np.full(sides + 1, v)]) for v in (1.0, 0.0)], axis=1)
    corners, corner_uv, normals = (
        np.stack([pair[:-1, 0], pair[1:, 0], pair[1:, 1], pair[:-1, 1]], axis=1)
        for pair in (ring, uv, np.stack([radial, radial], axis=1))
    )
    ends = np.stack([ring[:0:-1, 0], ring[:-1, 1]])
    return merged([polygons(corners, corner_uv, normals), polygons(ends, np.zeros((2, sides, 2)))])
