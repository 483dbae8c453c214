"""The ER1-like rover: two driven wheels in front, a swivel caster behind, a laptop and a mast.

Body frame: origin at the midpoint of the wheel axle, x forward, y left, z up. Visible parts have
mass and no contact; collision shapes are simpler and hidden in geom group 3.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from sim.settings import MAX_ROVER_MPS, RoverSettings
from vo.contract.arrays import Array, Indices

WHEEL_RADIUS_M = 0.05
MAX_WHEEL_RADPS = MAX_ROVER_MPS / WHEEL_RADIUS_M
TRACK_M = 0.38
TYRE_HALF_WIDTH_M = 0.015
TYRE_DEFLECTION_M = 0.0006
"""Deflection of a tyre under a third of the rover's weight (stiffness of `sim/world/tyres.py`)."""
CASTER_RADIUS_M = 0.03
CASTER_X_M = -0.27
CASTER_TRAIL_M = 0.025
CAMERA_X_M = 0.10
"""x of the optical centres: ahead of every part, so that the rover is not in the images."""

PREFIX = "rover/"
BODY = PREFIX + "body"
MAST = "mast"
"""Body that carries the cameras and the inertial unit, within the rover's own spec."""
WHEELS = (PREFIX + "wheel_left", PREFIX + "wheel_right")
"""Names of the wheels' joints and of their actuators, left then right."""

WHEEL_BODIES = (*WHEELS, PREFIX + "caster_wheel")

VISIBLE_GROUP = 1
CONTACT_GROUP = 3

ALUMINIUM = (0.50, 0.52, 0.54, 1.0)
BLACK = (0.06, 0.06, 0.07, 1.0)
RUBBER = (0.10, 0.10, 0.10, 1.0)
HUB = (0.85, 0.85, 0.82, 1.0)
SCREEN = (0.16, 0.24, 0.38, 1.0)
BOX = mujoco.mjtGeom.mjGEOM_BOX
BEAM_M = 0.0125
"""Half side of the aluminium profiles."""
CRATE = (0.55, 0.42, 0.26, 1.0)
LOAD_AT = (-0.22, 0.11, 0.42)
"""Centre of the load: behind the mast, out of the cameras' view, and left of the caster."""
LOAD_ARM_M, LOAD_HZ = 0.22, 3.0
HEAD_KG = 0.40
"""Swinging mass of mast, arm and cameras."""
GRAVITY_MPS2 = 9.81


def ticks(wheel_angles_rad: Array, ticks_per_turn: int) -> Indices:
    """Quantise wheel angles (...) to whole ticks of the encoders, rounding down."""
    return np.floor(wheel_angles_rad / (2 * np.pi) * ticks_per_turn).astype(np.int64)


class _Part(NamedTuple):
    """A visible box: centre and half sizes in metres in the body frame, mass in kg."""

    pos: tuple[float, float, float]
    size: tuple[float, float, float]
    mass: float
    rgba: tuple[float, float, float, float] = ALUMINIUM


LOWER_Z, DECK_Z = 0.03, 0.16
POST_HALF_M = (DECK_Z - LOWER_Z) / 2 - BEAM_M

PARTS = (
    *(_Part((-0.12, y, LOWER_Z), (0.18, BEAM_M, BEAM_M), 0.30) for y in (-0.15, 0.15)),
    *(_Part((x, 0.0, LOWER_Z), (BEAM_M, 0.1375, BEAM_M), 0.20) for x in (0.045, -0.12, -0.285)),
    *(
        _Part((x, y, (LOWER_Z + DECK_Z) / 2), (BEAM_M, BEAM_M, POST_HALF_M), 0.10)
        for x in (0.0, -0.285)
        for y in (-0.15, 0.15)
    ),
    *(_Part((-0.1425, y, DECK_Z), (0.155, BEAM_M, BEAM_M), 0.25) for y in (-0.15, 0.15)),
    *(_Part((x, 0.0, DECK_Z), (BEAM_M, 0.1375, BEAM_M), 0.20) for x in (0.0, -0.285)),
    _Part((-0.12, 0.0, 0.08), (0.10, 0.12, 0.037), 4.0, BLACK),  # battery and motor controller
    *(_Part((0.0, y, 0.0), (0.03, 0.04, 0.025), 0.45, BLACK) for y in (-0.12, 0.12)),  # motors
    _Part((-0.13, 0.0, DECK_Z + 0.027), (0.12, 0.165, 0.014), 1.7, BLACK),  # laptop
    _Part((0.005, 0.0, DECK_Z + 0.135), (0.005, 0.165, 0.11), 0.5, BLACK),  # its lid, open
    _Part((-0.001, 0.0, DECK_Z + 0.145), (0.002, 0.15, 0.095), 0.05, SCREEN),
    _Part((CASTER_X_M, 0.0, 0.022), (0.03, 0.03, 0.006), 0.10, BLACK),  # the caster's mount
)


def build_rover(camera_height_m: float, settings: RoverSettings) -> mujoco.MjSpec:
    """Build the rover as a spec of its own, its body at the origin, ready to be attached.

    It has a free joint, two wheel hinges with a velocity actuator each (rad/s, forward positive),
    the caster's two passive hinges, and two more each for a bending mast and a swaying load, where
    the settings have them. The frame of the body `mast` is that of the rover's body as long as the
    mast is straight. The optical centres are `camera_height_m` above level ground.
    """
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="body")
    body.add_freejoint(name="free")
    for part in PARTS:
        _visible(body, *part)
    camera_z_m = camera_height_m - WHEEL_RADIUS_M
    mast = body.add_body(name=MAST)
    _add_mast(mast, camera_z_m)
    if settings.flex_deg > 0:
        _bend(mast, camera_z_m, settings)
    if settings.load_kg > 0:
        _add_load(body, settings.load_kg)
    _add_contact_boxes(body, camera_z_m)
    for name, y in (("wheel_left", TRACK_M / 2), ("wheel_right", -TRACK_M / 2)):
        _add_driven_wheel(spec, body, name, y, settings.wheel_torque_max_nm)
    _add_caster(body)
    return spec


def _add_mast(body: mujoco.MjsBody, camera_z_m: float) -> None:
    """Add the post, the arm at its top and the camera housing, behind the optical centres."""
    half = (camera_z_m - LOWER_Z) / 2
    x = 0.045
    _visible(body, (x, 0.0, LOWER_Z + half), (0.01, 0.01, half), 0.30)
    _visible(body, ((x + 0.075) / 2, 0.0, camera_z_m), (0.02, 0.01, 0.01), 0.05)
    _visible(body, (0.075, 0.0, camera_z_m), (0.012, 0.075, 0.016), 0.20, BLACK)


def _bend(mast: mujoco.MjsBody, camera_z_m: float, settings: RoverSettings) -> None:
    """Hinge the mast at its foot, forward and sideways, with springs.

    An acceleration of 1 g on the head, of mass m at height h above the foot, bends it by the
    angle a: the stiffness is m g h / a, and the natural frequency sqrt(g / (h a)) for any mass.
    """
    height = camera_z_m - LOWER_Z
    stiffness = HEAD_KG * GRAVITY_MPS2 * height / math.radians(settings.flex_deg)
    damping = settings.flex_damping * (2 * math.sqrt(stiffness * HEAD_KG * height**2))
    spring = {"pos": (0.045, 0.0, LOWER_Z), "stiffness": stiffness, "damping": damping}
    mast.add_joint(name="mast_pitch", axis=(0.0, 1.0, 0.0), **spring)
    mast.add_joint(name="mast_roll", axis=(1.0, 0.0, 0.0), **spring)


def _add_load(body: mujoco.MjsBody, mass_kg: float) -> None:
    """Put a crate on springs over the left rear, swaying at LOAD_HZ with little damping."""
    x, y, z = LOAD_AT
    load = body.add_body(name="load", pos=(x, y, z - LOAD_ARM_M))
    inertia = mass_kg * LOAD_ARM_M**2
    stiffness = inertia * (2 * math.pi * LOAD_HZ) ** 2 + mass_kg * GRAVITY_MPS2 * LOAD_ARM_M
    spring = {"stiffness": stiffness, "damping": 0.1 * math.sqrt(stiffness * inertia)}
    load.add_joint(name="load_pitch", axis=(0.0, 1.0, 0.0), **spring)
    load.add_joint(name="load_roll", axis=(1.0, 0.0, 0.0), **spring)
    _visible(load, (0.0, 0.0, LOAD_ARM_M), (0.09, 0.06, 0.07), mass_kg, CRATE)


def _add_contact_boxes(body: mujoco.MjsBody, camera_z_m: float) -> None:
    """Add the collision shapes of chassis and mast."""
    for pos, size in (
        ((-0.12, 0.0, 0.12), (0.18, 0.17, 0.09)),
        ((0.055, 0.0, camera_z_m / 2 + 0.1), (0.03, 0.05, camera_z_m / 2 - 0.08)),
    ):
        body.add_geom(type=BOX, pos=pos, size=size, mass=0.0, group=CONTACT_GROUP)


def _add_driven_wheel(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, y_m: float, torque_max_nm: float
) -> None:
    wheel = body.add_body(name=name, pos=(0.0, y_m, 0.0))
    # The armature is the motor's inertia behind its gear.
    wheel.add_joint(name=name, axis=(0.0, 1.0, 0.0), armature=0.004, damping=0.01)
    _add_tyre(wheel, WHEEL_RADIUS_M, TYRE_HALF_WIDTH_M, mass=0.25, friction=0.9)
    for size in ((0.005, 0.016, 0.035), (0.035, 0.016, 0.005)):  # spokes show the rotation
        _visible(wheel, (0.0, 0.0, 0.0), size, 0.01, HUB)
    motor = spec.add_actuator(
        name=name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        target=name,
        ctrlrange=(-MAX_WHEEL_RADPS, MAX_WHEEL_RADPS),
        forcerange=(-torque_max_nm, torque_max_nm),
    )
    motor.set_to_velocity(kv=2.0)


def _add_caster(body: mujoco.MjsBody) -> None:
    """Add a fork that swivels about the vertical and trails its wheel behind the pivot."""
    wheel_z = CASTER_RADIUS_M - WHEEL_RADIUS_M
    fork = body.add_body(name="caster_fork", pos=(CASTER_X_M, 0.0, 0.015))
    fork.add_joint(
        name="caster_swivel", axis=(0.0, 0.0, 1.0), damping=0.005, armature=1e-4, frictionloss=0.005
    )
    for y in (-0.018, 0.018):
        _visible(fork, (-CASTER_TRAIL_M / 2, y, -0.015), (0.015, 0.002, 0.02), 0.04)
    wheel = fork.add_body(name="caster_wheel", pos=(-CASTER_TRAIL_M, 0.0, wheel_z - 0.015))
    wheel.add_joint(name="caster_wheel", axis=(0.0, 1.0, 0.0), damping=2e-4, armature=1e-4)
    _add_tyre(wheel, CASTER_RADIUS_M, 0.012, mass=0.10, friction=0.6)


def _add_tyre(
    wheel: mujoco.MjsBody, radius_m: float, half_width_m: float, mass: float, friction: float
) -> None:
    """Add a visible cylinder and, inside it, an ellipsoid: the crowned tyre that has contact.

    The crown touches flat ground in one point below the axle, which makes odometry's two
    constants, radius and track, exact; a cylinder's contact wanders over its width. Under the
    rover's weight it rolls at the radius: unloaded, it is larger by half its deflection.
    """
    unloaded_m = radius_m + TYRE_DEFLECTION_M / 2
    across = (2**-0.5, 2**-0.5, 0.0, 0.0)
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    size = (radius_m, half_width_m, 0.0)
    _visible(wheel, (0, 0, 0), size, mass, RUBBER, type=cylinder, quat=across)
    wheel.add_geom(
        type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        size=(unloaded_m, half_width_m, unloaded_m),
        mass=0.0,
        condim=4,
        friction=(friction, 0.002, 0.0001),
        group=CONTACT_GROUP,
    )


def _visible(
    body: mujoco.MjsBody,
    pos: Sequence[float],
    size: Sequence[float],
    mass: float,
    rgba: Sequence[float] = ALUMINIUM,
    **shape: Any,
) -> None:
    """Add a visible geom without contact, a box unless `shape` gives another type."""
    shape = {"type": BOX, "group": VISIBLE_GROUP, "contype": 0, "conaffinity": 0, **shape}
    body.add_geom(pos=pos, size=size, mass=mass, rgba=rgba, **shape)
