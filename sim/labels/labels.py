"""Dense labels of one view: disparity, flow, normals and visibility in a second view."""

from enum import IntEnum

import numpy as np

from vo.contract.arrays import Array, Image, Indices, Mask
from vo.contract.compilation import compiled
from vo.contract.rig import StereoRig


class Occlusion(IntEnum):
    """Visibility of a pixel's point in a second view; the value is the pixel in a label."""

    VISIBLE = 0
    HIDDEN = 1
    OUTSIDE = 2
    NOTHING = 3
    EDGE = 4


VISIBLE, HIDDEN, OUTSIDE, NOTHING, EDGE = (int(code) for code in Occlusion)

HIDING_STRIP_PX = 0.5
"""Disparity difference, and width of the hidden strip, from which one surface hides another."""
OCCLUDED_BY_SHARE = 0.01
"""Relative depth difference from which a surface hides another from the next view."""
SPLAT_COVERS_PX = 1.0
"""Smallest disparity difference at which a splat hides another on the same right pixel: less may be
the slope of one surface from a left pixel to the next."""
BEND_MAX_RAD = 0.02
"""Largest turn of the normal between three pixels of one plane."""


def disparity_from_depth(rig: StereoRig, depth_m: Array) -> Array:
    """Return the (H, W) float32 disparity d = f b / Z in pixels (thesis eq. 2.5); NaN stays NaN."""
    return np.divide(np.float32(rig.f_px * rig.baseline_m), depth_m, dtype=np.float32)


def visible_in_right(disparity_px: Array) -> Mask:
    """Return which left pixels are visible in the right image, from the left disparity (H, W).

    Every left pixel is splatted onto the two right pixels that it falls between, which closes the
    gaps in surfaces that the right image shows stretched. It is hidden if a nearer splat is on the
    right pixel next to it; so outlines hide up to a pixel too much, never too little. Pixels
    outside the right image or without disparity (NaN) are not visible.
    """
    visible = np.empty(disparity_px.shape, np.bool_)
    _visible(np.ascontiguousarray(disparity_px), visible)
    return visible


def flow(rig: StereoRig, depth_m: Array, bodies: Indices, T_next_now: Array) -> Array:
    """Return du and dv in pixels, and depth in metres, of each pixel's point in the next image.

    Args:
        rig: Its camera is that of both images.
        depth_m: (H, W) float32 planar depth; NaN for sky, which moves as a far point of body 0.
        bodies: (H, W) index of the body that each pixel shows; 0 is the world.
        T_next_now: (B, 4, 4) motion of each body, from the present camera axes to the next ones.

    Returns:
        (H, W, 3) float32, all NaN for points behind the next camera; the depth is NaN for sky.
    """
    out = np.empty((*depth_m.shape, 3), np.float32)
    T = np.ascontiguousarray(T_next_now, dtype=np.float64)
    _flow(depth_m, bodies, T, rig.f_px, rig.cx_px, rig.cy_px, out)
    return out


def occlusion(rig: StereoRig, depth_left_m: Array, depth_right_m: Array) -> Image:
    """Return which left pixels are visible in the right image, (H, W) uint8 of Occlusion.

    A left pixel's point is visible if the right image shows a surface of its disparity there, and
    hidden if it shows nearer ones. The right pixels on both sides of it are tested, each
    extrapolated to the point by its surface's slope; where they disagree, an outline lies between
    them, which hides the point or not: an edge. Outside is left of the right image's first pixel
    centre. Depths are (H, W) float32, planar; NaN without a surface.
    """
    scale = np.float32(rig.f_px * rig.baseline_m)
    left, right = scale / depth_left_m, np.nan_to_num(scale / depth_right_m)
    out = np.empty(left.shape, np.uint8)
    _stereo(left, right, HIDING_STRIP_PX, out)
    return out


def covisibility(flow: Array, depth_next_m: Array) -> Image:
    """Return which pixels are visible in the next view of the same camera, as `occlusion`.

    The flow is that of `flow`, the depth (H, W) float32 that of the next view, NaN without a
    surface. Outside is beyond the outermost pixel centres or behind the camera; nothing where the
    present view shows no surface.
    """
    out = np.empty(depth_next_m.shape, np.uint8)
    _next(flow, _nearness_of(depth_next_m), OCCLUDED_BY_SHARE, out)
    return out


def visibility(points: Array, depth_m: Array) -> Image:
    """Return which points (N, 3), u, v in pixels and depth in metres, a view shows: (N,) uint8.

    The codes are those of `covisibility`, depth_m (H, W) float32 that of the view. A point without
    a surface has a depth of NaN, one behind the camera u and v of NaN.
    """
    out = np.empty(len(points), np.uint8)
    _points(np.ascontiguousarray(points, float), _nearness_of(depth_m), OCCLUDED_BY_SHARE, out)
    return out


def nearness_at(depth_m: Array, pixels: Array) -> Array:
    """Return 1 / depth (N,) at pixels (N, 2) inside an image of depth (H, W), 1/m; 0 for none.

    The surface of the nearest pixel is extrapolated by its slope.
    """
    out = np.empty(len(pixels))
    _nearness(_nearness_of(depth_m), np.ascontiguousarray(pixels, float), out)
    return out


def _nearness_of(depth_m: Array) -> Array:
    return np.nan_to_num(1 / depth_m)


def normals(rig: StereoRig, depth_m: Array) -> Array:
    """Return unit normals (H, W, 3) float32 in camera axes, towards the camera.

    A plane n . p = 1 seen through a pinhole has 1/Z = n . (x, y, 1), affine in the pixel. Of the
    three runs of three pixels that contain the pixel, the one with the smallest second difference
    gives the slope, so that edges do not mix surfaces. NaN where no three pixels are on one plane,
    or where the depth (H, W) is NaN.
    """
    out = np.empty((*depth_m.shape, 3), np.float32)
    _normals(1 / depth_m, rig.f_px, rig.cx_px, rig.cy_px, BEND_MAX_RAD, out)
    return out


@compiled(nogil=True)
def _visible(disparity: Array, out: Mask) -> None:
    height, width = disparity.shape
    nearest = np.empty(width, np.float32)
    for v in range(height):
        nearest[:] = np.float32(-1)
        for u in range(width):
            landed = np.float32(u) - disparity[v, u]
            out[v, u] = disparity[v, u] >= 0 and 0 <= landed <= width - 1
            if out[v, u]:
                for k in (int(np.floor(landed)), int(np.ceil(landed))):
                    nearest[k] = max(nearest[k], disparity[v, u])
        for u in range(width):
            if out[v, u]:
                k = int(np.rint(np.float32(u) - disparity[v, u]))
                out[v, u] = nearest[k] <= disparity[v, u] + np.float32(SPLAT_COVERS_PX)


@compiled(nogil=True)
def _flow(
    depth_m: Array, bodies: Indices, T: Array, f: float, cx: float, cy: float, out: Array
) -> None:
    height, width = depth_m.shape
    for v in range(height):
        for u in range(width):
            x, y, z = (u - cx) / f, (v - cy) / f, depth_m[v, u]
            sky = np.isnan(z)
            M = T[0 if sky else bodies[v, u]]
            near = 0.0 if sky else 1 / z
            X = M[0, 0] * x + M[0, 1] * y + M[0, 2] + M[0, 3] * near
            Y = M[1, 0] * x + M[1, 1] * y + M[1, 2] + M[1, 3] * near
            Z = M[2, 0] * x + M[2, 1] * y + M[2, 2] + M[2, 3] * near
            if Z > 0:
                out[v, u, 0] = f * X / Z + cx - u
                out[v, u, 1] = f * Y / Z + cy - v
                out[v, u, 2] = Z * z
            else:
                out[v, u] = np.nan


@compiled(nogil=True)
def _normals(nearness: Array, f: float, cx: float, cy: float, bend_max: float, out: Array) -> None:
    height, width = nearness.shape
    for v in range(height):
        for u in range(width):
            a, bend_u = _straightest(nearness[v], u)
            b, bend_v = _straightest(nearness[:, u], v)
            nx, ny = f * a, f * b
            nz = nearness[v, u] - a * (u - cx) - b * (v - cy)
            norm = np.sqrt(nx * nx + ny * ny + nz * nz)
            if f * max(bend_u, bend_v) <= bend_max * norm:
                out[v, u, 0] = -nx / norm
                out[v, u, 1] = -ny / norm
                out[v, u, 2] = -nz / norm
            else:
                out[v, u] = np.nan


@compiled(nogil=True)
def _stereo(left: Array, right: Array, slack: float, out: Image) -> None:
    height, width = left.shape
    for v in range(height):
        for u in range(width):
            disparity = left[v, u]
            if np.isnan(disparity):
                out[v, u] = NOTHING
            elif u - disparity < 0:
                out[v, u] = OUTSIDE
            else:
                out[v, u] = _meets(right, u - disparity, float(v), disparity, slack)


@compiled(nogil=True)
def _next(flow: Array, nearness: Array, share: float, out: Image) -> None:
    height, width = nearness.shape
    for v in range(height):
        for u in range(width):
            u_next, v_next = u + flow[v, u, 0], v + flow[v, u, 1]
            out[v, u] = _seen(nearness, u_next, v_next, flow[v, u, 2], share)


@compiled(nogil=True)
def _points(points: Array, nearness: Array, share: float, out: Image) -> None:
    for k in range(len(points)):
        out[k] = _seen(nearness, points[k, 0], points[k, 1], points[k, 2], share)


@compiled(nogil=True)
def _seen(nearness: Array, u: float, v: float, depth: float, share: float) -> int:
    height, width = nearness.shape
    if not (0 <= u <= width - 1 and 0 <= v <= height - 1):
        return NOTHING if np.isnan(depth) and not np.isnan(u) else OUTSIDE
    if np.isnan(depth):
        return NOTHING
    return _meets(nearness, u, v, 1 / depth, share / depth)


@compiled(nogil=True)
def _nearness(nearness: Array, pixels: Array, out: Array) -> None:
    for k in range(len(pixels)):
        u, v = pixels[k]
        x, y = int(np.rint(u)), int(np.rint(v))
        out[k] = nearness[y, x]
        if u != x:
            out[k] += _straightest(nearness[y], x)[0] * (u - x)
        if v != y:
            out[k] += _straightest(nearness[:, x], y)[0] * (v - y)


@compiled(nogil=True)
def _meets(nearness: Array, u: float, v: float, wanted: float, slack: float) -> int:
    """Test the pixels around a position for a surface at the wanted nearness, and for nearer ones.

    Disparity and 1/Z are affine in the pixel on a plane (thesis eq. 2.5), so that slopes
    extrapolate a pixel's surface exactly.
    """
    u0, v0 = int(np.floor(u)), int(np.floor(v))
    equal, nearer, farther = False, False, False
    for y in range(v0, v0 + 1 + (v > v0)):
        for x in range(u0, u0 + 1 + (u > u0)):
            carried = nearness[y, x]
            if abs(carried - wanted) > slack:
                if u != x:
                    carried += _straightest(nearness[y], x)[0] * (u - x)
                if v != y:
                    carried += _straightest(nearness[:, x], y)[0] * (v - y)
            nearer = nearer or carried > wanted + slack
            farther = farther or carried < wanted - slack
            equal = equal or abs(carried - wanted) <= slack
    if nearer:
        return EDGE if equal or farther else HIDDEN
    return VISIBLE if equal else EDGE


@compiled(nogil=True)
def _straightest(line: Array, k: int) -> tuple[float, float]:
    """Return slope at k and second difference of the straightest three entries that contain k."""
    slope, bend = 0.0, np.inf
    for centre in (k, k - 1, k + 1):
        if centre >= 1 and centre + 1 < len(line):
            second = abs(line[centre - 1] - 2 * line[centre] + line[centre + 1])
            if second < bend:
                slope, bend = (line[centre + 1] - line[centre - 1]) / 2, second
    return slope, bend
