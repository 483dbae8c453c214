"""Inertial readings: strapdown integration returns the motion, noise has the stated densities."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.sensors.inertial import ImuReadings, ideal_readings, imu_states, integrate, with_noise
from sim.settings import ImuSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices

GRAVITY: Array = np.array([0.0, 0.0, -9.81])
PERIOD_NS = 5_000_000
T_BODY_IMU = se3.exp(np.array([0.06, -0.02, 0.42, 0.3, -0.2, 0.1]))


def smooth(times_s: Array) -> tuple[Array, Array, Array]:
    """T_world_body, v and w in world axes of a swaying, turning, climbing body, in closed form."""
    t = times_s[:, None]
    amplitude, rate = np.array([0.5, 0.3, 0.1]), np.array([1.1, 1.7, 2.3])
    p = amplitude * np.sin(rate * t) + np.array([0.3, 0, 0.05]) * t
    v = amplitude * rate * np.cos(rate * t) + np.array([0.3, 0, 0.05])
    yaw, roll = 0.8 * np.sin(1.3 * times_s), 0.2 * np.cos(2.9 * times_s)
    R_yaw = Rotation.from_rotvec(np.outer(yaw, [0, 0, 1]))
    R = (R_yaw * Rotation.from_rotvec(np.outer(roll, [1, 0, 0]))).as_matrix()
    w = np.outer(0.8 * 1.3 * np.cos(1.3 * times_s), [0, 0, 1])
    w = w + R_yaw.apply(np.outer(-0.2 * 2.9 * np.sin(2.9 * times_s), [1, 0, 0]))
    return se3.pose(R, p), v, w


def jerky(steps: int, step_s: float, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """A body hit at random, by 10 m/s^2 and 80 rad/s^2 for a step, but pulled back: it rattles.

    Semi-implicit Euler, as a physics engine integrates.
    """
    T, v, w = np.empty((steps, 4, 4)), np.zeros((steps, 3)), np.zeros((steps, 3))
    R, p = Rotation.identity(), np.zeros(3)
    T[0] = np.eye(4)
    for k in range(1, steps):
        hit = rng.random() < 0.2
        kick, spin = 10.0 * hit * rng.standard_normal(3), 80.0 * hit * rng.standard_normal(3)
        v[k] = v[k - 1] + step_s * (kick - 20 * v[k - 1] - 100 * p)
        w[k] = w[k - 1] + step_s * (spin - 20 * w[k - 1] - 100 * R.as_rotvec())
        p = p + step_s * v[k]
        R = Rotation.from_rotvec(step_s * w[k]) * R
        T[k] = se3.pose(R.as_matrix(), p)
    return T, v, w


def regular(count: int) -> Indices:
    return np.arange(count, dtype=np.int64) * PERIOD_NS


def error_after(
    readings: ImuReadings, T_world_imu: Array, v_world_imu: Array
) -> tuple[float, float]:
    """Metres and degrees between the integrated and the true last pose."""
    T, v = integrate(readings, T_world_imu[0], v_world_imu[0], GRAVITY)
    assert T.shape == T_world_imu.shape
    np.testing.assert_allclose(v, v_world_imu, atol=1e-9)
    error = se3.inverse(T_world_imu[-1]) @ T[-1]
    return float(np.linalg.norm(error[:3, 3])), float(np.degrees(se3.rotation_angle(error)))


def test_readings_at_rest_are_gravity():
    T_world_body = np.broadcast_to(se3.exp(np.array([1.0, 2, 3, 0.1, 0.2, 0.3])), (4, 4, 4))
    still = np.zeros((4, 3))
    readings = ideal_readings(regular(4), T_world_body, still, still, T_BODY_IMU, GRAVITY)
    assert readings.times_ns.tolist() == [2_500_000, 7_500_000, 12_500_000]
    np.testing.assert_allclose(readings.gyro_radps, 0, atol=1e-9)
    up_imu = (T_world_body[0] @ T_BODY_IMU)[:3, :3].T @ -GRAVITY
    np.testing.assert_allclose(readings.accel_mps2, np.tile(up_imu, (3, 1)), atol=1e-9)


def test_readings_on_a_turntable_are_rate_and_centripetal():
    times_ns = regular(201)
    turn = 2.0 * times_ns[:, None] * 1e-9 * np.array([0, 0, 1.0])
    T = se3.pose(Rotation.from_rotvec(turn).as_matrix(), np.zeros(3))
    w = np.tile([0.0, 0, 2.0], (201, 1))
    arm = se3.pose(np.eye(3), np.array([0.3, 0.0, 0.1]))
    readings = ideal_readings(times_ns, T, np.zeros((201, 3)), w, arm, GRAVITY)
    np.testing.assert_allclose(readings.gyro_radps, w[1:], atol=1e-9)
    expected = np.tile([-0.3 * 2.0**2, 0, 9.81], (200, 1))
    np.testing.assert_allclose(readings.accel_mps2, expected, atol=1e-4)


def test_readings_of_smooth_motion_are_its_derivatives():
    times_ns = regular(401)
    T, v, w = smooth(times_ns * 1e-9)
    readings = ideal_readings(times_ns, T, v, w, T_BODY_IMU, GRAVITY)
    middle_s, h = readings.times_ns * 1e-9, 1e-4
    before, now, after = (imu_states(*smooth(middle_s + dt), T_BODY_IMU) for dt in (-h, 0.0, h))
    R_imu_world = now[0][:, :3, :3].transpose(0, 2, 1)
    force = (after[1] - before[1]) / (2 * h) - GRAVITY
    force_imu = np.einsum("nij,nj->ni", R_imu_world, force)
    np.testing.assert_allclose(readings.accel_mps2, force_imu, atol=2e-3)
    w_imu = np.einsum("nij,nj->ni", R_imu_world, smooth(middle_s)[2])
    np.testing.assert_allclose(readings.gyro_radps, w_imu, atol=1e-4)


def test_imu_velocity_is_the_derivative_of_position():
    t, h = np.linspace(0, 3, 50), 1e-5
    _, v = imu_states(*smooth(t), T_BODY_IMU)
    ahead, behind = (imu_states(*smooth(t + dt), T_BODY_IMU)[0][:, :3, 3] for dt in (h, -h))
    np.testing.assert_allclose(v, (ahead - behind) / (2 * h), atol=1e-7)


def test_integrate_returns_a_smooth_motion():
    times_ns = regular(1001)
    T, v, w = smooth(times_ns * 1e-9)
    readings = ideal_readings(times_ns, T, v, w, T_BODY_IMU, GRAVITY)
    drift_m, turn_deg = error_after(readings, *imu_states(T, v, w, T_BODY_IMU))
    assert drift_m < 1e-3
    assert turn_deg < 5e-3


@pytest.mark.parametrize("seed", range(4))
def test_integrate_returns_a_rough_motion(seed: int):
    T, v, w = jerky(5001, 1e-3, np.random.default_rng(seed))
    T, v, w = T[::5], v[::5], w[::5]
    readings = ideal_readings(regular(1001), T, v, w, T_BODY_IMU, GRAVITY)
    assert readings.accel_mps2.std(axis=0).max() > 5  # rough indeed
    drift_m, turn_deg = error_after(readings, *imu_states(T, v, w, T_BODY_IMU))
    assert 1e-6 < drift_m < 0.01
    assert turn_deg < 0.05


def test_integrate_irregular_times_is_exact():
    rng = np.random.default_rng(5)
    times_ns = np.cumsum(rng.integers(3_000_000, 7_000_000, 801))
    T, v, w = smooth(times_ns * 1e-9)
    readings = ideal_readings(times_ns, T, v, w, T_BODY_IMU, GRAVITY)
    drift_m, turn_deg = error_after(readings, *imu_states(T, v, w, T_BODY_IMU))
    assert drift_m < 1e-3
    assert turn_deg < 5e-3


def test_readings_times_not_increasing_are_refused():
    T, still = np.broadcast_to(np.eye(4), (3, 4, 4)), np.zeros((3, 3))
    with pytest.raises(ValueError, match="increase"):
        ideal_readings(np.array([0, 5, 5]), T, still, still, np.eye(4), GRAVITY)


def rest(count: int) -> ImuReadings:
    zeros = np.zeros((count, 3))
    periods = np.full(count, PERIOD_NS)
    return ImuReadings(regular(count) + PERIOD_NS // 2, periods, zeros, zeros)


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_noise_has_its_density_and_bias_its_walk(scale: float):
    """The mean over 1 s keeps the density; differences of bias over n steps grow as sqrt(n)."""
    settings = ImuSettings(noise=scale)
    readings, biases = with_noise(rest(200_000), settings, np.random.default_rng(6))
    groups = (
        (readings.gyro_radps, biases[:, :3], settings.gyroscope_noise_density,
         settings.gyroscope_random_walk),
        (readings.accel_mps2, biases[:, 3:], settings.accelerometer_noise_density,
         settings.accelerometer_random_walk),
    )  # fmt: skip
    for values, bias, density, walk in groups:
        white = values - bias
        assert white.std() == pytest.approx(scale * density * np.sqrt(200), rel=0.01)
        assert white.reshape(1000, 200, 3).mean(axis=1).std() == pytest.approx(
            scale * density, rel=0.06
        )
        assert (bias[0] == 0).all()
        for steps in (1, 20):
            differences = bias[steps::steps] - bias[:-steps:steps]
            expected = scale * walk * np.sqrt(steps / 200)
            assert differences.std() == pytest.approx(expected, rel=0.04)
        assert abs(np.corrcoef(white[:, 0], white[:, 1])[0, 1]) < 0.01


def test_noise_of_zero_is_perfect_and_noise_repeats():
    perfect, biases = with_noise(rest(50), ImuSettings(noise=0), np.random.default_rng(7))
    assert not perfect.gyro_radps.any()
    assert not biases[:, 3:].any()
    once, again = (
        with_noise(rest(50), ImuSettings(), np.random.default_rng(8))[0] for _ in range(2)
    )
    np.testing.assert_array_equal(once.accel_mps2, again.accel_mps2)
