"""Occupancy grid from analytic depth images: level ground, a wall, a low sill."""

import numpy as np
import pytest

from trials.navigation.occupancy_grid import (
    OccupancySettings,
    clearance_m,
    depth_of,
    driving_costs,
    empty_grid,
    integrate_depth,
)
from vo.contract.rig import StereoRig

RIG = StereoRig(320, 240, 240.0, 159.5, 119.5, 0.09)
HEIGHT_M, TILT = 0.6, np.radians(20)
SETTINGS = OccupancySettings()
WALL_X_M = 3.0


def camera(x_m=0.0, y_m=0.0, z_m=HEIGHT_M, tilt=TILT, yaw=0.0):
    """Camera looking along the heading and down; OpenCV axes in a frame with z up."""
    c, s = np.cos(tilt), np.sin(tilt)
    R = np.array([[0.0, -s, c], [-1, 0, 0], [0, -c, -s]])
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn @ R, (x_m, y_m, z_m)
    return T


def render(T_world_cam, wall_x_m=WALL_X_M, wall_top_m=2.0):
    """Depth of the ground z = 0 and a wall x = wall_x_m up to wall_top_m, by intersecting rays."""
    v, u = np.mgrid[0 : RIG.height_px, 0 : RIG.width_px]
    rays_cam = np.stack([(u - RIG.cx_px) / RIG.f_px, (v - RIG.cy_px) / RIG.f_px, np.ones(u.shape)])
    rays = np.einsum("ij,jhw->ihw", T_world_cam[:3, :3], rays_cam)
    x, _, z = T_world_cam[:3, 3]
    with np.errstate(divide="ignore"):
        ground = np.where(rays[2] < 0, -z / rays[2], np.inf)
        wall = np.where(rays[0] > 0, (wall_x_m - x) / rays[0], np.inf)
    wall = np.where(z + wall * rays[2] < wall_top_m, wall, np.inf)
    return np.minimum(ground, wall)


def integrate(grid, T, depth_m, times=3, elapsed_s=0.0):
    for _ in range(times):
        grid = integrate_depth(grid, depth_m, RIG, T, HEIGHT_M, elapsed_s, SETTINGS)
    return grid


@pytest.fixture
def grid():
    return empty_grid((-1, 6), (-3, 3), 0.05)


def test_wall_is_occupied_ground_before_it_free_rest_unknown(grid):
    grid = integrate(grid, camera(), render(camera()))
    for y_m in (-1.0, 0.0, 1.2):
        assert grid.log_odds[grid.cell(WALL_X_M, y_m)] > SETTINGS.occupied_log_odds
    free = [grid.cell(x, 0.0) for x in np.arange(1.1, 2.9, 0.05)]
    assert all(grid.log_odds[cell] < 0 for cell in free)
    unknown = [grid.cell(x, 0.0) for x in (-0.5, 0.2, 3.2, 5.0)]
    assert all(grid.log_odds[cell] == 0 for cell in unknown)


@pytest.mark.parametrize("tilt_error", np.radians([-1.5, 1.5]))
@pytest.mark.parametrize("drift_m", [-0.5, 0.0, 0.3])
def test_ground_under_a_drifting_pose_is_no_obstacle(grid, tilt_error, drift_m):
    depth_m = render(camera())
    grid = integrate(grid, camera(z_m=HEIGHT_M + drift_m, tilt=TILT + tilt_error), depth_m)
    rows, columns = np.nonzero(grid.log_odds > 0)
    x_m = grid.centres_m(list(zip(rows.tolist(), columns.tolist(), strict=True)))[:, 0]
    assert len(x_m) > 20
    assert abs(x_m - WALL_X_M).max() < 0.1


@pytest.mark.parametrize(("top_m", "is_obstacle"), [(0.03, False), (0.12, True)])
def test_low_sill_is_no_obstacle(grid, top_m, is_obstacle):
    depth_m = render(camera(), wall_x_m=1.6, wall_top_m=top_m)
    grid = integrate(grid, camera(), depth_m)
    assert (grid.log_odds.max() > SETTINGS.occupied_log_odds) == is_obstacle


def test_turned_camera_marks_the_turned_place(grid):
    depth_m = render(camera(), wall_x_m=2.0)
    grid = integrate(grid, camera(y_m=0.5, yaw=np.pi / 2), depth_m)
    assert grid.log_odds[grid.cell(0.0, 2.5)] > SETTINGS.occupied_log_odds
    assert grid.log_odds[grid.cell(0.0, 2.0)] < 0


def test_grid_clears_what_has_gone_and_fades_what_is_not_seen(grid):
    T = camera()
    grid = integrate(grid, T, render(T, wall_x_m=2.0))
    assert grid.log_odds[grid.cell(2.0, 0.0)] > SETTINGS.occupied_log_odds
    gone = integrate(grid, T, render(T), times=8)
    assert gone.log_odds[gone.cell(2.0, 0.0)] < SETTINGS.occupied_log_odds
    blind = integrate_depth(
        grid, np.full((240, 320), np.nan), RIG, T, HEIGHT_M, SETTINGS.half_life_s, SETTINGS
    )
    np.testing.assert_allclose(blind.log_odds, grid.log_odds / 2)
    assert np.abs(integrate(grid, T, render(T), times=40).log_odds).max() == SETTINGS.max_log_odds


def test_disparity_and_depth_give_the_same_grid(grid):
    T = camera()
    depth_m = render(T)
    disparity_px = np.where(np.isfinite(depth_m), RIG.f_px * RIG.baseline_m / depth_m, 0)
    again = depth_of(disparity_px, RIG)
    assert np.isnan(again[disparity_px == 0]).all()
    np.testing.assert_allclose(
        integrate(grid, T, again).log_odds, integrate(grid, T, depth_m).log_odds, atol=1e-12
    )


def test_cells_and_centres_are_inverse():
    grid = empty_grid((1, 2), (-1, 0), 0.1)
    assert grid.log_odds.shape == (11, 11)
    assert grid.cell(1.0, -1.0) == (0, 0)
    assert grid.cell(1.26, -0.44) == (6, 3)
    np.testing.assert_allclose(grid.centres_m([(6, 3), (0, 0)]), [[1.3, -0.4], [1, -1]])


def test_driving_costs_rise_to_infinity_at_the_radius():
    grid = empty_grid((0, 2), (0, 2), 0.1)
    assert np.isinf(clearance_m(grid, SETTINGS)).all()
    assert (driving_costs(grid, 0.3, SETTINGS) == 1).all()
    grid.log_odds[10, 10] = 3.0
    distance_m = np.hypot(*(np.indices((21, 21)) - 10)) * 0.1
    np.testing.assert_allclose(clearance_m(grid, SETTINGS), distance_m, atol=1e-6)
    costs = driving_costs(grid, 0.25, SETTINGS)
    np.testing.assert_array_equal(np.isinf(costs), distance_m <= 0.25)
    near = (distance_m > 0.25) & (distance_m < 0.55)
    expected = 1 + SETTINGS.margin_cost * (1 - (distance_m - 0.25) / 0.3)
    np.testing.assert_allclose(costs[near], expected[near], rtol=1e-5)
    assert (costs[distance_m > 0.55] == 1).all()
