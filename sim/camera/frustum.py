"""What MuJoCo's cameras see: their aim, and the geoms in their frustums."""

import mujoco
import numpy as np

from scenes.scene import COLLISION_GROUP
from sim.world.rig import CAMERA, R_GL_CV
from vo.contract.arrays import Array, Mask
from vo.contract.rig import StereoRig


def aim(scene: mujoco.MjvScene, T_world_cam: Array, rig: StereoRig, R: Array) -> None:
    """Turn both cameras of MuJoCo's scene by R (3, 3), with the centred image of a rig each."""
    R_world_view = T_world_cam[:3, :3] @ R
    for side, camera in enumerate(scene.camera):
        camera.pos = T_world_cam[:3, 3] + side * rig.baseline_m * T_world_cam[:3, 0]
        camera.forward, camera.up = R_world_view[:, 2], -R_world_view[:, 1]
        half = camera.frustum_near / rig.f_px / 2
        camera.frustum_center, camera.frustum_width = 0, half * rig.width_px
        camera.frustum_bottom, camera.frustum_top = -half * rig.height_px, half * rig.height_px


def in_frustum(model: mujoco.MjModel, data: mujoco.MjData, rig: StereoRig, R: Array | None) -> Mask:
    """Return which geoms (ngeom,) may appear in either centred image, by their bounding boxes.

    Both cameras may be turned by R (3, 3), each around its centre.
    A plane that is seen from behind is drawn in neither image nor label, as the faces of all other
    geoms: MuJoCo would draw it as if it were of glass.
    """
    camera = model.camera(CAMERA).id
    R_world_gl = data.cam_xmat[camera].reshape(3, 3)
    if R is not None:
        R_world_gl = R_world_gl @ R_GL_CV @ R @ R_GL_CV
    tan_u, tan_v = rig.width_px / 2 / rig.f_px, rig.height_px / 2 / rig.f_px
    inward = np.array(  # normals of the sides, in MuJoCo's camera axes: it faces along -z
        [(1, 0, -tan_u), (-1, 0, -tan_u), (0, 1, -tan_v), (0, -1, -tan_v), (0, 0, -1)]
    )
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    eyes = rig.baseline_m / 2 * np.abs(inward[:, 0])
    away = data.geom_xpos - data.cam_xpos[camera]
    distance = away @ (R_world_gl @ inward.T)
    is_in = (distance > -(model.geom_rbound[:, None] + eyes)).all(axis=1)
    boxed = np.flatnonzero(is_in)
    R_geom_gl = np.einsum("nji,jk->nik", data.geom_xmat[boxed].reshape(-1, 3, 3), R_world_gl)
    sides = R_geom_gl @ inward.T  # (N, 3, 5), in the axes of each geom
    centre, half = np.split(model.geom_aabb[boxed][:, None], 2, axis=2)
    farthest = distance[boxed] + (centre @ sides + half @ np.abs(sides))[:, 0]
    is_in[boxed] = (farthest > -eyes).all(axis=1)
    planes = np.flatnonzero(model.geom_rbound == 0)  # without bounds
    is_in[planes] = np.einsum("ni,ni->n", data.geom_xmat[planes, 2::3], away[planes]) < 0
    return is_in


def nearest_depths_m(model: mujoco.MjModel, data: mujoco.MjData, rig: StereoRig) -> Array:
    """Return a lower bound (nbody,) of the depth of each body in the left centred image.

    It is at least the near plane's, and infinite where no geom of the body can appear. What lies
    beyond the face of a box by d, seen along rays r of depth 1, is no nearer than d / max(r n): n
    is the normal into the box, and the maximum that of the image's corners. Deforming objects and
    sites have no boxes here: where there are any, all bodies begin at the near plane.
    """
    near_m = model.vis.map.znear * model.stat.extent
    camera = model.camera(CAMERA).id
    is_drawn = model.geom_group < COLLISION_GROUP
    shown = np.flatnonzero(is_drawn & in_frustum(model, data, rig, None))
    R_world_gl = data.cam_xmat[camera].reshape(3, 3)
    eye = data.cam_xpos[camera] - rig.baseline_m / 2 * R_world_gl[:, 0]
    u, v = rig.width_px / 2 / rig.f_px, rig.height_px / 2 / rig.f_px
    corners = np.array([(u, v, -1), (u, -v, -1), (-u, v, -1), (-u, -v, -1)]) @ R_world_gl.T
    R_geom_world = data.geom_xmat[shown].reshape(-1, 3, 3).transpose(0, 2, 1)
    centre, half = np.split(model.geom_aabb[shown], 2, axis=1)
    from_centre = np.einsum("nij,nj->ni", R_geom_world, eye - data.geom_xpos[shown]) - centre
    beyond_m = np.abs(from_centre) - half  # (N, 3), in the axes of each geom
    rays = -np.sign(from_centre)[:, None] * (corners @ R_geom_world.transpose(0, 2, 1))
    with np.errstate(divide="ignore"):
        faces_m = np.where(beyond_m > 0, beyond_m / np.maximum(rays.max(axis=1), 0), 0)
    nearest_m = np.full(model.nbody, np.inf)
    depths_m = np.maximum(faces_m.max(axis=1), near_m)
    np.minimum.at(nearest_m, model.geom_bodyid[shown], depths_m)
    if model.nsite or model.nflex or model.ntendon or model.nskin:
        nearest_m[:] = near_m
    return nearest_m
