"""Inertial measurement unit: mean rates of every step, with white noise and a bias random walk."""

import numpy as np

from sim.sensors.inertial import GRAVITY_MPS2, T_body_imu, ideal_readings
from sim.settings import ImuSettings
from sim.world.trip import body_motion
from sim.world.world import World
from vo.contract.arrays import Array

GYRO_MAX_RADPS, ACCEL_MAX_MPS2 = 35.0, 160.0
"""Measurement range; values beyond are clipped."""


class InertialUnit:
    """Measures the mean rates since the previous reading."""

    def __init__(self, settings: ImuSettings, rng: np.random.Generator) -> None:
        self._settings, self._rng = settings, rng
        self._T_body_imu = T_body_imu(settings)
        self._before: tuple[int, Array, Array, Array] | None = None
        self._bias = np.zeros(6)

    def read(self, world: World, time_s: float) -> Array:
        """(6,) angular velocity, rad/s, and specific force, m/s^2, in the axes of the unit.

        The first reading is that of a unit at rest on level ground, without noise.
        """
        now = (round(time_s * 1e9), *body_motion(world, time_s))
        before, self._before = self._before, now
        if before is None:
            R_world_imu = now[1][:3, :3] @ self._T_body_imu[:3, :3]
            return np.concatenate([np.zeros(3), -GRAVITY_MPS2 @ R_world_imu])
        times_ns, *states = (np.array(pair) for pair in zip(before, now, strict=True))
        T, v, w = states
        ideal = ideal_readings(times_ns, T, v, w, self._T_body_imu, GRAVITY_MPS2)
        s, dt = self._settings, float(times_ns[1] - times_ns[0]) * 1e-9
        densities = np.repeat([s.gyroscope_noise_density, s.accelerometer_noise_density], 3)
        walks = np.repeat([s.gyroscope_random_walk, s.accelerometer_random_walk], 3)
        white = densities / dt**0.5 * self._rng.standard_normal(6)
        reading = np.concatenate([ideal.gyro_radps[0], ideal.accel_mps2[0]])
        reading = reading + s.noise * white + self._bias
        self._bias = self._bias + s.noise * walks * dt**0.5 * self._rng.standard_normal(6)
        limits = np.repeat([GYRO_MAX_RADPS, ACCEL_MAX_MPS2], 3)
        return np.clip(reading, -limits, limits)
