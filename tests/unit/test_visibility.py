"""Visibility labels against rays shot through a world of planes, boxes and spheres."""

import math

import numpy as np
import pytest
from raycast import Ball, Box, Ground, View, look, sees

from sim.labels.labels import (
    HIDING_STRIP_PX,
    Occlusion,
    covisibility,
    disparity_from_depth,
    flow,
    occlusion,
)
from vo.contract import se3
from vo.contract.arrays import Array, Mask
from vo.contract.rig import StereoRig

RIG = StereoRig(width_px=320, height_px=240, f_px=228, cx_px=159.5, cy_px=119.5, baseline_m=0.09)
T_LEFT_RIGHT = se3.pose(np.eye(3), np.array([RIG.baseline_m, 0, 0]))
BALL = 3


def place(x: float, y: float, z: float, yaw: float = 0.0) -> Array:
    T = se3.exp(np.array([0, 0, 0, 0, 0, yaw]))
    T[:3, 3] = x, y, z
    return T


def camera(height_m: float, tilt_rad: float) -> Array:
    """T_world_cam of a camera above the origin that looks along x and down."""
    c, s = math.cos(tilt_rad), math.sin(tilt_rad)
    R = np.array([[0, -s, c], [-1, 0, 0], [0, -c, -s]])
    return se3.pose(R, np.array([0, 0, height_m]))


WORLD = [
    Ground(),
    Box((0.1, 0.1, 0.2), place(1.2, 0.2, 0.2, 0.4)),
    Box((0.02, 0.02, 0.5), place(1.6, -0.3, 0.5)),
    Ball(0.15, place(1.3, -0.1, 0.15)),
    Box((0.05, 2.0, 0.6), place(4.0, 0.0, 0.6)),
    Box((0.1, 0.2, 0.03), place(0.8, 0.0, 0.03, 0.3)),
    Ball(0.3, place(2.5, 0.9, 0.5)),
]
T_WORLD_LEFT = camera(0.5, 0.35)


@pytest.fixture(scope="module")
def left() -> View:
    return look(WORLD, RIG, T_WORLD_LEFT)


def beside_outline(view: View, u: Array, v: Array, own: Array) -> Mask:
    """Whether a pixel around each (N,) place shows another shape, or side, than its own."""
    rows = np.clip([np.floor(v), np.ceil(v)], 0, RIG.height_px - 1).astype(int)
    columns = np.clip([np.floor(u), np.ceil(u)], 0, RIG.width_px - 1).astype(int)
    around = [(r, c) for r in rows for c in columns]
    shape_differs = np.any([view.shapes[r, c] != own for r, c in around], axis=0)
    normals = np.array([view.normals_cam[r, c] for r, c in around])
    return shape_differs | ~np.isclose(normals, normals[0], atol=0.5).all(axis=(0, 2))


def test_occlusion_agrees_with_rays_to_the_right_camera(left: View):
    right = look(WORLD, RIG, T_WORLD_LEFT @ T_LEFT_RIGHT)
    code = occlusion(RIG, left.depth_m, right.depth_m)
    seen = sees(WORLD, T_WORLD_LEFT @ T_LEFT_RIGHT, left.points_world)
    v, u = np.indices(code.shape)
    u_right = u - disparity_from_depth(RIG, left.depth_m)
    met = left.shapes >= 0
    np.testing.assert_array_equal(code == Occlusion.NOTHING, ~met)
    np.testing.assert_array_equal(code == Occlusion.OUTSIDE, met & (u_right < 0))
    inside = met & (u_right >= 0)
    hidden = inside & ~seen
    assert hidden.sum() > 1500
    assert (hidden & (code == Occlusion.VISIBLE)).sum() < 0.01 * hidden.sum()
    assert not (inside & seen & (code == Occlusion.HIDDEN)).any()
    assert (code == Occlusion.HIDDEN).sum() > 0.85 * hidden.sum()
    too_much = inside & seen & (code == Occlusion.EDGE)
    assert 0 < too_much.sum() < 0.3 * hidden.sum()
    beside = beside_outline(right, u_right[too_much], v[too_much], left.shapes[too_much])
    assert beside.mean() > 0.98  # the rest: sides narrower than three pixels have no slope


def test_occlusion_misses_at_most_half_a_pixel(left: View):
    right = look(WORLD, RIG, T_WORLD_LEFT @ T_LEFT_RIGHT)
    code = occlusion(RIG, left.depth_m, right.depth_m)
    disparity = disparity_from_depth(RIG, left.depth_m)
    v, u = np.nonzero(code == Occlusion.VISIBLE)
    at = u - disparity[v, u]
    nearest = disparity_from_depth(RIG, right.depth_m)[v, np.rint(at).astype(int)]
    excess = nearest - disparity[v, u]
    other = right.shapes[v, np.rint(at).astype(int)] != left.shapes[v, u]
    assert np.nanmax(excess[other]) < HIDING_STRIP_PX + 0.3  # and the slope over half a pixel


def test_occlusion_of_a_steep_plane_is_visible():
    """A wall almost along the line of sight: disparity rises by 0.8 px from pixel to pixel."""
    world = [Box((5.0, 0.01, 2.0), place(4.0, -0.12, 0.5))]
    T_world_left = camera(0.5, 0.0)
    left = look(world, RIG, T_world_left)
    right = look(world, RIG, T_world_left @ T_LEFT_RIGHT)
    disparity = disparity_from_depth(RIG, left.depth_m)
    assert np.nanmax(np.abs(np.diff(disparity, axis=1))) > 0.5
    assert not (occlusion(RIG, left.depth_m, right.depth_m) == Occlusion.HIDDEN).any()


def test_occlusion_without_right_surface_is_an_edge():
    """A wire falls between the right camera's pixels: a wall of 2 px behind it is all there is."""
    rig = StereoRig(12, 1, 100, 5.5, 0, 0.1)
    left = np.full((1, 12), 10 / 2.0, np.float32)
    left[0, 8] = 10 / 4.5
    right = np.full((1, 12), 10 / 2.0, np.float32)
    code = occlusion(rig, left, right)[0]
    assert code[8] == Occlusion.EDGE
    assert (np.delete(code, 8)[2:] == Occlusion.VISIBLE).all()


def test_covisibility_agrees_with_rays_to_the_next_camera(left: View):
    """The camera goes on and turns while one ball rolls to the side."""
    T_world_next = T_WORLD_LEFT @ se3.exp(np.array([0, 0, 0.03, 0.01, 0.03, 0.005]))
    T_moved = place(0.02, 0.03, 0)
    world = list(WORLD)
    world[BALL] = Ball(0.15, T_moved @ WORLD[BALL].T_world_own)
    bodies = (left.shapes == BALL).astype(np.int32)
    T_next_world = se3.inverse(T_world_next)
    T_next_now = np.stack([T_next_world @ T_WORLD_LEFT, T_next_world @ T_moved @ T_WORLD_LEFT])
    moved = flow(RIG, left.depth_m, bodies, T_next_now)

    points = left.points_world + bodies[..., None] * T_moved[:3, 3]
    pixels = RIG.project(se3.transform(T_next_world, points.reshape(-1, 3)))
    pixels = pixels.reshape(points.shape)
    v, u = np.indices(bodies.shape)
    met = left.shapes >= 0
    np.testing.assert_allclose((u + moved[..., 0])[met], pixels[met, 0], atol=1e-4)
    np.testing.assert_allclose((v + moved[..., 1])[met], pixels[met, 1], atol=1e-4)
    np.testing.assert_allclose(moved[met, 2], RIG.f_px * 0.09 / pixels[met, 2], rtol=1e-6)

    following = look(world, RIG, T_world_next)
    code = covisibility(moved, following.depth_m)
    seen = sees(world, T_world_next, points)
    u, v = u + moved[..., 0], v + moved[..., 1]
    inside = (u >= 0) & (u <= RIG.width_px - 1) & (v >= 0) & (v <= RIG.height_px - 1)
    np.testing.assert_array_equal(code == Occlusion.NOTHING, ~met)
    np.testing.assert_array_equal(code == Occlusion.OUTSIDE, met & ~inside)
    hidden = met & inside & ~seen
    assert hidden.sum() > 400
    assert (hidden & (code == Occlusion.VISIBLE)).sum() < 0.02 * hidden.sum()
    assert not (seen & (code == Occlusion.HIDDEN)).any()
    assert (code == Occlusion.HIDDEN).sum() > 0.45 * hidden.sum()
    too_much = met & inside & seen & (code == Occlusion.EDGE)
    assert 0 < too_much.sum() < 1.5 * hidden.sum()
    beside = beside_outline(following, u[too_much], v[too_much], left.shapes[too_much])
    assert beside.mean() > 0.96  # the rest: those, and where the ball curves away


def test_covisibility_of_sky_and_points_behind_the_camera():
    depth_m = np.full((4, 6), np.nan, np.float32)
    depth_m[:, 3:] = 0.5
    rig = StereoRig(6, 4, 5.0, 2.5, 1.5, 0.1)
    passing = se3.pose(np.eye(3), np.array([0, 0, -1.0]))
    code = covisibility(flow(rig, depth_m, np.zeros((4, 6), int), passing[None]), depth_m)
    assert (code[:, :3] == Occlusion.NOTHING).all()
    assert (code[:, 3:] == Occlusion.OUTSIDE).all()
