"""The world: a scene with the rover and its stereo rig in it, compiled, at the start of a route."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from scenes.scene import Scene
from sim.rig import add_rig, stereo_rig
from sim.rover import PREFIX, WHEEL_RADIUS_M, WHEELS, build_rover
from sim.settings import RecordSettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.rig import StereoRig

TIMESTEP_MAX_S = 0.001
START_CLEARANCE_M = 0.01
"""Above the level ground, so that no brick is inside a wheel; the rover drops and settles."""


@dataclass(frozen=True)
class World:
    """A compiled scene; `data` is the one mutable part.

    Attributes:
        scene: What was compiled.
        rig: True geometry of the stereo pair, in the size that is delivered.
        render_rig: What is rendered: the same with a margin, for the lens to bend.
        route: (N, 2) waypoints in world x, y metres that the rover starts on.
        steps_per_frame: Physics steps between two images; a frame period is a whole number.
        model: With the rover under the prefix `rover/`.
        data: At the start of the route, before settling.
    """

    scene: Scene
    rig: StereoRig
    render_rig: StereoRig
    route: Array
    steps_per_frame: int
    model: mujoco.MjModel
    data: mujoco.MjData

    @property
    def T_world_body(self) -> Array:
        """(4, 4) pose of the rover now."""
        qpos = self.data.joint(PREFIX + "free").qpos
        return se3.from_quat_wxyz(qpos[3:], qpos[:3])

    @property
    def v_world_body(self) -> Array:
        """(3,) velocity of the body origin in world axes, m/s."""
        return self.data.joint(PREFIX + "free").qvel[:3].copy()

    @property
    def wheel_angles_rad(self) -> Array:
        """(2,) turned by the left and the right wheel since the start, forward positive."""
        return np.array([self.data.joint(name).qpos[0] for name in WHEELS])

    def command_wheels(self, speeds_radps: Array) -> None:
        """Set the wheels' wanted speeds, (2,) left and right, rad/s, forward positive."""
        for name, speed in zip(WHEELS, speeds_radps, strict=True):
            self.data.actuator(name).ctrl = speed

    def place_bodies(self) -> None:
        """Bring the poses of bodies, cameras and lights up to date with the joints.

        `mj_step` leaves them one step behind; call this before looking.
        """
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)


def build_world(scene: Scene, settings: RecordSettings) -> World:
    """Put the rover at the start of the route, heading along it, and compile.

    Raises:
        SettingsError: If the scene has no such route.
    """
    if settings.drive.route not in scene.routes:
        raise SettingsError(
            f"setting drive.route: scene {scene.name} has no route {settings.drive.route}; "
            f"valid: {', '.join(sorted(scene.routes))}"
        )
    route = np.asarray(scene.routes[settings.drive.route], dtype=float)
    spec = scene.spec.copy()
    _attach_rover(spec, route, settings)
    steps_per_frame = math.ceil(1 / (settings.rig.rate_hz * TIMESTEP_MAX_S) - 1e-9)
    spec.option.timestep = 1 / (settings.rig.rate_hz * steps_per_frame)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0  # wheels hold their place instead of creeping sideways
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rig = stereo_rig(settings.rig)
    return World(scene, rig, rig, route, steps_per_frame, model, data)


def _attach_rover(spec: mujoco.MjSpec, route: Array, settings: RecordSettings) -> None:
    rover = build_rover(settings.rig.height_m, settings.rover.wheel_torque_max_nm)
    add_rig(rover, settings.rig)
    yaw = math.atan2(*(route[1] - route[0])[::-1])
    start = spec.worldbody.add_frame(
        pos=(*route[0], WHEEL_RADIUS_M + START_CLEARANCE_M),
        quat=(math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)),
    )
    spec.attach(rover, prefix=PREFIX, frame=start)
