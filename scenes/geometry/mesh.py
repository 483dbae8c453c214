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
    a, b, faces = _grid(*cells)
    edge_u, edge_v = np.asarray(side_u, dtype=float), np.asarray(side_v, dtype=float)
    points = np.asarray(origin) + a[..., None] * edge_u + b[..., None] * edge_v
    periods = np.ones(2)
    if texture_m is not None:
        periods = np.array([_length(edge_u), _length(edge_v)]) / np.asarray(texture_m)
    uv = np.stack([a, 1 - b], axis=-1) * periods + np.asarray(offset)
    normal = _cross(edge_u, edge_v)
    normal /= _length(normal)
    return Mesh(points.reshape(-1, 3), np.tile(normal, (a.size, 1)), uv.reshape(-1, 2), faces)


# For single vectors, NumPy's own take ten times as long.


def _length(v: Array) -> float:
    return math.sqrt(v.dot(v))


def _cross(v: Array, w: Array) -> Array:
    (a, b, c), (d, e, f) = v.tolist(), w.tolist()
    return np.array([b * f - c * e, c * d - a * f, a * e - b * d])


@lru_cache(maxsize=256)
def _grid(across: int, up: int) -> tuple[Array, Array, Indices]:
    """Return u and v (across + 1, up + 1) of a grid's corners, and its triangles (N, 3)."""
    a, b = np.meshgrid(np.linspace(0, 1, across + 1), np.linspace(0, 1, up + 1), indexing="ij")
    index = np.arange(a.size).reshape(a.shape)
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1)
    faces = quads[..., [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    for shared in (a, b, faces):
        shared.flags.writeable = False
    return a, b, faces


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
    x, y, z = np.asarray(size, dtype=float)
    c = np.asarray(centre, dtype=float)
    h = np.array([x, y, z]) / 2
    sides = [
        (c + np.array([-h[0], -h[1], -h[2]]), (x, 0, 0), (0, 0, z)),
        (c + np.array([h[0], -h[1], -h[2]]), (0, y, 0), (0, 0, z)),
        (c + np.array([h[0], h[1], -h[2]]), (-x, 0, 0), (0, 0, z)),
        (c + np.array([-h[0], h[1], -h[2]]), (0, -y, 0), (0, 0, z)),
        (c + np.array([-h[0], -h[1], h[2]]), (x, 0, 0), (0, y, 0)),
    ]
    if bottom:
        sides.append((c + np.array([-h[0], h[1], -h[2]]), (x, 0, 0), (0, -y, 0)))
    faces: list[Mesh] = []
    for corner, u, v in sides:
        across, up = (max(1, int(np.ceil(np.linalg.norm(side) / cell_m))) for side in (u, v))
        faces.append(patch(corner, u, v, (across, up), texture_m, offset))
    return merged(faces)


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
