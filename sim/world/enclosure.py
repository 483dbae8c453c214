"""Enclosure: the solid geom that a point is inside of, where a camera would see its inside."""

import mujoco
import numpy as np

from scenes.scene import COLLISION_GROUP
from sim.world.rover import BODY
from vo.contract.arrays import Array, Indices

NO_COLOUR = np.array([0.5, 0.5, 0.5, 1.0])
"""Colour that stands for that of the material."""
INSIDE_WINDING = 0.9
"""Winding number of a mesh around a point above which the point is inside: 1 of a closed mesh, less
of one with a gap, -1 of a room whose faces look inwards."""
GEOM = mujoco.mjtGeom


def enclosing_geom(model: mujoco.MjModel, data: mujoco.MjData, point: Array) -> str:
    """Return the name of the solid that a world point (3,) is inside of; empty if it is in none.

    Solids are geoms that are drawn, but the rover; a plane that collides is one below as much of it
    as is drawn.
    """
    own = model.body_rootid[model.body(BODY).id]
    drawn = (model.geom_group < COLLISION_GROUP) & (model.body_rootid[model.geom_bodyid] != own)
    drawn &= opacity(model, model.geom_matid, model.geom_rgba) > 0
    away_m, reach_m = np.linalg.norm(data.geom_xpos - point, axis=1), model.geom_rbound
    geoms = np.flatnonzero(drawn & ((away_m <= 2 * reach_m) | (reach_m == 0)))  # 0: a plane
    solid = (model.geom_contype[geoms] | model.geom_conaffinity[geoms]) != 0
    R_world_geom = data.geom_xmat[geoms].reshape(-1, 3, 3)
    local = np.einsum("nij,ni->nj", R_world_geom, point - data.geom_xpos[geoms])
    box, kinds = model.geom_aabb[geoms], model.geom_type[geoms]
    p, size, radius = np.abs(local), model.geom_size[geoms], model.geom_size[geoms, 0]
    across, along = np.hypot(p[:, 0], p[:, 1]), np.maximum(p[:, 2] - size[:, 1], 0)
    in_plane = ((p < size) | (size == 0))[:, :2].all(axis=1)
    near = (np.abs(local - box[:, :3]) <= box[:, 3:]).all(axis=1)
    inside = {
        GEOM.mjGEOM_BOX: (p < size).all(axis=1),
        GEOM.mjGEOM_SPHERE: np.linalg.norm(p, axis=1) < radius,
        GEOM.mjGEOM_CYLINDER: (across < radius) & (along == 0),
        GEOM.mjGEOM_CAPSULE: np.hypot(across, along) < radius,
        GEOM.mjGEOM_ELLIPSOID: np.linalg.norm(p / np.maximum(size, 1e-9), axis=1) < 1,
        GEOM.mjGEOM_PLANE: (local[:, 2] < 0) & in_plane & solid,
        GEOM.mjGEOM_MESH: near,
        GEOM.mjGEOM_HFIELD: near,
    }
    for kind, mask in inside.items():
        for k in np.flatnonzero(mask & (kinds == kind)).tolist():
            geom = int(geoms[k])
            if kind == GEOM.mjGEOM_MESH and _winding(model, geom, local[k]) < INSIDE_WINDING:
                continue
            if kind == GEOM.mjGEOM_HFIELD and not _is_below(model, data, geom, point):
                continue
            return geom_name(model, geom)
    return ""


def geom_name(model: mujoco.MjModel, geom: int) -> str:
    """Return the name of a geom, or its number."""
    return model.geom(geom).name or f"geom {geom}"


def opacity(model: mujoco.MjModel, material: Indices, rgba: Array) -> Array:
    """Return alpha (N,) of what is drawn: its own colour, unless only its material has one."""
    material = material[: len(rgba)]  # MuJoCo's Python gives more values of flexes
    own = (material < 0) | (rgba != NO_COLOUR).any(axis=1)
    return np.where(own, rgba[:, 3], np.append(model.mat_rgba[:, 3], 1.0)[material])


def _winding(model: mujoco.MjModel, geom: int, point: Array) -> float:
    """Return how often a mesh winds around a point (3,) in its axes.

    Source: van Oosterom and Strackee, The solid angle of a plane triangle, 1983, eq. 8.
    """
    mesh = model.geom_dataid[geom]
    first, start = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    faces = model.mesh_face[start : start + model.mesh_facenum[mesh]]
    a, b, c = np.moveaxis(model.mesh_vert[first + faces] - point, 1, 0)
    length_a, length_b, length_c = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    volume = np.einsum("ni,ni->n", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ni,ni->n", x, y) for x, y in ((a, b), (b, c), (c, a)))
    beside = length_a * length_b * length_c + ab * length_c + bc * length_a + ca * length_b
    return float(np.arctan2(volume, beside).sum() / (2 * np.pi))


def _is_below(model: mujoco.MjModel, data: mujoco.MjData, geom: int, point: Array) -> bool:
    """Whether a height field, seen from far above, hides a point (3,) within its bounding box."""
    up, far = data.geom_xmat[geom, 2::3], 2 * model.geom_rbound[geom]
    return 0 <= mujoco.mj_rayHfield(model, data, geom, point + far * up, -up) < far
