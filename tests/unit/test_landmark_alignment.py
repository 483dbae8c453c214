"""Landmarks on slanted planes, seen from a known pose."""

import numpy as np
import pytest

from vo.contract import se3
from vo.contract.arrays import find_sorted
from vo.contract.observations import Observations
from vo.contract.projection import project_points
from vo.contract.rig import StereoRig
from vo.tracking.landmark_alignment import write_plane_warp

RIG = StereoRig(640, 480, 450.0, 321.5, 238.0, 0.09)
PIXEL, DEPTH_M = np.array([400.0, 300.0]), 2.0
INTRINSICS = np.array([RIG.f_px, RIG.cx_px, RIG.cy_px, RIG.f_px * RIG.baseline_m])


@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.2, -0.3)])
@pytest.mark.parametrize("motion", [np.zeros(6), np.array([0.1, -0.05, 0.2, 0.05, -0.1, 0.2])])
def test_plane_warp_is_that_of_projected_points(slopes, motion):
    """Corners of a patch are projected by their own disparity, which is linear in the pixels."""
    T_cam_anchor = se3.exp(motion)
    warp = np.empty((3, 2))
    write_plane_warp(PIXEL, DEPTH_M, np.array(slopes), T_cam_anchor, INTRINSICS, warp)
    offsets = np.array([[0, 0], [4, 4], [-4, 4], [4, -4], [-4, -4.0]])
    disparity_px = RIG.f_px * RIG.baseline_m / DEPTH_M + offsets @ slopes
    points = RIG.triangulate(PIXEL + offsets, disparity_px)
    seen = RIG.project(se3.transform(T_cam_anchor, points))[:, :2]
    warped = offsets @ warp[:2].T / (1 + offsets @ warp[2])[:, None]
    np.testing.assert_allclose(warped, seen - seen[0], atol=1e-9)


def test_projection_in_one_loop_is_that_of_the_rig():
    rng = np.random.default_rng(0)
    points = rng.uniform([-2, -2, -1], [2, 2, 8], (50, 3))
    T_odom_cam = se3.exp(rng.normal(size=6) * 0.2)
    expected = RIG.project(se3.transform(se3.inverse(T_odom_cam), points))
    assert np.isnan(expected).any()
    np.testing.assert_allclose(project_points(points, T_odom_cam, RIG), expected, atol=1e-9)


@pytest.mark.parametrize("wanted", [[], [3], [0, 3, 4, 7, 9, 12]])
def test_rows_of_sorted_values(wanted):
    values = np.array([1, 3, 4, 9])
    rows = find_sorted(values, np.array(wanted, dtype=np.int64))
    found = {1: 0, 3: 1, 4: 2, 9: 3}
    assert rows.tolist() == [found.get(x, -1) for x in wanted]


def test_rows_of_observations_are_selected_in_order():
    seen = Observations(np.array([3, 5, 8]), np.arange(6.0).reshape(3, 2), np.array([1, np.nan, 2]))
    assert seen.select(np.array([True, True, True])) is seen
    assert seen.select(np.array([False, True, True])).ids.tolist() == [5, 8]
    assert seen.select(np.array([2, 0, 1])).ids.tolist() == [8, 3, 5]
    np.testing.assert_equal(seen.measured, [[0, 1, 1], [2, 3, np.nan], [4, 5, 2]])
