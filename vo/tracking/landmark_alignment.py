"""Alignment of the templates of landmarks with a new image, each warped as its surface demands."""

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Image, Indices
from vo.contract.compilation import compiled
from vo.map.frame import View
from vo.map.local_map import LocalMap
from vo.patches.alignment import Alignment, align_patch
from vo.patches.templates import extract_patch, patch_workspace


def align_landmarks(
    local_map: LocalMap, view: View, T_odom_cam: Array, rows: Indices, start: Array
) -> Alignment:
    """Align the templates of rows (N,) of the landmarks with the left image, from starts (N, 2).

    The pose (4, 4) says how the surfaces, planes of known slant, are seen.
    """
    landmarks, rig, n = local_map.landmarks, view.rig, len(rows)
    found = Alignment(np.full((n, 2), np.nan), np.full(n, np.nan), np.full((n, 2, 2), np.nan))
    T_cam_odom = se3.inverse(T_odom_cam)
    intrinsics = np.array([rig.f_px, rig.cx_px, rig.cy_px, rig.f_px * rig.baseline_m])
    surface = (landmarks.anchor_pixels, landmarks.anchor_depth_m, landmarks.anchor_slopes)
    anchor, side = landmarks.anchor[rows], view.settings.matching.align_px
    for keyframe in local_map.keyframes:
        here = np.flatnonzero(anchor == keyframe.serial)
        T, images = T_cam_odom @ keyframe.T_odom_cam, (keyframe.left, view.frame.left)
        _align_anchored(images, (rows, here), surface, T, intrinsics, side, start, found)
    return found


@compiled(fastmath={"reassoc", "contract"})  # sums in any order; NaN stays NaN
def _align_anchored(
    images: tuple[Image, Image], which: tuple[Indices, Indices],
    surface: tuple[Array, Array, Array], T_cam_anchor: Array, intrinsics: Array, side: int,
    start: Array, found: Alignment,
) -> None:  # fmt: skip
    """Align the landmarks of one anchor, at some places (K,) among the rows (N,)."""
    rows, here = which
    pixels, depth_m, slopes = surface
    padded, patch, gradients, offsets, now = patch_workspace(side)
    template, work = (patch, gradients), (offsets, now)
    warp = np.empty((3, 2))
    for i in here:
        j = rows[i]
        write_plane_warp(pixels[j], depth_m[j], slopes[j], T_cam_anchor, intrinsics, warp)
        norm, kept = extract_patch(images[0], pixels[j, 0], pixels[j, 1], padded, patch, gradients)
        u, v, zncc, uu, uv, vv = align_patch(
            template, norm, kept, images[1], (start[i, 0], start[i, 1]), warp, False, work
        )
        found.pixels[i, 0], found.pixels[i, 1], found.zncc[i] = u, v, zncc
        found.covariance_px2[i, 0, 0], found.covariance_px2[i, 1, 1] = uu, vv
        found.covariance_px2[i, 0, 1] = found.covariance_px2[i, 1, 0] = uv


@compiled()
def write_plane_warp(
    pixel: Array, depth_m: float, slopes: Array, T_cam_anchor: Array, intrinsics: Array, warp: Array
) -> None:
    """Write the warp (3, 2) of a slanted patch in the anchor's image on its way to another camera.

    Inverse depth is linear in the pixels of a plane, so with m = (x / z, y / z, 1) in the anchor,
    h = R m + t / z is linear too, and the plane's homography is (h_x / h_z, h_y / h_z). The warp
    is as `vo.patches.alignment.align` takes it; the slopes (2,) are disparity per pixel.
    """
    f, cx, cy, fb = intrinsics
    x, y = (pixel[0] - cx) / f, (pixel[1] - cy) / f
    T, inverse_z = T_cam_anchor, 1 / depth_m
    hz = T[2, 0] * x + T[2, 1] * y + T[2, 2] + T[2, 3] * inverse_z
    for k in range(2):
        bend = (T[2, k] / f + T[2, 3] * slopes[k] / fb) / hz
        warp[2, k] = bend
        for i in range(2):
            h = T[i, 0] * x + T[i, 1] * y + T[i, 2] + T[i, 3] * inverse_z
            dh = T[i, k] / f + T[i, 3] * slopes[k] / fb
            warp[i, k] = f * (dh / hz - h / hz * bend)
