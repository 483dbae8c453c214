"""The world: a scene with carrier and stereo rig, compiled, at the start of a route."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache

import mujoco
import numpy as np

from scenes.scene import HOME, Kind, Motion, Scene, Thing
from sim.imaging.lens import margin_px
from sim.imaging.raw_lens import RawLens
from sim.settings import RecordSettings
from sim.world.finite import expect_finite
from sim.world.handheld import build_hand, walk
from sim.world.path import Path, plan_path
from sim.world.random_streams import stream
from sim.world.rig import CAMERA, T_world_left, add_rig, stereo_rig, widened
from sim.world.rover import BODY, PREFIX, WHEEL_RADIUS_M, WHEELS, build_rover
from sim.world.start import START_CLEARANCE_M, check_start, check_view
from sim.world.terrain import lay_terrain
from sim.world.tyres import IMPEDANCE_RATIO, set_tyre_contacts
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.rig import StereoRig

STEPS_MIN_HZ, STEPS_MAX_HZ = 1000, 4000
START_S = 1.0
"""Time of the first frame; the rover settles during the second before it."""
MEMORY_MIN = 1 << 26
"""Bytes that MuJoCo has at least for contacts; a world that sets fewer did so without the rover."""
WALK_STEP_M = 0.1
"""Spacing of the points of a hand-held carrier's route."""


@dataclass(frozen=True)
class World:
    """A compiled scene, and a path to drive or walk; `data` is the only mutable part.

    Attributes:
        rig: True geometry of the stereo pair, in the delivered size.
        render_rig: The same with the margin that is rendered for the lens.
        arrival_s: Time of arrival of a hand-held carrier; None for the rover.
        movers: Name of a mocap body to its motion; the hand-held carrier is one of them.
        things: Name of a geom to the thing it shows, as given by scene or terrain.
        model: With the carrier under the prefix `rover/`.
        data: At the start of the route, before settling.
        lens: Of both cameras.
    """

    scene: Scene
    rig: StereoRig
    render_rig: StereoRig
    path: Path
    arrival_s: float | None
    movers: Mapping[str, Motion]
    things: Mapping[str, Thing]
    model: mujoco.MjModel
    data: mujoco.MjData
    lens: RawLens

    @property
    def is_driven(self) -> bool:
        """Whether the carrier is the rover."""
        return self.arrival_s is None

    @property
    def T_world_chassis(self) -> Array:
        """(4, 4) pose of the rover's chassis, by its joint."""
        qpos = self.data.joint(PREFIX + "free").qpos
        return se3.from_quat_wxyz(qpos[3:], qpos[:3])

    @property
    def T_world_cam(self) -> Array:
        """(4, 4) pose of the left camera, as of the last `place_bodies`."""
        camera = self._camera_row
        return T_world_left(self.data.cam_xpos[camera], self.data.cam_xmat[camera], self.rig)

    @cached_property
    def _camera_row(self) -> int:
        return int(self.model.camera(CAMERA).id)

    @property
    def T_world_body(self) -> Array:
        """(4, 4) pose of the body frame as of the last `place_bodies`, rigid with cameras and IMU.

        It is that of the chassis, unless the mast bends.
        """
        return self.T_world_cam @ self._T_cam_body

    @cached_property
    def _T_cam_body(self) -> Array:
        return se3.inverse(self.rig.T_body_cam)

    @property
    def T_world_bodies(self) -> Array:
        """(nbody, 4, 4) poses of MuJoCo's bodies, as of the last `place_bodies`."""
        return se3.pose(self.data.xmat.reshape(-1, 3, 3), self.data.xpos)

    @property
    def wheel_angles_rad(self) -> Array:
        """(2,) angles of the left and the right wheel since the start, forward positive."""
        return np.array([self.data.joint(name).qpos[0] for name in WHEELS])

    @property
    def gravity_mps2(self) -> Array:
        """(3,) gravity in world axes; zero where the world turns it off."""
        option = self.model.opt
        off = option.disableflags & mujoco.mjtDisableBit.mjDSBL_GRAVITY
        return np.zeros(3) if off else np.array(option.gravity)

    def reset(self) -> None:
        """Bring all bodies to their start: to the world's keyframe `home`, if it has one."""
        key = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_KEY, HOME)
        if key >= 0:
            mujoco.mj_resetDataKeyframe(self.model, self.data, key)
        else:
            mujoco.mj_resetData(self.model, self.data)

    def command_wheels(self, speeds_radps: Array) -> None:
        """Set the wheels' target speeds, (2,) left and right, rad/s, forward positive."""
        for name, speed in zip(WHEELS, speeds_radps, strict=True):
            self.data.actuator(name).ctrl = speed

    def body_row(self, name: str) -> int:
        """Row of a body among MuJoCo's."""
        return self._body_rows[name]

    @cached_property
    def _body_rows(self) -> dict[str, int]:
        return {self.model.body(row).name: row for row in range(self.model.nbody)}

    @cached_property
    def _mocap_rows(self) -> list[int]:
        """Row of each moving object among MuJoCo's mocap bodies."""
        return [int(self.model.body_mocapid[self.body_row(name)]) for name in self.movers]

    def move_movers(self, time_s: float) -> None:
        """Place all moving objects where they are at a time."""
        if self.movers:
            T = np.stack([motion(time_s) for motion in self.movers.values()], dtype=float)
            self.data.mocap_pos[self._mocap_rows] = T[:, :3, 3]
            self.data.mocap_quat[self._mocap_rows] = _quaternions(T[:, :3, :3].tobytes())

    def place(self, time_s: float, qpos: Array) -> None:
        """Bring the whole world to a time and to joint positions (nq,)."""
        self.data.qpos[:] = qpos
        self.move_movers(time_s)
        self.place_bodies()

    def place_bodies(self) -> None:
        """Update the poses of bodies, cameras, lights, flexes and tendons from the joints.

        `mj_step` leaves them one step behind; call this before rendering.
        """
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        if self.model.nflex:
            mujoco.mj_flex(self.model, self.data)
        if self.model.ntendon:
            mujoco.mj_tendon(self.model, self.data)


@lru_cache(maxsize=8)
def _quaternions(rotations: bytes) -> Array:
    """Unit quaternions (N, 4) of N matrices (3, 3); what only slides has the same at every step."""
    return se3.to_quat_wxyz(np.frombuffer(rotations).reshape(-1, 3, 3))


def build_world(scene: Scene, settings: RecordSettings) -> World:
    """Place the carrier at the start of the route, heading along it, and compile.

    Raises:
        SettingsError: If the scene has no such route, the route is too short for the distance, the
            world does not compile, or the rover has no weight, ground or free space at the start.
    """
    path = plan_path(_route(scene, settings), settings.drive.distance_m)
    rig = stereo_rig(settings.rig)
    render_rig = widened(rig, margin_px(settings, rig))
    spec = scene.spec.copy()
    movers, arrival_s = dict(scene.movers), None
    if settings.drive.carrier == "handheld":
        carrier = build_hand()
        steps = math.ceil(path.length_m / WALK_STEP_M) + 1
        points, rng = path.at(np.linspace(0, path.length_m, steps)), stream(settings.seed, "hand")
        way = walk(scene, points, settings.drive, settings.handheld, START_S, rng)
        movers[BODY], arrival_s = way
    else:
        carrier = build_rover(settings.rig.height_m, settings.rover)
    add_rig(carrier, settings.rig, render_rig)
    first, second = path.waypoints[:2]
    yaw = math.atan2(*(second - first)[::-1])
    height = float(scene.elevation(first)) + WHEEL_RADIUS_M + START_CLEARANCE_M
    heading = (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
    start = spec.worldbody.add_frame(pos=(*first, height), quat=heading)
    spec.option.timestep = float(1 / steps_per_second(settings))
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = IMPEDANCE_RATIO
    if 0 <= spec.memory < MEMORY_MIN:
        spec.memory = MEMORY_MIN
    try:
        things = {**scene.things, **lay_terrain(spec, scene, path, settings)}
        spec.attach(carrier, prefix=PREFIX, frame=start)
        model = spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise SettingsError(
            f"scene {scene.name}: does not compile with the rover, whose names begin with {PREFIX} "
            f"({reason})"
        ) from None
    if scene.source:
        expect_finite(scene, model)
    if arrival_s is None:
        set_tyre_contacts(model)
    data = mujoco.MjData(model)
    lens = RawLens(settings, rig, render_rig)
    world = World(scene, rig, render_rig, path, arrival_s, movers, things, model, data, lens)
    world.reset()
    world.move_movers(0.0)
    mujoco.mj_forward(model, data)
    if world.is_driven:
        check_start(scene, model, data, path.waypoints[0])
    check_view(scene, model, data, world.T_world_cam[:3, 3])
    return world


def steps_per_second(settings: RecordSettings) -> int | Fraction:
    """Choose a physics rate of at least 1 kHz that every sensor's rate divides.

    Where the rates have no common multiple below 4 kHz, only the cameras' counts, and the others
    are sampled at the first step at or after each of their times.
    """
    rates_hz = settings.rig.rate_hz, settings.imu.rate_hz, settings.encoders.rate_hz
    rates = [Fraction(rate).limit_denominator(1000) for rate in rates_hz]
    numerators, denominators = zip(*(r.as_integer_ratio() for r in rates), strict=True)
    common = Fraction(math.lcm(*numerators), math.gcd(*denominators))
    if common > STEPS_MAX_HZ:
        common = rates[0]
    return common * math.ceil(STEPS_MIN_HZ / common)


def thing_of(world: World, geom: int) -> Thing:
    """Return the thing that a geom shows: by the scene, else by the geom's properties."""
    model = world.model
    name = model.geom(geom).name
    if name in world.things:
        return world.things[name]
    body = model.geom_bodyid[geom]
    root = model.body(model.body_rootid[body]).name
    if root == BODY:
        return Thing("rover", Kind.MOVING)
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
        kind = Kind.GROUND
    else:
        moves = model.body_weldid[body] != 0 or model.body_mocapid[body] >= 0
        kind = Kind.MOVING if moves else Kind.STATIC
    return Thing(name or f"{root}/geom_{geom}", kind)


def _route(scene: Scene, settings: RecordSettings) -> Array:
    drive = settings.drive
    if drive.waypoints:
        if len(drive.waypoints) < 2:
            raise SettingsError("setting drive.waypoints: expected at least two points, or none")
        return np.array(drive.waypoints, dtype=float)
    if drive.route not in scene.routes:
        raise SettingsError(
            f"setting drive.route: scene {scene.name} has no route {drive.route}; "
            f"valid: {', '.join(sorted(scene.routes))}"
        )
    return np.asarray(scene.routes[drive.route], dtype=float)
