"""The simulation: a rover in a world, moved on from one step of control to the next."""

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from sim.sensors.wheel_encoders import ticks
from sim.settings import RecordSettings
from sim.world.rover import BODY, PREFIX, WHEEL_RADIUS_M, WHEELS
from sim.world.trip import MOVER_PERIOD_S, States, longest_window_s
from sim.world.world import START_CLEARANCE_M, START_S, World
from trials.gym.media.trial_log import Diary
from trials.gym.world.dynamic_agents import Reacting
from trials.gym.world.free_space import hard, solid
from vo.contract.arrays import Array, Mask

TIMESTEP_MAX_S = 0.0025
"""A contact of the tyres has a time constant of 10 ms; a recording takes 1 ms."""
COMMAND_PERIOD_S = 0.02
"""The wheels' wanted speeds are ramped, and contacts looked for, at least so often."""
SETTLING_S = 1.0
PUSHED_M = 0.05
"""Further than this no rover settles by itself."""


@dataclass(frozen=True)
class Moment:
    """What is true in the middle of an exposure.

    Attributes:
        time_ns: Of the middle.
        T_world_body: (4, 4).
        wheel_ticks: Of both encoders.
    """

    time_ns: int
    T_world_body: Array
    wheel_ticks: tuple[int, int]


class Simulation:
    """Physics alone. An exposure, where there is one, ends with the step.

    Attributes:
        world: Its data is the state.
        window: States of the world while the shutter was open last; filled anew at every step.
        moment: Middle of the last exposure.
        diary: Of the present trial, if one is kept.
        regular: Physics steps of a step of control at which commands change.
        touched: (ngeom,) what the rover touched during the last step.
        solid: (ngeom,) what it can bump into.
        hard: (ngeom,) of that, what does not give way.
    """

    def __init__(self, world: World, settings: RecordSettings, acceleration_mps2: float) -> None:
        """Take over a world.

        Args:
            world: Gets another time step.
            settings: Resolved; `rig.rate_hz` is the rate of steps.
            acceleration_mps2: Of a wheel's rim, at most.
        """
        self.world = world
        self.diary: Diary | None = None
        self._settings = settings
        period_s = 1 / settings.rig.rate_hz
        self._steps = math.ceil(period_s / TIMESTEP_MAX_S - 1e-9)
        self.timestep_s = world.model.opt.timestep = period_s / self._steps
        self._ramp = acceleration_mps2 * self.timestep_s / WHEEL_RADIUS_M
        open_s = longest_window_s(settings) if settings.exposure.time_ms else 0.0
        if settings.sensor.auto_exposure:
            open_s = longest_window_s(settings)
        half = math.ceil(open_s / 2 / self.timestep_s - 1e-9)
        self._window = min(2 * half, self._steps)
        self.window = States(
            np.zeros(self._window + 1, np.int64), np.zeros((self._window + 1, world.model.nq))
        )
        longest_s = MOVER_PERIOD_S if world.movers else COMMAND_PERIOD_S
        chunks = math.ceil(period_s / longest_s - 1e-9)
        self.regular = {round(k * self._steps / chunks) for k in range(1, chunks + 1)}
        fine = set(range(self._steps - self._window, self._steps + 1))
        self._stops = tuple(sorted((self.regular | fine) - {0}))
        self._middle = self._steps - self._window // 2
        model = world.model
        self._mine = model.body_rootid[model.geom_bodyid] == model.body(BODY).rootid[0]
        self._actuators = [model.actuator(name).id for name in WHEELS]
        self._wheels = [model.joint(name).qposadr[0] for name in WHEELS]
        self._free = model.joint(PREFIX + "free").qposadr[0]
        self.solid: Mask = solid(world)
        self.hard: Mask = hard(world)
        self._reacting = [m for m in world.movers.values() if isinstance(m, Reacting)]
        self.reset(np.array([*world.path.waypoints[0], 0.0]))

    @property
    def time_s(self) -> float:
        """Of the world, now; a trial begins at START_S."""
        return START_S + self._count * self.timestep_s

    @property
    def place(self) -> tuple[float, float, float]:
        """True x, y in metres and yaw in radians of the chassis."""
        x, y, _, qw, qx, qy, qz = self.world.data.qpos[self._free : self._free + 7].tolist()
        return x, y, math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))

    @property
    def upright(self) -> float:
        """Cosine of the angle between the chassis' vertical and the world's."""
        _, qx, qy, _ = self.world.data.qpos[self._free + 3 : self._free + 7].tolist()
        return 1 - 2 * (qx * qx + qy * qy)

    @property
    def wheel_ticks(self) -> tuple[int, int]:
        """Counts of both encoders, forward positive."""
        angles = self.world.data.qpos[self._wheels]
        left, right = ticks(angles, self._settings.encoders.ticks_per_turn)
        return int(left), int(right)

    def reset(self, start: Array, diary: Diary | None = None) -> bool:
        """Put everything to its beginning, and let the rover settle.

        Something that moves by itself may be where the rover is put.

        Args:
            start: (3,) x, y in metres and yaw in radians.
            diary: For what happens from the step of the first picture on.

        Returns:
            Whether the rover stands where it was put, and nothing touches it.
        """
        world, data = self.world, self.world.data
        mujoco.mj_resetData(world.model, data)
        height = float(world.scene.elevation(start[:2])) + WHEEL_RADIUS_M + START_CLEARANCE_M
        yaw = float(start[2])
        quat = math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)
        data.qpos[self._free : self._free + 7] = (*start[:2], height, *quat)
        self._speeds = np.zeros(2)
        self.touched = np.zeros(world.model.ngeom, bool)
        periods = math.ceil(SETTLING_S / (self._steps * self.timestep_s))
        self._count = -periods * self._steps
        for mover in self._reacting:
            mover.begin()
        world.move_movers(self.time_s)
        mujoco.mj_step(world.model, data, (periods - 1) * self._steps)
        self._count = -self._steps
        self.diary = diary
        self.advance(np.zeros(2))
        x, y, _ = self.place
        pushed = math.hypot(x - start[0], y - start[1]) > PUSHED_M
        alone = not pushed and not (self.touched & self.hard).any()
        self.touched[:] = False
        return alone

    def advance(self, speeds_radps: Array) -> None:
        """Go on by one step of control.

        Args:
            speeds_radps: (2,) wanted of the left and the right wheel; ramped towards.
        """
        world, model, data = self.world, self.world.model, self.world.data
        self.touched[:] = False
        done = 0
        for stop in self._stops:
            if world.movers:
                world.move_movers(self.time_s)
            reach = self._ramp * (stop - done)
            self._speeds = self._speeds + np.clip(speeds_radps - self._speeds, -reach, reach)
            data.ctrl[self._actuators] = self._speeds
            mujoco.mj_step(model, data, stop - done)
            self._count += stop - done
            done = stop
            for mover in self._reacting:
                mover.react(self.time_s, np.array(self.place[:2]))
            self._feel()
            if stop >= self._steps - self._window:
                k = stop - (self._steps - self._window)
                self.window.times_ns[k] = round(self.time_s * 1e9)
                self.window.qpos[k] = data.qpos
            if stop == self._middle:
                self.moment = self._moment()
            if self.diary:
                times = stop == self._middle, stop in self.regular
                self.diary.note(world, round(self.time_s * 1e9), *times)
        if self.diary:
            self.diary.read(self.moment.time_ns, self.moment.wheel_ticks)

    def _moment(self) -> Moment:
        world = self.world
        world.place_bodies()
        return Moment(round(self.time_s * 1e9), world.T_world_body, self.wheel_ticks)

    def _feel(self) -> None:
        """Remember what touches the rover now."""
        if self.world.data.ncon:
            pairs = self.world.data.contact.geom
            mine = self._mine[pairs]
            self.touched[pairs[mine[:, ::-1] & ~mine]] = True
