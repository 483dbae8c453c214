"""Dense labels of the left camera: disparity, visibility, and how well they explain the pixels."""

import cv2
import numpy as np

from vo.contract.arrays import Array, Image, Mask
from vo.contract.rig import StereoRig

OCCLUDED_BY_PX = 1.0
"""A surface hides another in the right image if its disparity is larger by more than this."""


def disparity_from_depth(rig: StereoRig, depth_m: Array) -> Array:
    """Return the (H, W) float32 disparity d = f b / Z in pixels; NaN where depth is NaN.

    Source:
        Thesis eq. 2.5.
    """
    return np.divide(np.float32(rig.f_px * rig.baseline_m), depth_m, dtype=np.float32)


def visible_in_right(disparity_px: Array) -> Mask:
    """Which left pixels the right camera sees too, from the left disparity alone.

    Every left pixel is splatted onto the two right pixels that it falls between, which closes
    the gaps in surfaces that the right camera sees stretched. It is hidden if something nearer
    landed on the right pixel next to it; so outlines hide up to a pixel too much, never too
    little. Pixels that leave the image or have no disparity are not visible.

    Args:
        disparity_px: (H, W), NaN where unknown.
    """
    height, width = disparity_px.shape
    disparity = np.nan_to_num(disparity_px, nan=-1.0)
    u_right = np.arange(width, dtype=np.float32) - disparity
    inside = (disparity >= 0) & (u_right >= 0) & (u_right <= width - 1)
    row = (np.arange(height, dtype=np.int32) * width)[:, None].repeat(width, axis=1)[inside]
    landed, d = u_right[inside], disparity[inside]
    nearest = np.full(height * width, -1.0, dtype=np.float32)
    for bins in (np.floor(landed), np.ceil(landed)):
        np.maximum.at(nearest, row + bins.astype(np.int32), d)
    hidden = nearest[row + np.rint(landed).astype(np.int32)] > d + OCCLUDED_BY_PX
    visible = inside.copy()
    visible[inside] = ~hidden
    return visible


def photometric_residual(left: Image, right: Image, disparity_px: Array, visible: Mask) -> Array:
    """Left minus the right image warped to it by the disparity, bicubic, in grey levels.

    Args:
        left: (H, W) or (H, W, 3) uint8.
        right: Like `left`.
        disparity_px: (H, W) of the left image.
        visible: (H, W) pixels to compare.

    Returns:
        (N,) float32 signed residuals of the visible pixels.
    """
    height, width = disparity_px.shape
    left, right = _grey(left), _grey(right)
    u = np.arange(width, dtype=np.float32) - np.nan_to_num(disparity_px).astype(np.float32)
    v = np.repeat(np.arange(height, dtype=np.float32)[:, None], width, axis=1)
    warped = cv2.remap(right.astype(np.float32), u, v, cv2.INTER_CUBIC)
    return left[visible].astype(np.float32) - warped[visible]


def _grey(image: Image) -> Image:
    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
