"""Visibility of a view's points in a second view: visible, hidden, outside or no surface."""

from enum import IntEnum

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled
from vo.contract.rig import StereoRig


class Occlusion(IntEnum):
    """Visibility of a pixel's point in a second view; the value is the pixel in a label."""

    VISIBLE = 0
    HIDDEN = 1
    OUTSIDE = 2
    NOTHING = 3


VISIBLE, HIDDEN, OUTSIDE, NOTHING = (int(code) for code in Occlusion)

HIDING_STRIP_PX = 0.5
"""Disparity difference, and width of the hidden strip, from which a surface hides another from the
right camera."""
OCCLUDED_BY_SHARE = 0.01
"""Relative depth difference from which a surface hides another from the next view."""


def occlusion(rig: StereoRig, depth_left_m: Array, depth_right_m: Array) -> Image:
    """Return which left pixels are visible in the right image, (H, W) uint8 of Occlusion.

    A left pixel's point is visible if the right image shows a surface of its disparity there. The
    right pixels on both sides of it are tested, each extrapolated to the point by its surface's
    slope, and none may be nearer: outlines hide up to a pixel too much. Outside is left of the
    right image's first pixel centre. Depths are (H, W) float32, planar; NaN without a surface.
    """
    scale = np.float32(rig.f_px * rig.baseline_m)
    left, right = scale / depth_left_m, np.nan_to_num(scale / depth_right_m)
    out = np.empty(left.shape, np.uint8)
    _stereo(left, right, HIDING_STRIP_PX, out)
    return out


def covisibility(flow: Array, depth_next_m: Array) -> Image:
    """Return which pixels are visible in the next view of the same camera, as `occlusion`.

    Args:
        flow: (H, W, 3) float32 du, dv in pixels and depth in the next view, as `labels.flow`.
        depth_next_m: (H, W) float32 depth of the next view; NaN without a surface.

    Returns:
        (H, W) uint8 of Occlusion: outside is beyond the outermost pixel centres or behind the
            camera; nothing where the present view shows no surface.
    """
    out = np.empty(depth_next_m.shape, np.uint8)
    _next(flow, np.nan_to_num(1 / depth_next_m), OCCLUDED_BY_SHARE, out)
    return out


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
            u_next, v_next, depth = u + flow[v, u, 0], v + flow[v, u, 1], flow[v, u, 2]
            if not (0 <= u_next <= width - 1 and 0 <= v_next <= height - 1):
                out[v, u] = NOTHING if np.isnan(depth) and not np.isnan(u_next) else OUTSIDE
            elif np.isnan(depth):
                out[v, u] = NOTHING
            else:
                out[v, u] = _meets(nearness, u_next, v_next, 1 / depth, share / depth)


@compiled(nogil=True)
def _meets(nearness: Array, u: float, v: float, wanted: float, slack: float) -> int:
    """Test the pixels around a position for a surface at the wanted nearness, and none nearer.

    Disparity and 1/Z are affine in the pixel on a plane (thesis eq. 2.5), so that slopes
    extrapolate a pixel's surface exactly.
    """
    u0, v0 = int(np.floor(u)), int(np.floor(v))
    found = False
    for y in range(v0, v0 + 1 + (v > v0)):
        for x in range(u0, u0 + 1 + (u > u0)):
            carried = nearness[y, x]
            if abs(carried - wanted) > slack:
                if u != x:
                    carried += straightest(nearness[y], x)[0] * (u - x)
                if v != y:
                    carried += straightest(nearness[:, x], y)[0] * (v - y)
            if carried > wanted + slack:
                return HIDDEN
            found = found or carried >= wanted - slack
    return VISIBLE if found else HIDDEN


@compiled(nogil=True)
def straightest(line: Array, k: int) -> tuple[float, float]:
    """Return slope at k and second difference of the straightest three entries that contain k."""
    slope, bend = 0.0, np.inf
    for centre in (k, k - 1, k + 1):
        if centre >= 1 and centre + 1 < len(line):
            second = abs(line[centre - 1] - 2 * line[centre] + line[centre + 1])
            if second < bend:
                slope, bend = (line[centre + 1] - line[centre - 1]) / 2, second
    return slope, bend
