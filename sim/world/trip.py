"""A trip: simulation of the carrier on its route, without rendering."""

import math
from array import array
from dataclasses import dataclass

import mujoco
import numpy as np

from sim.settings import RecordSettings
from sim.world.carrier_motion import body_motion, centred_velocity, wheel_forces_n
from sim.world.drive import CONTROL_RATE_HZ, DriveError, Driver, where
from sim.world.fall import FallMonitor
from sim.world.physics import expect_stable
from sim.world.random_streams import stream
from sim.world.rover import ticks
from sim.world.world import START_S, World
from vo.contract.arrays import Array, Indices, Mask

REST_S = 0.4
"""Duration of the recording after arrival."""
MOVER_PERIOD_S = 0.01
"""Period of the updates of moving objects during physics."""


@dataclass(frozen=True)
class States:
    """Joint positions (K, nq) at increasing times (K,), dense enough to interpolate."""

    times_ns: Indices
    qpos: Array

    def at(self, model: mujoco.MjModel, time_ns: float) -> Array:
        """Interpolate joint positions (nq,), rotations along the shortest way."""
        after = int(np.clip(np.searchsorted(self.times_ns, time_ns), 1, len(self.times_ns) - 1))
        before_ns, after_ns = self.times_ns[after - 1 : after + 1]
        share = float(np.clip((time_ns - before_ns) / (after_ns - before_ns), 0, 1))
        if share in (0.0, 1.0):
            return self.qpos[after - 1 + int(share)].copy()
        way = np.empty(model.nv)
        mujoco.mj_differentiatePos(model, way, 1.0, self.qpos[after - 1], self.qpos[after])
        qpos = self.qpos[after - 1].copy()
        mujoco.mj_integratePos(model, qpos, way, share)
        return qpos


@dataclass(frozen=True)
class Motions:
    """True motion of the body frame at the inertial unit's M sampling times, in world axes.

    Velocities of its origin (M, 3) are in m/s, angular velocities (M, 3) in rad/s. Wheel forces
    (M, 3) are on left, right and caster wheel; zeros without wheels.
    """

    times_ns: Indices
    T_world_body: Array
    v_world_body: Array
    w_world_body: Array
    wheel_forces_n: Array


@dataclass(frozen=True)
class Trip:
    """Frames, states around their exposures, and sensor readings of a carrier on its route.

    Attributes:
        timestamps_ns: (N,) of the frames.
        delivered: (N,) whether the frame is kept.
        states: Of the world during exposures.
        T_world_body: (N, 4, 4) poses of the body frame.
        v_world_body: (N, 3) velocity of its origin in world axes, m/s.
        motions: Dense, for the inertial unit.
        wheel_times_ns: (M,) of the encoder readings; empty for a carrier without wheels.
        wheel_counts: (M, 2) ticks left and right.
        ended: Reason why the trip ended early; empty if it did not.
    """

    timestamps_ns: Indices
    delivered: Mask
    states: States
    T_world_body: Array
    v_world_body: Array
    motions: Motions
    wheel_times_ns: Indices
    wheel_counts: Indices
    ended: str

    def __len__(self) -> int:
        return len(self.timestamps_ns)

    @property
    def length_m(self) -> float:
        """Path length of the body origin through the frames."""
        steps = np.diff(self.T_world_body[:, :3, 3], axis=0)
        return float(np.linalg.norm(steps, axis=1).sum())


def make_trip(world: World, settings: RecordSettings) -> Trip:
    """Let the rover settle and drive the whole path, or walk it; deterministic.

    A rover that falls, tips over or gets stuck ends the trip with the frames until then.

    Raises:
        DriveError: If that happens before the second frame.
    """
    log = _Log(world, settings)
    driver = Driver(world.path, settings.drive) if world.is_driven else None
    timestep_s = world.model.opt.timestep
    control = SamplingClock(CONTROL_RATE_HZ if driver else 0, timestep_s)
    fall = FallMonitor(world.model, world.data)
    movers = SamplingClock(1 / MOVER_PERIOD_S if world.movers else 0, timestep_s)
    mujoco.mj_step(world.model, world.data, round((START_S - log.lead_s) / timestep_s))
    step, last_step, ended = -round(log.lead_s / timestep_s), math.inf, ""
    while step <= last_step:
        time_s = START_S + step * timestep_s
        if movers.due(step):
            world.move_movers(time_s)
        try:
            expect_stable(world, time_s)
            if driver and control.due(step):
                if fall.has_fallen(world.data):
                    raise DriveError(f"the rover fell {where(world.T_world_chassis, time_s)}")
                world.command_wheels(driver.command(world.T_world_chassis, time_s))
        except DriveError as error:
            ended = str(error)
            break
        arrived = driver.arrived if driver else time_s >= (world.arrival_s or 0.0)
        if arrived and last_step == math.inf:
            last_step = step + round(REST_S / timestep_s)
        log.take(step, time_s)
        until = int(min(log.next_step(step), control.next, movers.next))
        mujoco.mj_step(world.model, world.data, 1)
        log.complete_velocity()
        mujoco.mj_step(world.model, world.data, until - step - 1)
        step = until
    return log.trip(ended)


class SamplingClock:
    """Physics steps of a periodic event: the first at or after each multiple of its period."""

    def __init__(self, rate_hz: float, timestep_s: float) -> None:
        """Start at step 0; a rate of 0 is never due."""
        self._period = 1 / (rate_hz * timestep_s) if rate_hz else math.inf
        self._count = 0
        self.next: float = 0.0 if rate_hz else math.inf

    def due(self, step: int) -> bool:
        """Whether the event is due at this step; moves on to the next one if so."""
        if step < self.next:
            return False
        while self.next <= step:
            self._count += 1
            self.next = math.ceil(self._count * self._period - 1e-9)
        return True


class _Rows:
    """Compact rows of times and numbers: a long trip has a million."""

    def __init__(self, columns: int) -> None:
        self._columns, self._times_ns, self._values = columns, array("q"), array("d")

    def add(self, time_ns: int, *values: Array) -> None:
        self._times_ns.append(time_ns)
        for x in values:
            self._values.frombytes(x.tobytes())

    @property
    def table(self) -> tuple[Indices, Array]:
        """Times (K,) int64 and numbers (K, columns) float64."""
        values = np.array(self._values).reshape(len(self._times_ns), self._columns)
        return np.array(self._times_ns), values


class _Log:
    """Samples of the world for cameras, inertial unit and encoders."""

    def __init__(self, world: World, settings: RecordSettings) -> None:
        self._world, self._settings = world, settings
        timestep_s = world.model.opt.timestep
        self._frame_period = 1 / (settings.rig.rate_hz * timestep_s)
        self._half_window = math.ceil(longest_window_s(settings) / 2 / timestep_s - 1e-9)
        self.lead_s = self._half_window * timestep_s
        self._imu = SamplingClock(settings.imu.rate_hz, timestep_s)
        encoders_hz = settings.encoders.rate_hz if world.is_driven else 0
        self._encoders = SamplingClock(encoders_hz, timestep_s)
        self._frames: list[tuple[int, Array, Array]] = []
        self._sample: tuple[bool, bool, int, Array, Array, Array, Array] | None = None
        self._states, self._motions, self._wheels = _Rows(world.model.nq), _Rows(25), _Rows(2)

    @property
    def _frame_step(self) -> int:
        return round(len(self._frames) * self._frame_period)

    def next_step(self, step: int) -> float:
        """Return the next step at which something is to be sampled."""
        open_at = max(step + 1, self._frame_step - self._half_window)
        if step < (len(self._frames) - 1) * self._frame_period + self._half_window:
            open_at = step + 1  # the shutter of the frame just taken is still open
        return min(open_at, self._imu.next, self._encoders.next)

    def take(self, step: int, time_s: float) -> None:
        """Take all samples that are due at this step."""
        world, time_ns = self._world, round(time_s * 1e9)
        to_frame = abs(step - self._frame_step)
        since_frame = step - round((len(self._frames) - 1) * self._frame_period)
        if min(to_frame, since_frame if self._frames else to_frame) <= self._half_window:
            self._states.add(time_ns, world.data.qpos)
        frame, imu = step == self._frame_step, self._imu.due(step)
        if frame or imu:
            motion = body_motion(world, time_s)
            if frame:
                self._frames.append((time_ns, *motion[:2]))
            self._sample = frame, imu, time_ns, *motion, wheel_forces_n(world)
        if self._encoders.due(step):
            self._wheels.add(time_ns, world.wheel_angles_rad)

    def complete_velocity(self) -> None:
        """Centre the velocities of the last sample on its time, one physics step after it."""
        if self._sample is None:
            return
        frame, imu, time_ns, T_world_body, v_world_body, w_world_body, forces = self._sample
        v_world_body, w_world_body = centred_velocity(self._world, v_world_body, w_world_body)
        if frame:
            self._frames[-1] = time_ns, T_world_body, v_world_body
        if imu:
            self._motions.add(time_ns, T_world_body.ravel(), v_world_body, w_world_body, forces)
        self._sample = None

    def trip(self, ended: str) -> Trip:
        """Return all samples, without frames whose exposure was cut off."""
        states, settings = States(*self._states.table), self._settings
        complete = sum(x[0] + self.lead_s * 1e9 <= states.times_ns[-1] + 1 for x in self._frames)
        if complete < 2:
            raise DriveError(ended or "the trip ended before its second frame")
        delivered = stream(settings.seed, "drop").random(complete) >= settings.sensor.drop_share
        delivered[0] = True  # the first frame is never lost
        frames = zip(*self._frames[:complete], strict=True)
        times_ns, T_world_body, v_world_body = (np.array(x) for x in frames)
        motion_ns, values = self._motions.table
        poses, *motions = np.split(values, (16, 19, 22), axis=1)
        motions = Motions(motion_ns, poses.reshape(-1, 4, 4), *(x.copy() for x in motions))
        wheel_ns, angles_rad = self._wheels.table
        counts = ticks(angles_rad, settings.encoders.ticks_per_turn)
        return Trip(
            *(times_ns, delivered, states, T_world_body, v_world_body),
            *(motions, wheel_ns, counts, ended),
        )


def longest_window_s(settings: RecordSettings) -> float:
    """Return the longest exposure of a frame, with readout and both cameras' offset."""
    return (settings.exposure_max_ms + 2 * abs(settings.exposure.right_offset_ms)) * 1e-3
