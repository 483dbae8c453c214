"""Pure pursuit and the dynamic window against closed forms, and both on drives."""

import math

import numpy as np
import pytest

from trials.navigation.occupancy_grid import (
    OccupancySettings,
    clearance_m,
    driving_costs,
    empty_grid,
)
from trials.navigation.planner import GridPlanner
from trials.navigation.steering import (
    Pose2,
    SteeringSettings,
    Twist,
    dynamic_window,
    lookahead_point,
    pure_pursuit,
)

SETTINGS = SteeringSettings()
ORIGIN = Pose2(0.0, 0.0, 0.0)
RADIUS_M = 0.3


def drive(pose, twist, period_s=SETTINGS.period_s):
    """Move along the arc of constant speeds, in small straight steps."""
    x, y, yaw = pose
    for _ in range(100):
        x += twist.forward_mps * math.cos(yaw) * period_s / 100
        y += twist.forward_mps * math.sin(yaw) * period_s / 100
        yaw += twist.turn_radps * period_s / 100
    return Pose2(x, y, yaw)


def world(*blocks):
    grid = empty_grid((-2, 6), (-3, 3), 0.05)
    for x_m, y_m in blocks:
        grid.log_odds[grid.cell(x_m, y_m)] = 4.0
    return grid, clearance_m(grid, OccupancySettings()) - RADIUS_M


def test_lookahead_point_is_on_the_path_at_most_at_its_end():
    path = np.array([[0.0, 0], [1, 0], [1, 2]])
    np.testing.assert_allclose(lookahead_point(Pose2(0.5, 0.3, 0), path, 0.2), [0.7, 0])
    np.testing.assert_allclose(lookahead_point(Pose2(0.5, 0.3, 0), path, 1.0), [1, 0.5])
    np.testing.assert_allclose(lookahead_point(Pose2(0.5, 0.3, 0), path, 99), [1, 2])
    np.testing.assert_allclose(lookahead_point(ORIGIN, path[2:], 1.0), [1, 2])
    doubled = np.repeat(path, 2, axis=0)
    np.testing.assert_allclose(lookahead_point(Pose2(0.5, 0.3, 0), doubled, 1.0), [1, 0.5])


def test_pure_pursuit_drives_the_arc_through_the_target():
    path = np.array([[0.4, 0.3]])
    twist = pure_pursuit(ORIGIN, path, SETTINGS)
    # The circle through the origin, along x, and through (0.4, 0.3): radius 0.25 / 0.6.
    assert twist.turn_radps / twist.forward_mps == pytest.approx(0.6 / 0.25)
    angle = 2 * math.atan2(0.3, 0.4)
    end = drive(ORIGIN, twist, angle / twist.turn_radps)
    assert (end.x_m, end.y_m) == pytest.approx((0.4, 0.3), abs=5e-3)


def test_pure_pursuit_keeps_the_limits():
    assert pure_pursuit(ORIGIN, np.array([[0.0, 0], [5, 0]]), SETTINGS) == (0.5, 0.0)
    sharp = pure_pursuit(ORIGIN, np.array([[0.06, 0.09]]), SETTINGS)
    assert sharp.turn_radps == pytest.approx(SETTINGS.turn_max_radps)
    assert 0 < sharp.forward_mps < 0.1
    assert pure_pursuit(ORIGIN, np.array([[-1, 0.2]]), SETTINGS) == (0.0, 1.0)
    assert pure_pursuit(ORIGIN, np.array([[-1, -0.2]]), SETTINGS) == (0.0, -1.0)
    assert pure_pursuit(ORIGIN, np.array([[0.0, 0.0]]), SETTINGS) == (0.0, 0.0)


def test_pure_pursuit_follows_a_corner_to_the_end():
    path = np.array([[0.0, 0], [2, 0], [2, 2]])
    pose, strayed = Pose2(0.0, 0.1, 2.0), []
    for _ in range(200):
        pose = drive(pose, pure_pursuit(pose, path, SETTINGS))
        strayed.append(min(abs(pose.y_m), abs(pose.x_m - 2)))
        if math.hypot(pose.x_m - 2, pose.y_m - 2) < 0.1:
            break
    assert math.hypot(pose.x_m - 2, pose.y_m - 2) < 0.1
    assert 0.05 < max(strayed) < 0.3


def test_dynamic_window_accelerates_in_free_space():
    grid, free_m = world()
    twist = dynamic_window(ORIGIN, Twist(0.2, 0.0), np.array([4.0, 0]), grid, free_m, SETTINGS)
    assert twist == pytest.approx((0.25, 0.0))


def test_dynamic_window_keeps_the_acceleration_limits():
    grid, free_m = world()
    for target in ([0.0, 3], [0, -3], [-3, 0.1]):
        twist = dynamic_window(ORIGIN, Twist(0.2, 0.1), np.array(target), grid, free_m, SETTINGS)
        assert 0.15 - 1e-9 <= twist.forward_mps <= 0.25 + 1e-9
        assert -0.2 - 1e-9 <= twist.turn_radps <= 0.4 + 1e-9
    left = dynamic_window(ORIGIN, Twist(0.2, 0.1), np.array([0.0, 3]), grid, free_m, SETTINGS)
    assert left.turn_radps == pytest.approx(0.4)


def test_planner_and_dynamic_window_drive_around_a_block():
    grid, free_m = world(*((1.5, y) for y in np.arange(-0.6, 0.3, 0.05)))
    costs = driving_costs(grid, RADIUS_M, OccupancySettings())
    goal_m = np.array([3.5, 0.0])
    planner = GridPlanner(costs, grid.cell(0, 0), grid.cell(*goal_m))
    pose, twist, closest = ORIGIN, Twist(0.0, 0.0), math.inf
    for _ in range(250):
        planner.move(grid.cell(pose.x_m, pose.y_m))
        planner.replan()
        target = lookahead_point(pose, grid.centres_m(planner.path()), SETTINGS.lookahead_m)
        chosen = dynamic_window(pose, twist, target, grid, free_m, SETTINGS)
        assert chosen is not None
        twist = chosen
        pose = drive(pose, twist)
        closest = min(closest, float(free_m[grid.cell(pose.x_m, pose.y_m)]))
        if np.hypot(*(goal_m - pose[:2])) < 0.2:
            break
    assert np.hypot(*(goal_m - pose[:2])) < 0.2
    assert 0 < closest < 0.5
    assert min(free_m[grid.cell(x, 0.0)] for x in np.arange(0, 3, 0.05)) < 0


def test_dynamic_window_admits_only_stoppable_speeds():
    wall = [(1.0, y) for y in np.arange(-3, 3, 0.05)]
    grid, free_m = world(*wall)
    pose, twist = ORIGIN, Twist(0.0, 0.0)
    for _ in range(100):
        chosen = dynamic_window(pose, twist, np.array([3.0, 0]), grid, free_m, SETTINGS)
        twist = chosen or Twist(max(0.0, twist.forward_mps - 0.05), 0.0)
        pose = drive(pose, twist)
        assert free_m[grid.cell(pose.x_m, pose.y_m)] > 0
    assert (
        dynamic_window(
            Pose2(0.65, 0.0, 0.0), Twist(0.5, 0.0), np.array([3.0, 0]), grid, free_m, SETTINGS
        )
        is None
    )
