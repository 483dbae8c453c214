"""Triangles of MuJoCo's geoms, as images show them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import mujoco
import numpy as np

from scenes.scene import IMAGE_GROUP
from sim.world.enclosure import NO_COLOUR, opacity
from vo.contract import se3
from vo.contract.arrays import Array, Image, Indices

SHAPE = mujoco.mjtGeom
MAX_TEXTURE_PX = 256
"""Longest side of a texture; larger ones are reduced."""
SEGMENTS = 16
"""Number of sides of round shapes."""
TO_LIGHT = np.array([0.3, -0.5, 0.81])
"""Direction of the light of geoms whose textures hold none."""
AMBIENT = 0.55
"""Brightness of a face that is turned away from the light."""
ENDLESS_M = 30.0
"""Half side of a plane without an end."""


@dataclass(frozen=True)
class Mesh:
    """Triangles of one texture, or of none.

    Attributes:
        corners: (F, 3, 3) corners of F triangles, metres.
        colours: (F, 3) uint8 RGB of each triangle, by which the texture is multiplied.
        texcoords: (F, 3, 2) place of each corner in the texture, (0, 0) in its first row and
            column; None without texture.
        texture: (H, W, 3) uint8 RGB.
    """

    corners: Array
    colours: Image
    texcoords: Array | None = None
    texture: Image | None = None


def drawn_geoms(model: mujoco.MjModel) -> Indices:
    """Return the geoms (K,) that images show."""
    alpha = opacity(model, model.geom_matid, model.geom_rgba)
    is_shown = (model.geom_group < 3) | (model.geom_group == IMAGE_GROUP)
    return np.flatnonzero(is_shown & (alpha > 0))


def geom_meshes(
    model: mujoco.MjModel, data: mujoco.MjData, geoms: Indices, T_frame_world: Array
) -> list[Mesh]:
    """Return the triangles of some geoms (K,) in a frame at (4, 4), a mesh for each texture."""
    by_texture: dict[int, list[Mesh]] = {}
    for geom in geoms.tolist():
        R, t = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
        mesh, texture = _geom_mesh(model, geom, T_frame_world @ se3.pose(R, t))
        if len(mesh.corners):
            by_texture.setdefault(texture, []).append(mesh)
    return [_joined(of, _texture(model, x)) for x, of in by_texture.items()]


def _geom_mesh(model: mujoco.MjModel, geom: int, T_frame_geom: Array) -> tuple[Mesh, int]:
    """Return the triangles of one geom and its texture; -1 for one of a single colour."""
    kind, size = model.geom_type[geom], model.geom_size[geom]
    material = int(model.geom_matid[geom])
    texture = _texture_of(model, material)
    rgba, texcoords = model.geom_rgba[geom], None
    if material >= 0 and np.array_equal(rgba, NO_COLOUR):
        rgba = model.mat_rgba[material]
    if kind == SHAPE.mjGEOM_MESH:
        corners, texcoords = _mesh_corners(model, int(model.geom_dataid[geom]))
    elif kind == SHAPE.mjGEOM_HFIELD:
        corners = _height_field(model, int(model.geom_dataid[geom]))
    else:
        corners = _primitive(kind, size)
    if texture >= 0 and texcoords is None:
        rgba, texture = rgba[:3] * _texture(model, texture).mean(axis=(0, 1)) / 255, -1
    corners = corners @ T_frame_geom[:3, :3].T + T_frame_geom[:3, 3]
    is_lit = model.geom_group[geom] == IMAGE_GROUP and texture >= 0
    shade = np.ones(len(corners)) if is_lit else _shade(corners)
    colours = np.clip(255 * shade[:, None] * rgba[:3], 0, 255).astype(np.uint8)
    return Mesh(corners, colours, texcoords if texture >= 0 else None), texture


def _texture_of(model: mujoco.MjModel, material: int) -> int:
    if material < 0:
        return -1
    return max(
        int(model.mat_texid[material, role])
        for role in (mujoco.mjtTextureRole.mjTEXROLE_RGB, mujoco.mjtTextureRole.mjTEXROLE_RGBA)
    )


def _texture(model: mujoco.MjModel, texture: int) -> Image:
    """Return a texture (H, W, 3) RGB, reduced to the largest size; (1, 1, 3) white for none."""
    if texture < 0:
        return np.full((1, 1, 3), 255, np.uint8)
    height, width = model.tex_height[texture], model.tex_width[texture]
    channels, first = model.tex_nchannel[texture], model.tex_adr[texture]
    pixels = model.tex_data[first : first + height * width * channels]
    image = np.asarray(pixels, np.uint8).reshape(height, width, channels)[..., :3]
    if channels < 3:
        image = np.repeat(image[..., :1], 3, axis=2)
    scale = MAX_TEXTURE_PX / max(height, width)
    if scale >= 1:
        return np.ascontiguousarray(image)
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _joined(meshes: Sequence[Mesh], texture: Image) -> Mesh:
    corners = np.concatenate([x.corners for x in meshes])
    colours = np.concatenate([x.colours for x in meshes])
    places = [x.texcoords for x in meshes if x.texcoords is not None]
    if not places:
        return Mesh(corners, colours)
    return Mesh(corners, colours, np.concatenate(places), texture)


def _shade(corners: Array) -> Array:
    """Return the brightness (F,) of triangles under one distant light (Lambert)."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    cosine = normals @ TO_LIGHT / np.where(lengths > 0, lengths, 1.0)
    return AMBIENT + (1 - AMBIENT) * cosine.clip(0)


def _mesh_corners(model: mujoco.MjModel, mesh: int) -> tuple[Array, Array | None]:
    """Return corners (F, 3, 3) and texture coordinates (F, 3, 2), if it has them."""
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    corners = model.mesh_vert[model.mesh_vertadr[mesh] + model.mesh_face[faces]].astype(float)
    first = model.mesh_texcoordadr[mesh]
    if first < 0:
        return corners, None
    return corners, model.mesh_texcoord[first + model.mesh_facetexcoord[faces]].astype(float)


def _height_field(model: mujoco.MjModel, field: int) -> Array:
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    first, (x_m, y_m, top_m, _) = model.hfield_adr[field], model.hfield_size[field]
    heights = model.hfield_data[first : first + rows * columns].reshape(rows, columns) * top_m
    x, y = np.meshgrid(np.linspace(-x_m, x_m, columns), np.linspace(-y_m, y_m, rows))
    return _grid_triangles(np.stack([x, y, heights], axis=-1))


def _primitive(kind: int, size: Array) -> Array:
    """Return the triangles (F, 3, 3) of a plane, box or round shape; none of another kind."""
    half = np.linspace(0, np.pi / 2, SEGMENTS // 4 + 1)
    dome = np.stack([np.sin(half), np.cos(half)], axis=-1)
    bowl = dome[::-1] * (1, -1)
    if kind == SHAPE.mjGEOM_PLANE:
        x, y = np.where(size[:2] > 0, size[:2], ENDLESS_M)
        return _grid_triangles(np.array([[(-x, -y, 0), (x, -y, 0)], [(-x, y, 0), (x, y, 0)]]))
    if kind == SHAPE.mjGEOM_BOX:
        return _box() * size
    if kind == SHAPE.mjGEOM_SPHERE:
        return _revolved(np.concatenate([dome, bowl[1:]])) * size[0]
    if kind == SHAPE.mjGEOM_ELLIPSOID:
        return _revolved(np.concatenate([dome, bowl[1:]])) * size
    if kind == SHAPE.mjGEOM_CYLINDER:
        return _revolved(np.array([(0, 1), (1, 1), (1, -1), (0, -1)])) * size[[0, 0, 1]]
    if kind == SHAPE.mjGEOM_CAPSULE:
        ends = np.concatenate([dome * size[0] + (0, size[1]), bowl * size[0] - (0, size[1])])
        return _revolved(ends)
    return np.zeros((0, 3, 3))


def _box() -> Array:
    faces = list(_box_faces())
    return np.concatenate([_grid_triangles(x) for x in faces])


def _box_faces() -> Iterator[Array]:
    """Yield the faces (2, 2, 3) of a cube from -1 to 1, seen from outside as grids."""
    for axis in range(3):
        a, b = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        for sign in (1, -1):
            n, u = sign * np.eye(3)[axis], sign * a
            yield np.array([[n - u - b, n + u - b], [n - u + b, n + u + b]])


def _revolved(profile: Array) -> Array:
    """Return the surface of a profile (N, 2) of radius and z, from the top, turned around z."""
    angles = np.linspace(0, 2 * np.pi, SEGMENTS + 1)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    xy = profile[::-1, None, :1] * circle
    z = np.broadcast_to(profile[::-1, None, 1:], (*xy.shape[:2], 1))
    return _grid_triangles(np.concatenate([xy, z], axis=-1))


def _grid_triangles(grid: Array) -> Array:
    """Return triangles (F, 3, 3) of a grid of points (H, W, 3), anticlockwise in its plane."""
    a, b = grid[:-1, :-1].reshape(-1, 3), grid[:-1, 1:].reshape(-1, 3)
    c, d = grid[1:, 1:].reshape(-1, 3), grid[1:, :-1].reshape(-1, 3)
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
