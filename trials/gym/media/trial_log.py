"""The diary of a trial: enough of what happened to record it as a dataset afterwards."""

from array import array

import numpy as np

from sim.world.trip import Motions, States, Trip, body_motion, wheel_forces_n
from sim.world.world import World
from vo.contract.arrays import Array, Mask


class Diary:
    """Notes of the world wherever physics paused."""

    def __init__(self) -> None:
        self._times_ns = array("q")
        self._qpos: list[Array] = []
        self._motions: list[tuple[int, Array, Array, Array, Array]] = []
        self._frames: list[tuple[int, Array, Array]] = []
        self._read_ns = array("q")
        self._counts: list[tuple[int, int]] = []

    def note(self, world: World, time_ns: int, is_frame: bool, is_regular: bool) -> None:
        """Write down the state of the world and, at regular times, the motion of the body."""
        self._times_ns.append(time_ns)
        self._qpos.append(world.data.qpos.copy())
        if is_frame or is_regular:
            motion = body_motion(world, time_ns * 1e-9)
            if is_frame:
                self._frames.append((time_ns, *motion[:2]))
            if is_regular:
                self._motions.append((time_ns, *motion, wheel_forces_n(world)))

    def read(self, time_ns: int, counts: tuple[int, int]) -> None:
        """Write down a reading of the encoders."""
        self._read_ns.append(time_ns)
        self._counts.append(counts)

    def trip(self, delivered: Mask, ended: str) -> Trip:
        """Return what happened as the recorder knows it.

        Args:
            delivered: (N,) whether the camera kept each frame.
            ended: Why the trial failed; empty if it did not.
        """
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
            np.array(self._read_ns, dtype=np.int64),
            np.array(self._counts, dtype=np.int64),
            ended,
        )
