"""The start of a rover: ground that carries it, and free space around it."""

import math
from copy import copy

import mujoco
import numpy as np

from scenes.scene import Scene
from sim.world.drive import TIPPED_RAD
from sim.world.enclosure import enclosing_geom, geom_name
from sim.world.rover import BODY, PREFIX, WHEEL_BODIES, WHEEL_RADIUS_M
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError

START_CLEARANCE_M = 0.01
"""Height above level ground from which the rover drops, so that no brick is inside a wheel."""
DROP_MAX_M = 0.05
"""Greatest distance of the ground below the height that the scene states for it."""
ABOVE_M = 100.0
"""Height above the stated ground from which the ground is sought."""
LEVEL_RAD = math.radians(1)
"""Tilt up to which the height of a plane alone tells where it is."""
SETTLING_CONTACT_M = 0.004
"""Penetration of an obstacle from which a start has no free space."""
FLAGS = {
    "gravity": mujoco.mjtDisableBit.mjDSBL_GRAVITY,
    "contact": mujoco.mjtDisableBit.mjDSBL_CONTACT,
    "constraint": mujoco.mjtDisableBit.mjDSBL_CONSTRAINT,
    "actuation": mujoco.mjtDisableBit.mjDSBL_ACTUATION,
}
"""Flags of MJCF's option that a rover cannot drive without."""


def check_start(scene: Scene, model: mujoco.MjModel, data: mujoco.MjData, start: Array) -> None:
    """Check that the rover, in `data` above its start (2,) metres, can stand and drive there.

    Raises:
        SettingsError: If it has no weight, no ground or no free space; says why and where.
    """
    for flag, bit in FLAGS.items():
        if model.opt.disableflags & bit:
            raise SettingsError(f"scene {scene.name}: option flag {flag} is off; a rover needs it")
    if model.opt.disableactuator & 1:
        raise SettingsError(
            f"scene {scene.name}: actuatorgroupdisable turns off group 0, the wheels of the rover"
        )
    gravity = model.opt.gravity
    if not -gravity[2] > math.cos(TIPPED_RAD) * np.linalg.norm(gravity):
        raise SettingsError(
            f"scene {scene.name}: gravity is ({gravity[0]:g}, {gravity[1]:g}, {gravity[2]:g}) "
            "m/s^2; a rover needs one downwards, such as 0 0 -9.81, or drive.carrier=handheld"
        )
    where = f"at the start ({start[0]:g}, {start[1]:g}) m"
    _check_ground(scene, model, data, start, where)
    _check_space(scene, model, data, start, where)


def check_view(scene: Scene, model: mujoco.MjModel, data: mujoco.MjData, eye: Array) -> None:
    """Check that a camera at a world point (3,) is in no solid body: it would see its inside.

    Raises:
        SettingsError: If it is; names it, with coordinates.
    """
    if name := enclosing_geom(model, data, eye):
        where = ", ".join(f"{x:.2f}" for x in eye)
        raise SettingsError(
            f"scene {scene.name}: the camera is inside {name} at the start ({where}) m"
        )


def _check_ground(
    scene: Scene, model: mujoco.MjModel, data: mujoco.MjData, start: Array, where: str
) -> None:
    """Lower the rover a little: every wheel must touch something."""
    lowered = copy(data)
    lowered.joint(PREFIX + "free").qpos[2] -= START_CLEARANCE_M + DROP_MAX_M
    mujoco.mj_fwdPosition(model, lowered)
    touching = {int(body) for body in model.geom_bodyid[lowered.contact.geom].ravel()}
    if touching.issuperset(model.body(name).id for name in WHEEL_BODIES):
        return
    stated_m = float(scene.elevation(start))
    geom = np.full(1, -1, np.int32)
    above = np.array([*start, stated_m + 0.8 * WHEEL_RADIUS_M])  # between the wheels
    body = model.body(PREFIX + "body").id
    down = np.array([0.0, 0.0, -1.0])
    distance_m = mujoco.mj_ray(model, data, above, down, None, 1, body, geom)
    found = int(geom[0])
    if found < 0:
        reason = "there is nothing below"
    elif not model.geom_contype[found] & 1 and not model.geom_conaffinity[found] & 1:
        bits = f"contype {model.geom_contype[found]}, conaffinity {model.geom_conaffinity[found]}"
        reason = f"{geom_name(model, found)} does not collide with the wheels ({bits})"
    else:
        height_m = above[2] - distance_m
        reason = f"{geom_name(model, found)} is at z = {height_m:g} m, expected {stated_m:g} m"
    raise SettingsError(f"scene {scene.name}: no ground {where}: {reason}")


def _check_space(
    scene: Scene, model: mujoco.MjModel, data: mujoco.MjData, start: Array, where: str
) -> None:
    """Name the obstacle that the rover is inside of."""
    for contact in data.contact:
        if contact.dist < -SETTLING_CONTACT_M:
            roots = model.body_rootid[model.geom_bodyid[contact.geom]]
            mine = [model.body(int(root)).name == BODY for root in roots]
            if any(mine) and not all(mine):
                geom = int(contact.geom[mine.index(False)])
                found = f"{geom_name(model, geom)} is in the way"
                found += _shape_hint(model, data, geom, start, float(scene.elevation(start)))
                raise SettingsError(f"scene {scene.name}: no free space {where}, {found}")


def _shape_hint(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int, start: Array, stated_m: float
) -> str:
    """Say what of an obstacle may not be expected: the height of ground, the hull of a mesh."""
    kind, down = model.geom_type[geom], np.array([0.0, 0.0, -1.0])
    above, up = np.array([*start, stated_m + ABOVE_M]), data.geom_xmat[geom, 2::3]
    distance_m = -1.0
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        distance_m = mujoco.mj_rayHfield(model, data, geom, above, down)
    elif kind == mujoco.mjtGeom.mjGEOM_PLANE and up[2] > math.cos(TIPPED_RAD):
        distance_m = up @ (above - data.geom_xpos[geom]) / up[2]
        if up[2] < math.cos(LEVEL_RAD):
            return f": its surface is tilted by {math.degrees(math.acos(up[2])):.0f} degrees"
    if distance_m >= 0:
        height_m = round(above[2] - distance_m, 6)
        return f": its surface is at z = {height_m:g} m, expected {stated_m:g} m"
    return ": of a mesh, the convex hull collides" if kind == mujoco.mjtGeom.mjGEOM_MESH else ""
