"""Frustum culling: geoms against the view frustums of a stereo pair."""

import mujoco
import numpy as np

from sim.world.rig import CAMERA
from vo.contract.arrays import Mask
from vo.contract.rig import StereoRig


def in_frustum(model: mujoco.MjModel, data: mujoco.MjData, rig: StereoRig) -> Mask:
    """Return which geoms (ngeom,) may appear in either centred image, by their bounding spheres."""
    camera = model.camera(CAMERA).id
    R_world_gl = data.cam_xmat[camera].reshape(3, 3)
    tan_u, tan_v = rig.width_px / 2 / rig.f_px, rig.height_px / 2 / rig.f_px
    inward = np.array(  # normals of the sides, in MuJoCo's camera axes: it faces along -z
        [(1, 0, -tan_u), (-1, 0, -tan_u), (0, 1, -tan_v), (0, -1, -tan_v), (0, 0, -1)]
    )
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    distance = (data.geom_xpos - data.cam_xpos[camera]) @ (R_world_gl @ inward.T)
    radius = model.geom_rbound + rig.baseline_m / 2
    unbounded = model.geom_rbound == 0  # planes
    return unbounded | (distance > -radius[:, None]).all(axis=1)
