"""A trip: the rover drives its route once, in physics alone; what it did is then rendered."""

from dataclasses import dataclass

import mujoco
import numpy as np

from sim.drive import CONTROL_RATE_HZ, Driver, plan_path
from sim.encoders import Encoders
from sim.settings import RecordSettings
from sim.world import World
from vo.contract.arrays import Array, Indices

START_NS = 1_000_000_000
"""Time of the first frame; the second before it belongs to the rover's settling."""
REST_S = 0.4
"""How long the recording goes on after the rover arrived."""


@dataclass(frozen=True)
class Trip:
    """States at the middle of each frame's exposure, and the readings between them.

    Attributes:
        timestamps_ns: (N,) of the frames.
        qpos: (N, nq) joint positions of the whole world.
        T_world_body: (N, 4, 4) rover poses.
        v_world_body: (N, 3) velocity of the body origin in world axes, m/s.
        wheel_times_ns: (M,) of the encoder readings.
        wheel_counts: (M, 2) ticks left and right.
    """

    timestamps_ns: Indices
    qpos: Array
    T_world_body: Array
    v_world_body: Array
    wheel_times_ns: Indices
    wheel_counts: Indices

    def __len__(self) -> int:
        return len(self.timestamps_ns)

    @property
    def length_m(self) -> float:
        """Of the path of the body origin through the frames."""
        steps = np.diff(self.T_world_body[:, :3, 3], axis=0)
        return float(np.linalg.norm(steps, axis=1).sum())


def drive_trip(world: World, settings: RecordSettings) -> Trip:
    """Let the rover settle, then drive the whole path; deterministic.

    Raises:
        DriveError: If the rover tips over or gets stuck.
        SettingsError: If the route is too short for the distance asked for.
    """
    driver = Driver(plan_path(world.route, settings.drive.distance_m), settings.drive)
    encoders = Encoders(settings.encoders.ticks_per_turn, settings.encoders.rate_hz)
    timestep_s = world.model.opt.timestep
    mujoco.mj_step(world.model, world.data, round(START_NS * 1e-9 / timestep_s))

    frames: list[tuple[int, Array, Array, Array]] = []
    step, frame_step, control_step, last_step = 0, 0, 0, None
    steps_per_control = round(1 / (CONTROL_RATE_HZ * timestep_s))
    while True:
        time_ns = START_NS + round(step * timestep_s * 1e9)
        if step == control_step:
            world.command_wheels(driver.command(world.T_world_body, time_ns * 1e-9))
            control_step += steps_per_control
        if step == encoders.next_step(timestep_s):
            encoders.read(time_ns, world.wheel_angles_rad)
        if step == frame_step:
            frames.append((time_ns, world.data.qpos.copy(), world.T_world_body, world.v_world_body))
            frame_step += world.steps_per_frame
            if driver.arrived and last_step is None:
                last_step = step + round(REST_S / timestep_s)
            if last_step is not None and step >= last_step:
                break
        until = min(frame_step, control_step, encoders.next_step(timestep_s))
        mujoco.mj_step(world.model, world.data, until - step)
        step = until
    times, qpos, poses, velocities = zip(*frames, strict=True)
    return Trip(
        np.array(times, dtype=np.int64),
        np.array(qpos),
        np.array(poses),
        np.array(velocities),
        np.array(encoders.times_ns, dtype=np.int64),
        np.array(encoders.counts, dtype=np.int64),
    )
