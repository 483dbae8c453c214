"""True motion of the carrier at an instant, and the forces on its wheels."""

import mujoco
import numpy as np

from sim.world.rover import BODY, MAST, PREFIX, WHEEL_BODIES
from sim.world.world import World
from vo.contract import se3
from vo.contract.arrays import Array


def body_motion(world: World, time_s: float) -> tuple[Array, Array, Array]:
    """Return pose (4, 4), velocity (3,) and angular velocity (3,) of the body frame in world.

    The rover's velocities are the means over the last physics step; see `centred_velocity`.
    """
    if not world.is_driven:
        h = 1e-4
        before, now, after = (world.movers[BODY](time_s + dt) for dt in (-h, 0.0, h))
        turn = se3.rotation_vector(after @ se3.inverse(before))
        return now, (after[:3, 3] - before[:3, 3]) / (2 * h), turn / (2 * h)
    world.place_bodies()
    return world.T_world_body, *_body_velocity(world)


def centred_velocity(world: World, v_world_body: Array, w_world_body: Array) -> tuple[Array, Array]:
    """Return velocity and angular velocity (3,) at the time of `body_motion`, one step after it.

    MuJoCo integrates positions with the velocity after the step (semi-implicit), so that the
    velocity at a time is the mean of those of the steps before and after it. A step leaves the
    poses, to which this one refers, as they were before it.
    """
    if not world.is_driven:
        return v_world_body, w_world_body
    v_next, w_next = _body_velocity(world)
    return (v_world_body + v_next) / 2, (w_world_body + w_next) / 2


def _body_velocity(world: World) -> tuple[Array, Array]:
    """Velocity and angular velocity (3,) by the present joint velocities and the placed bodies."""
    model, data = world.model, world.data
    mujoco.mj_comVel(model, data)
    twist, mast = np.empty(6), world.body_row(PREFIX + MAST)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, mast, twist, 0)
    (wx, wy, wz), (x, y, z) = twist[:3], world.T_world_body[:3, 3] - data.xpos[mast]
    by_lever = np.array([wy * z - wz * y, wz * x - wx * z, wx * y - wy * x])
    return twist[3:] + by_lever, twist[:3]


def wheel_forces_n(world: World) -> Array:
    """Return the normal force (3,) on the left, the right and the caster wheel."""
    total, force = np.zeros(3), np.empty(6)
    if not world.is_driven:
        return total
    model, data = world.model, world.data
    wheels = {world.body_row(name): wheel for wheel, name in enumerate(WHEEL_BODIES)}
    for k, bodies in enumerate(model.geom_bodyid[data.contact.geom].tolist()):
        for wheel in {wheels[body] for body in bodies if body in wheels}:
            mujoco.mj_contactForce(model, data, k, force)
            total[wheel] += force[0]
    return total
