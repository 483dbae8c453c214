"""Alignment of the templates of landmarks with a new image, each warped as its surface demands."""

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled
from vo.map.frame import View
from vo.map.local_map import Keyframe, LocalMap
from vo.patches.alignment import Alignment, align_patch
from vo.patches.motion_blur import blur_along, missing_blur
from vo.patches.sampling import words, workspace
from vo.patches.templates import extract_patch, square_workspace


def align_landmarks(
    local_map: LocalMap, view: View, T_odom_cam: Array, rows: Indices, start: Array
) -> Alignment:
    """Align the templates of rows (N,) of the landmarks with the left image, from starts (N, 2).

    The pose (4, 4) says how the surfaces, planes of known slant, are seen.
    """
    landmarks, rig, n = local_map.landmarks, view.rig, len(rows)
    found = Alignment(np.full((n, 2), np.nan), np.full(n, np.nan), np.full((n, 2, 2), np.nan))
    if n == 0:
        return found
    T_cam_odom = se3.inverse(T_odom_cam)
    intrinsics = np.array([rig.f_px, rig.cx_px, rig.cy_px, rig.f_px * rig.baseline_m])
    # Contiguous, as a column of one element is: the machine code is for one layout.
    depth_m = np.ascontiguousarray(landmarks.anchor_depth_m)
    surface = (landmarks.anchor_pixels, depth_m, landmarks.anchor_slopes)
    keyframes = local_map.keyframes
    anchor = np.searchsorted([k.serial for k in keyframes], landmarks.anchor[rows])
    T_cam_anchor = T_cam_odom @ np.stack([k.T_odom_cam for k in keyframes])
    # As many as the window has: the machine code is for one number of images.
    window = max(view.settings.refinement.window, len(keyframes))
    used = np.bincount(anchor, minlength=len(keyframes)) > 0
    pairs = [_blurred_alike(k, view, bool(x)) for k, x in zip(keyframes, used, strict=True)]
    pairs += [pairs[-1]] * (window - len(pairs))
    images = tuple(words for side in zip(*pairs, strict=True) for words in side)
    shape = (int(rig.height_px), int(rig.width_px), view.settings.matching.align_px)
    which = (np.ascontiguousarray(rows), anchor, start)
    _align_anchored(images, which, surface, T_cam_anchor, intrinsics, shape, found)
    return found


def _blurred_alike(keyframe: Keyframe, view: View, is_used: bool) -> tuple[Array, Array]:
    """Images of a keyframe and of a view as words, each with the blur that only the other has."""
    images, paths = (keyframe.left, view.frame.left), (keyframe.path_px, view.path_px)
    if not is_used or (paths[0] is None and paths[1] is None):
        return words(images[0]), words(images[1])
    then, now = (np.zeros(2) if path is None else path for path in paths)
    key = keyframe.serial, float(now[0]), float(now[1])
    if key not in view.blurred:
        of_then, of_now = missing_blur(then, now)
        blurred = blur_along(images[0], of_then), blur_along(images[1], of_now)
        view.blurred[key] = words(blurred[0]), words(blurred[1])
    return view.blurred[key]


@compiled(fastmath={"reassoc", "contract"})  # sums in any order; NaN stays NaN
def _align_anchored(
    images: tuple[Array, ...], which: tuple[Indices, Indices, Array],
    surface: tuple[Array, Array, Array], T_cam_anchor: Array, intrinsics: Array,
    shape: tuple[int, int, int], found: Alignment,
) -> None:  # fmt: skip
    """Align rows (N,) of the landmarks, whose anchors (N,) are among the images, with a view.

    The images are words: those of all anchors, then the view's as it is compared with each of
    them. From each anchor to the camera leads one of the transforms (K, 4, 4).
    """
    rows, anchor, starts = which
    pixels, depth_m, slopes = surface
    height, width, side = shape
    work, square = workspace(side), square_workspace(side, width)
    size, window = (height, width), len(images) // 2
    warp = np.empty((3, 2))
    for i in range(len(rows)):
        j, k = rows[i], anchor[i]
        write_plane_warp(pixels[j], depth_m[j], slopes[j], T_cam_anchor[k], intrinsics, warp)
        norm, kept = extract_patch(images[k], size, pixels[j, 0], pixels[j, 1], square, work)
        template, at = (norm, kept, side), (starts[i, 0], starts[i, 1])
        now = images[window + k]
        u, v, zncc, uu, uv, vv = align_patch(template, now, size, at, warp, False, work)
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
