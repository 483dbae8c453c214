"""Physics of a rover in a world, advanced from one control step to the next, and its log."""

import math
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from sim.settings import RecordSettings
from sim.world.carrier_motion import body_motion, centred_velocity, wheel_forces_n
from sim.world.fall import FallMonitor
from sim.world.physics import expect_stable
from sim.world.rover import BODY, PREFIX, WHEEL_RADIUS_M, WHEELS, ticks
from sim.world.start import START_CLEARANCE_M
from sim.world.trip import MOVER_PERIOD_S, Motions, States, Trip, longest_window_s
from sim.world.world import START_S, World
from trials.gym.world.dynamic_agents import DynamicAgent
from trials.gym.world.free_space import obstacle_geoms, rigid_geoms
from vo.contract.arrays import Array, Mask

MAX_TIMESTEP_S = 0.0025
"""Longest time step; a contact of the tyres has a time constant of 10 ms, a recording uses 1 ms."""
COMMAND_PERIOD_S = 0.02
"""Longest time between two changes of the wheel speeds and between two contact checks."""
SETTLING_S = 1.0
MAX_SETTLING_M = 0.05
"""Displacement while settling that only a push explains."""


@dataclass(frozen=True)
class Snapshot:
    """True pose (4, 4) and left and right encoder reading at the middle of an exposure."""

    time_ns: int
    T_world_body: Array
    wheel_ticks: tuple[int, int]


class TrialLog:
    """States of the world wherever physics paused, to record a trial as a dataset afterwards."""

    def __init__(self) -> None:
        self._states: list[tuple[int, Array]] = []
        self._motions: list[tuple[int, Array, Array, Array, Array]] = []
        self._frames: list[tuple[int, Array, Array]] = []
        self._ticks: list[tuple[int, tuple[int, int]]] = []
        self._sample = False, False

    def add_state(self, world: World, time_ns: int, is_frame: bool, is_regular: bool) -> None:
        """Add the state of the world and, at regular times, the motion of the body."""
        self._states.append((time_ns, world.data.qpos.copy()))
        self._sample = is_frame, is_regular
        if is_frame or is_regular:
            motion = body_motion(world, time_ns * 1e-9)
            if is_frame:
                self._frames.append((time_ns, *motion[:2]))
            if is_regular:
                self._motions.append((time_ns, *motion, wheel_forces_n(world)))

    def complete_velocity(self, world: World) -> None:
        """Centre the velocities of the last state on its time, one physics step after it."""
        is_frame, is_regular = self._sample
        if is_frame:
            time_ns, T_world_body, v_world_body = self._frames[-1]
            v_world_body, _ = centred_velocity(world, v_world_body, np.zeros(3))
            self._frames[-1] = time_ns, T_world_body, v_world_body
        if is_regular:
            time_ns, T_world_body, *velocity, forces = self._motions[-1]
            v_world_body, w_world_body = centred_velocity(world, *velocity)
            self._motions[-1] = time_ns, T_world_body, v_world_body, w_world_body, forces
        self._sample = False, False

    def add_wheel_ticks(self, time_ns: int, ticks: tuple[int, int]) -> None:
        """Add a reading of the wheel encoders."""
        self._ticks.append((time_ns, ticks))

    def trip(self, delivered: Mask, ended: str) -> Trip:
        """Return the drive in the recorder's form; `delivered` (N,) is that of the camera."""
        states, frames, motions, wheels = (
            [np.array(x) for x in zip(*rows, strict=True)]
            for rows in (self._states, self._frames, self._motions, self._ticks)
        )
        frame_ns, T_world_body, v_world_body = frames
        wheel_ns, wheel_ticks = wheels
        return Trip(
            *(frame_ns, delivered, States(*states), T_world_body, v_world_body),
            *(Motions(*motions), wheel_ns, wheel_ticks, ended),
        )


class Simulation:
    """Physics alone; an exposure, if it takes time, ends with the control step.

    Attributes:
        world: Its data is the state.
        acceleration_mps2: Largest acceleration of a wheel's rim.
        window: States of the world during the last exposure; overwritten at every step.
        snapshot: Middle of the last exposure.
        log: Log of the present trial, if one is kept.
        regular: Physics steps within a control step at which commands change.
        touched: (ngeom,) what the rover touched during the last control step.
        obstacles: (ngeom,) what it can bump into.
        rigid: (ngeom,) obstacles that do not give way.
        has_fallen: Whether the rover has dropped from its ground since the trial began.
    """

    def __init__(self, world: World, settings: RecordSettings, acceleration_mps2: float) -> None:
        """Set the time step of a world; `rig.rate_hz` is the rate of control steps."""
        self.world, self.acceleration_mps2 = world, acceleration_mps2
        self.log: TrialLog | None = None
        self._settings = settings
        period_s = 1 / settings.rig.rate_hz
        self._steps = math.ceil(period_s / MAX_TIMESTEP_S - 1e-9)
        self.timestep_s = world.model.opt.timestep = period_s / self._steps
        self._ramp = acceleration_mps2 * self.timestep_s / WHEEL_RADIUS_M
        exposed = settings.exposure.time_ms or settings.sensor.auto_exposure
        open_s = longest_window_s(settings) if exposed else 0.0
        half = math.ceil(open_s / 2 / self.timestep_s - 1e-9)
        self._window = min(2 * half, self._steps)
        self.window = States(
            np.zeros(self._window + 1, np.int64), np.zeros((self._window + 1, world.model.nq))
        )
        longest_s = MOVER_PERIOD_S if world.movers else COMMAND_PERIOD_S
        chunks = math.ceil(period_s / longest_s - 1e-9)
        self.regular = {round(k * self._steps / chunks) for k in range(1, chunks + 1)}
        exposure = set(range(self._steps - self._window, self._steps + 1))
        self._stops = tuple(sorted((self.regular | exposure) - {0}))
        self._middle = self._steps - self._window // 2
        model = world.model
        self._is_rover = model.body_rootid[model.geom_bodyid] == model.body(BODY).rootid[0]
        self._actuators = [model.actuator(name).id for name in WHEELS]
        self._wheels = [model.joint(name).qposadr[0] for name in WHEELS]
        self._free = model.joint(PREFIX + "free").qposadr[0]
        self.obstacles: Mask = obstacle_geoms(world)
        self.rigid: Mask = rigid_geoms(world)
        self._ahead = replace(world, data=mujoco.MjData(model))
        self._agents = [m for m in world.movers.values() if isinstance(m, DynamicAgent)]
        self.reset(np.array([*world.path.waypoints[0], 0.0]))

    @property
    def time_s(self) -> float:
        """Present time of the world; a trial begins at START_S."""
        return START_S + self._count * self.timestep_s

    @property
    def pose2(self) -> tuple[float, float, float]:
        """True x, y in metres and yaw in radians of the chassis."""
        x, y, _, qw, qx, qy, qz = self.world.data.qpos[self._free : self._free + 7].tolist()
        return x, y, math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))

    @property
    def upright(self) -> float:
        """Cosine of the angle between the vertical axes of the chassis and of the world."""
        _, qx, qy, _ = self.world.data.qpos[self._free + 3 : self._free + 7].tolist()
        return 1 - 2 * (qx * qx + qy * qy)

    def body_motion(self) -> tuple[Array, Array, Array]:
        """Return pose (4, 4), velocity (3,) and angular velocity (3,) of the body now, in world.

        Velocities are those of the present time if the last command is held for one more physics
        step: `centred_velocity` needs it, which is tried on a copy.
        """
        world, ahead = self.world, self._ahead
        T_world_body, *velocity = body_motion(world, self.time_s)
        mujoco.mj_copyData(ahead.data, world.model, world.data)
        ahead.data.ctrl[self._actuators] = self._ramped(self._stops[0])
        mujoco.mj_step(world.model, ahead.data)
        return T_world_body, *centred_velocity(ahead, *velocity)

    def _ramped(self, steps: int) -> Array:
        """Return the speeds (2,) of the wheels so many physics steps nearer to the commanded."""
        reach = self._ramp * steps
        return self._speeds + np.clip(self._commanded - self._speeds, -reach, reach)

    @property
    def wheel_ticks(self) -> tuple[int, int]:
        """Readings of the left and the right encoder, forward positive."""
        angles = self.world.data.qpos[self._wheels]
        left, right = ticks(angles, self._settings.encoders.ticks_per_turn)
        return int(left), int(right)

    def reset(self, start: Array, log: TrialLog | None = None) -> bool:
        """Reset the world, place the rover at `start` (3,), x, y, yaw, and let it settle.

        The log begins with the step of the first image.

        Returns:
            Whether the rover stands where it was placed, and nothing touches it: a moving thing
            may be there, or no ground.
        """
        world, data = self.world, self.world.data
        world.reset()
        height = float(world.scene.elevation(start[:2])) + WHEEL_RADIUS_M + START_CLEARANCE_M
        yaw = float(start[2])
        quat = math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)
        data.qpos[self._free : self._free + 7] = (*start[:2], height, *quat)
        self._speeds, self.has_fallen = np.zeros(2), False
        world.place_bodies()
        self._fall = FallMonitor(world.model, data)
        self.touched = np.zeros(world.model.ngeom, bool)
        periods = math.ceil(SETTLING_S / (self._steps * self.timestep_s))
        self._count = -periods * self._steps
        for agent in self._agents:
            agent.reset()
        world.move_movers(self.time_s)
        mujoco.mj_step(world.model, data, (periods - 1) * self._steps)
        self._count = -self._steps
        self.log = log
        self.advance(np.zeros(2))
        x, y, _ = self.pose2
        pushed = math.hypot(x - start[0], y - start[1]) > MAX_SETTLING_M
        alone = not pushed and not (self.touched & self.rigid).any() and not self.has_fallen
        self.touched[:] = False
        return alone

    def advance(self, speeds_radps: Array) -> None:
        """Advance by one control step towards the speeds (2,) of the left and the right wheel.

        Raises:
            DriveError: If the physics is unstable.
        """
        world, model, data = self.world, self.world.model, self.world.data
        self.touched[:] = False
        self._commanded, done = speeds_radps, 0
        for stop in self._stops:
            if world.movers:
                world.move_movers(self.time_s)
            self._speeds = self._ramped(stop - done)
            data.ctrl[self._actuators] = self._speeds
            mujoco.mj_step(model, data, 1)
            if self.log:
                self.log.complete_velocity(world)
            mujoco.mj_step(model, data, stop - done - 1)
            self._count += stop - done
            done = stop
            for agent in self._agents:
                agent.advance(self.time_s, np.array(self.pose2[:2]))
            self._add_contacts()
            self._record(stop)
        expect_stable(world, self.time_s)
        if self.log:
            self.log.add_wheel_ticks(self.snapshot.time_ns, self.snapshot.wheel_ticks)

    def _record(self, stop: int) -> None:
        """Keep what the camera and the log need of the state after a physics step."""
        world, time_ns = self.world, round(self.time_s * 1e9)
        if stop >= self._steps - self._window:
            k = stop - (self._steps - self._window)
            self.window.times_ns[k] = time_ns
            self.window.qpos[k] = world.data.qpos
        if stop == self._middle:
            world.place_bodies()
            self.snapshot = Snapshot(time_ns, world.T_world_body, self.wheel_ticks)
        if self.log:
            self.log.add_state(world, time_ns, stop == self._middle, stop in self.regular)

    def _add_contacts(self) -> None:
        self.has_fallen = self.has_fallen or self._fall.has_fallen(self.world.data)
        if self.world.data.ncon:
            pairs = self.world.data.contact.geom
            is_rover = self._is_rover[pairs]
            self.touched[pairs[is_rover[:, ::-1] & ~is_rover]] = True
