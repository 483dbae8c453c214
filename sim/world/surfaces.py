"""Surfaces of what is drawn, as triangles."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import mujoco
import numpy as np

from scenes.scene import LABEL_GROUP, Kind, Thing
from sim.world.enclosure import opacity
from sim.world.world import World, thing_of
from vo.contract.arrays import Array, Indices

SEGMENTS = 24
"""Number of straight edges that a circle is drawn with."""
ENDLESS_M = 50.0
"""Half side of a plane without an end."""
DRAWN_GROUPS = (0, 1, 2, LABEL_GROUP)
"""Groups of the geoms that labels show: one surface for each object."""

Mesh = tuple[Array, Indices]
"""Vertices (V, 3) in metres, and triangles (F, 3), counter-clockwise from outside."""


@dataclass(frozen=True)
class Surface:
    """Surface of a drawn geom: vertices (V, 3) in its body's frame, metres, and triangles (F, 3).

    A plane is as large as it is drawn, or `is_endless`.
    """

    thing: Thing
    body: int
    vertices: Array
    triangles: Indices
    is_endless: bool


def drawn_surfaces(world: World) -> Iterator[Surface]:
    """Yield the surface of each geom that labels show."""
    model = world.model
    shown = np.isin(model.geom_group, DRAWN_GROUPS)
    shown &= opacity(model, model.geom_matid, model.geom_rgba) > 0
    for geom in np.flatnonzero(shown).tolist():
        local, triangles = _mesh(model, geom)
        R = np.zeros(9)
        mujoco.mju_quat2Mat(R, model.geom_quat[geom])
        vertices = local @ R.reshape(3, 3).T + model.geom_pos[geom]
        is_plane = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
        is_endless = bool(is_plane and (model.geom_size[geom, :2] == 0).any())
        body, thing = int(model.geom_bodyid[geom]), thing_of(world, geom)
        yield Surface(thing, body, vertices, triangles, is_endless)


def is_static(world: World, surface: Surface) -> bool:
    """Whether a surface stands still: it is part of the world, and of no moving thing."""
    return surface.thing.kind != Kind.MOVING and world.model.body_weldid[surface.body] == 0


def _mesh(model: mujoco.MjModel, geom: int) -> Mesh:
    """Return a geom's surface in its own frame."""
    kinds, size = mujoco.mjtGeom, model.geom_size[geom]
    kind, data = model.geom_type[geom], int(model.geom_dataid[geom])
    if kind == kinds.mjGEOM_MESH:
        first, count = model.mesh_vertadr[data], model.mesh_vertnum[data]
        face, faces = model.mesh_faceadr[data], model.mesh_facenum[data]
        vertices = model.mesh_vert[first : first + count].astype(float)
        return vertices, model.mesh_face[face : face + faces].astype(np.int64)
    if kind == kinds.mjGEOM_HFIELD:
        return _height_field(model, data)
    if kind == kinds.mjGEOM_PLANE:
        half = np.where(size[:2] > 0, size[:2], ENDLESS_M)
        corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * [*half, 0]
        return corners, np.array([(0, 1, 2), (0, 2, 3)])
    if kind == kinds.mjGEOM_BOX:
        return _box(size)
    if kind == kinds.mjGEOM_CYLINDER:
        rings = [(0, -size[1]), (size[0], -size[1]), (size[0], size[1]), (0, size[1])]
        return _turned(np.array(rings))
    angles = np.linspace(-np.pi / 2, np.pi / 2, SEGMENTS // 2 + 1)
    profile = np.column_stack([np.cos(angles), np.sin(angles)])
    if kind == kinds.mjGEOM_ELLIPSOID:
        vertices, triangles = _turned(profile)
        return vertices * size, triangles
    profile *= size[0]
    if kind == kinds.mjGEOM_CAPSULE:
        middle = len(profile) // 2
        low, high = profile[: middle + 1], profile[middle:]
        profile = np.vstack([low - np.array([0, size[1]]), high + np.array([0, size[1]])])
    return _turned(profile)


def _box(half: Array) -> Mesh:
    corners = np.array(list(product((-1, 1), repeat=3))) * half
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return corners, np.array([x for a, b, c, d in sides for x in ((a, b, c), (a, c, d))])


def _turned(profile: Array) -> Mesh:
    """Turn a profile (P, 2) of radius and height, from the lowest to the highest, around z."""
    angles = 2 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    rings = [np.column_stack([r * circle, np.full(SEGMENTS, z)]) for r, z in profile]
    k = np.arange(SEGMENTS)
    after = (k + 1) % SEGMENTS
    triangles = [
        np.concatenate(
            [
                np.stack([low + k, low + after, up + after], 1),
                np.stack([low + k, up + after, up + k], 1),
            ]
        )
        for low, up in ((i * SEGMENTS, (i + 1) * SEGMENTS) for i in range(len(profile) - 1))
    ]
    return np.vstack(rings), np.concatenate(triangles)


def _height_field(model: mujoco.MjModel, field: int) -> Mesh:
    """Return the upper surface of a height field."""
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    half_x, half_y, top = model.hfield_size[field, :3]
    first = model.hfield_adr[field]
    heights = model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    x, y = np.meshgrid(np.linspace(-half_x, half_x, columns), np.linspace(-half_y, half_y, rows))
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    triangles = [np.stack(x, axis=-1).reshape(-1, 3) for x in ((a, b, c), (a, c, d))]
    return np.stack([x, y, top * heights], axis=-1).reshape(-1, 3), np.concatenate(triangles)
