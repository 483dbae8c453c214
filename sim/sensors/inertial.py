"""Inertial readings from true motion: exact means over each interval, then noise and bias."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from sim.settings import ImuSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices

EARTH_GRAVITY_MPS2 = (0.0, 0.0, -9.81)
"""Gravity in world axes of scenes that do not set another one, as in MuJoCo."""


@dataclass(frozen=True)
class ImuReadings:
    """Strapdown measurements in the unit's axes: one mean per interval between states.

    Attributes:
        times_ns: (N,) middle of each interval.
        intervals_ns: (N,) length of each interval.
        gyro_radps: (N, 3) mean angular velocity: the turn over the interval by its length.
        accel_mps2: (N, 3) mean specific force, in the axes at the middle of the turn.
    """

    times_ns: Indices
    intervals_ns: Indices
    gyro_radps: Array
    accel_mps2: Array


def T_body_imu(settings: ImuSettings) -> Array:
    """(4, 4) pose of the inertial unit in the body frame."""
    R = Rotation.from_euler("xyz", settings.rpy_deg, degrees=True).as_matrix()
    return se3.pose(R, np.array(settings.position_m))


def imu_states(
    T_world_body: Array, v_world_body: Array, w_world_body: Array, T_body_imu: Array
) -> tuple[Array, Array]:
    """Move states (K, ...) to the unit: T_world_imu, and v_world_imu = v + w x R_world_body r."""
    arm_world = T_world_body[:, :3, :3] @ T_body_imu[:3, 3]
    return T_world_body @ T_body_imu, v_world_body + np.cross(w_world_body, arm_world)


def ideal_readings(
    times_ns: Indices,
    T_world_body: Array,
    v_world_body: Array,
    w_world_body: Array,
    T_body_imu: Array,
    gravity_mps2: Array,
) -> ImuReadings:
    """Return the K - 1 perfect readings of a unit that integrates within each interval.

    Turn and change of velocity over each interval are those of the states, so that `integrate`
    returns every orientation and velocity exactly, whatever shocks lie between. Positions follow by
    the trapezoidal rule; they drift only where the force changes within an interval.

    At times (K,), the body has poses (K, 4, 4), velocities of its origin (K, 3) m/s and angular
    velocities (K, 3) rad/s in world axes; T_body_imu (4, 4) is the unit in its frame.

    Raises:
        ValueError: If times do not increase.
    """
    intervals_ns = np.diff(times_ns)
    if (intervals_ns <= 0).any():
        raise ValueError("times of inertial states must increase")
    dt = intervals_ns[:, None] * 1e-9
    T_world_imu, v_world_imu = imu_states(T_world_body, v_world_body, w_world_body, T_body_imu)
    R = Rotation.from_matrix(T_world_imu[:, :3, :3])
    turn = (R[:-1].inv() * R[1:]).as_rotvec()
    R_world_mid = R[:-1] * Rotation.from_rotvec(turn / 2)
    force_world = np.diff(v_world_imu, axis=0) / dt - gravity_mps2
    middles_ns = times_ns[:-1] + intervals_ns // 2
    return ImuReadings(middles_ns, intervals_ns, turn / dt, R_world_mid.inv().apply(force_world))


def with_noise(
    readings: ImuReadings, settings: ImuSettings, rng: np.random.Generator
) -> tuple[ImuReadings, Array]:
    """Add white noise of the given densities and biases (N, 6) that walk, starting at zero.

    Source: Trawny and Roumeliotis, Indirect Kalman filter for 3D attitude estimation, 2005, eqs. 93
    and 96: a discrete deviation of density / sqrt(dt), a step of the bias of walk * sqrt(dt).
    """
    root_dt = np.sqrt(readings.intervals_ns * 1e-9)[:, None]
    n = len(root_dt)

    def disturb(ideal: Array, density: float, walk: float) -> tuple[Array, Array]:
        white = settings.noise * density / root_dt * rng.standard_normal((n, 3))
        steps = settings.noise * walk * root_dt * rng.standard_normal((n, 3))
        bias = np.cumsum(steps, axis=0) - steps[:1]
        return ideal + (bias + white), bias

    gyroscope = settings.gyroscope_noise_density, settings.gyroscope_random_walk
    gyro, gyro_bias = disturb(readings.gyro_radps, *gyroscope)
    accelerometer = settings.accelerometer_noise_density, settings.accelerometer_random_walk
    accel, accel_bias = disturb(readings.accel_mps2, *accelerometer)
    noisy = replace(readings, gyro_radps=gyro, accel_mps2=accel)
    return noisy, np.hstack([gyro_bias, accel_bias])


def integrate(
    readings: ImuReadings, T_world_imu: Array, v_world_imu: Array, gravity_mps2: Array
) -> tuple[Array, Array]:
    """Integrate N readings (strapdown dead reckoning) from a known start, in world axes.

    T_world_imu is (N + 1, 4, 4) and v_world_imu (N + 1, 3) m/s at the intervals' ends.

    Source: Savage, Strapdown inertial navigation integration algorithm design, 1998, with the force
    turned by half the interval's turn and the trapezoidal rule for position.
    """
    dt = (readings.intervals_ns * 1e-9)[:, None]
    half_turn = Rotation.from_rotvec(readings.gyro_radps * dt / 2)
    half, whole = half_turn.as_matrix(), (half_turn * half_turn).as_matrix()
    R = np.empty((len(dt) + 1, 3, 3))
    R[0] = T_world_imu[:3, :3]
    for k in range(len(dt)):
        R[k + 1] = R[k] @ whole[k]
    gain = ((R[:-1] @ half) @ readings.accel_mps2[..., None])[..., 0] + gravity_mps2
    v = np.concatenate([[v_world_imu], v_world_imu + np.cumsum(gain * dt, axis=0)])
    moved = np.cumsum((v[:-1] + v[1:]) / 2 * dt, axis=0)
    p = np.concatenate([[np.zeros(3)], moved]) + T_world_imu[:3, 3]
    return se3.pose(R, p), v
