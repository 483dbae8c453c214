"""Paths and the driver's decisions, without physics."""

import math

import numpy as np
import pytest

from sim.settings import DriveSettings
from sim.world.drive import DriveError, Driver, wheel_speeds
from sim.world.path import plan_path
from sim.world.rover import TRACK_M, WHEEL_RADIUS_M
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError

SQUARE = np.array([[0.0, 0], [2, 0], [2, 2], [0, 2], [0, 0]])


def _pose(x: float, y: float, yaw: float = 0.0) -> Array:
    R = se3.exp(np.array([0, 0, 0, 0, 0, yaw]))[:3, :3]
    return se3.pose(R, np.array([x, y, 0.05]))


def test_plan_path_cuts_to_the_distance():
    path = plan_path(SQUARE, 3.0)
    assert path.length_m == pytest.approx(3.0)
    np.testing.assert_allclose(path.waypoints[-1], [2, 1])
    np.testing.assert_allclose(path.at(np.array([-1.0, 1.0, 9.0])), [[0, 0], [1, 0], [2, 1]])


def test_plan_path_repeats_a_closed_route():
    path = plan_path(SQUARE, 17.0)
    assert path.length_m == pytest.approx(17.0)
    np.testing.assert_allclose(path.waypoints[-1], [1, 0])


def test_plan_path_open_route_too_short_is_refused():
    with pytest.raises(SettingsError, match=r"drive\.distance_m: 9 m.*open and 4\.0 m long"):
        plan_path(SQUARE[:3], 9.0)


def test_plan_path_equal_points_are_refused():
    path = plan_path(np.array([[0.0, 0], [0, 0], [0, 1], [0, 1], [0, 3]]), None)
    np.testing.assert_array_equal(path.waypoints, [[0, 0], [0, 1], [0, 3]])
    with pytest.raises(SettingsError, match=r"drive\.waypoints: all points are the same"):
        plan_path(np.array([[1.0, 2], [1, 2]]), None)


def test_wheel_speeds_of_a_turn():
    left, right = wheel_speeds(0.3, 0.5)
    assert (left + right) / 2 * WHEEL_RADIUS_M == pytest.approx(0.3)
    assert (right - left) * WHEEL_RADIUS_M / TRACK_M == pytest.approx(0.5)


def test_driver_steers_to_the_path_and_accelerates():
    driver = Driver(plan_path(SQUARE, None), DriveSettings())
    for yaw, side in ((0.3, -1), (-0.3, 1)):
        left, right = driver.command(_pose(0.2, 0.0, yaw), 0.0)
        assert np.sign(right - left) == side
    speeds = [driver.command(_pose(0.2, 0.0), 0.0).mean() * WHEEL_RADIUS_M for _ in range(100)]
    assert np.all(np.diff(speeds) <= 0.3 / 50 + 1e-9)
    assert speeds[-1] == pytest.approx(0.3)


def test_driver_with_path_behind_turns_on_the_spot():
    left, right = Driver(plan_path(SQUARE, None), DriveSettings()).command(_pose(0, 0, 3.0), 0.0)
    assert left == -right
    assert abs(right - left) * WHEEL_RADIUS_M / TRACK_M == pytest.approx(math.radians(40))


def test_driver_stops_at_the_end():
    driver = Driver(plan_path(SQUARE[:2], None), DriveSettings(lookahead_m=2.0))
    np.testing.assert_array_equal(driver.command(_pose(2.0, 0.0), 0.0), [0, 0])
    assert driver.arrived


def test_driver_of_tipped_rover_raises():
    driver = Driver(plan_path(SQUARE, None), DriveSettings())
    lying = se3.exp(np.array([0, 0, 0, math.radians(80), 0, 0]))
    with pytest.raises(DriveError, match=r"tipped over at 12\.50 s near \(0\.00, 0\.00\) m"):
        driver.command(lying, 12.5)
