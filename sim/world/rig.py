"""The stereo rig: MuJoCo camera, calibration, and conversion of camera axes.

MuJoCo, like OpenGL, has the camera face along -z with y up; everything else in this project uses
OpenCV's axes: x right, y down, z forward. R_GL_CV is the only conversion.
"""

import math
from dataclasses import replace

import mujoco
import numpy as np

from sim.settings import RigSettings
from sim.world.rover import CAMERA_X_M, MAST, PREFIX, WHEEL_RADIUS_M
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

CAMERA = PREFIX + "stereo"
R_GL_CV: Array = np.diag([1.0, -1.0, -1.0])


def stereo_rig(settings: RigSettings) -> StereoRig:
    """Return the calibration that follows from the settings; `T_body_cam` is the left camera's.

    f = (W/2) / tan(hfov/2) = (H/2) / tan(fovy/2); c = ((W-1)/2, (H-1)/2), centres on integers.
    """
    T_gl_left = se3.pose(R_GL_CV, np.array([-settings.baseline_m / 2, 0.0, 0.0]))
    width, height = settings.width_px, settings.height_px
    f_px = width / 2 / math.tan(math.radians(settings.hfov_deg) / 2)
    centre_px = (width - 1) / 2, (height - 1) / 2
    T_body_left = T_body_gl(settings) @ T_gl_left
    return StereoRig(width, height, f_px, *centre_px, settings.baseline_m, T_body_left)


def widened(rig: StereoRig, margin_px: int) -> StereoRig:
    """Return the same pair with `margin_px` more pixels on every side."""
    return replace(
        rig,
        width_px=rig.width_px + 2 * margin_px,
        height_px=rig.height_px + 2 * margin_px,
        cx_px=rig.cx_px + margin_px,
        cy_px=rig.cy_px + margin_px,
    )


def add_rig(carrier: mujoco.MjSpec, settings: RigSettings, rig: StereoRig) -> None:
    """Mount a centred pair on the carrier's mast: one MuJoCo camera, whose `ipd` is the baseline.

    The camera is halfway between the two; MuJoCo puts the left one at -ipd/2 along its x.
    """
    T_body_camera = T_body_gl(settings)
    carrier.body(MAST).add_camera(
        name=CAMERA.removeprefix(PREFIX),
        pos=T_body_camera[:3, 3],
        quat=se3.to_quat_wxyz(T_body_camera),
        fovy=math.degrees(2 * math.atan(rig.height_px / 2 / rig.f_px)),
        ipd=rig.baseline_m,
    )


def T_world_left(camera_pos: Array, camera_mat: Array, rig: StereoRig) -> Array:
    """Convert MuJoCo's camera pose, (3,) and (9,), to the left camera's (4, 4) in OpenCV axes."""
    R_world_cv = camera_mat.reshape(3, 3) @ R_GL_CV
    return se3.pose(R_world_cv, camera_pos - rig.baseline_m / 2 * R_world_cv[:, 0])


def T_body_gl(settings: RigSettings) -> Array:
    """(4, 4) pose of an OpenGL camera midway between the two, tilted down from straight ahead."""
    tilt = math.radians(settings.tilt_deg)
    right = np.array([0.0, -1.0, 0.0])
    forward = np.array([math.cos(tilt), 0.0, -math.sin(tilt)])
    R_body_gl = np.stack([right, np.cross(right, forward), -forward], axis=1)
    return se3.pose(R_body_gl, np.array([CAMERA_X_M, 0.0, settings.height_m - WHEEL_RADIUS_M]))
