"""Log of a trial, from which it can be recorded as a dataset afterwards."""

from array import array

import numpy as np

from sim.world.trip import Motions, States, Trip, body_motion, wheel_forces_n
from sim.world.world import World
from vo.contract.arrays import Array, Mask


class TrialLog:
    """States of the world wherever physics paused."""

    def __init__(self) -> None:
        self._times_ns = array("q")
        self._qpos: list[Array] = []
        self._motions: list[tuple[int, Array, Array, Array, Array]] = []
        self._frames: list[tuple[int, Array, Array]] = []
        self._ticks_ns = array("q")
        self._ticks: list[tuple[int, int]] = []

    def add_state(self, world: World, time_ns: int, is_frame: bool, is_regular: bool) -> None:
        """Add the state of the world and, at regular times, the motion of the body."""
        self._times_ns.append(time_ns)
        self._qpos.append(world.data.qpos.copy())
        if is_frame or is_regular:
            motion = body_motion(world, time_ns * 1e-9)
            if is_frame:
                self._frames.append((time_ns, *motion[:2]))
            if is_regular:
                self._motions.append((time_ns, *motion, wheel_forces_n(world)))

    def add_wheel_ticks(self, time_ns: int, ticks: tuple[int, int]) -> None:
        """Add a reading of the wheel encoders."""
        self._ticks_ns.append(time_ns)
        self._ticks.append(ticks)

    def trip(self, delivered: Mask, ended: str) -> Trip:
        """Return the drive in the recorder's form; `delivered` (N,) is that of the camera."""
        frame_ns, T_world_body, v_world_body = (
            np.array(x) for x in zip(*self._frames, strict=True)
        )
        return Trip(
            frame_ns,
            delivered,
            States(np.array(self._times_ns, dtype=np.int64), np.array(self._qpos)),
            T_world_body,
            v_world_body,
            Motions(*(np.array(x) for x in zip(*self._motions, strict=True))),
            np.array(self._ticks_ns, dtype=np.int64),
            np.array(self._ticks, dtype=np.int64),
            ended,
        )
