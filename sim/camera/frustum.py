"""What MuJoCo's cameras see: their aim, and the geoms in their frustums."""

import mujoco
import numpy as np

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
    """Return which geoms (ngeom,) may appear in either centred image, by their bounding spheres.

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
    away = data.geom_xpos - data.cam_xpos[camera]
    distance = away @ (R_world_gl @ inward.T)
    radius = model.geom_rbound + rig.baseline_m / 2
    unbounded = model.geom_rbound == 0  # planes
    is_faced = np.einsum("ni,ni->n", data.geom_xmat[:, 2::3], away) < 0
    return np.where(unbounded, is_faced, (distance > -radius[:, None]).all(axis=1))
