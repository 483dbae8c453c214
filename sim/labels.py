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

    Every left pixel is splatted onto the two right pixels that it falls between; it is hidden if
    something nearer landed on either. Pixels that leave the image or have no disparity are not
    visible.

    Args:
        disparity_px: (H, W), NaN where unknown.
    """
    height, width = disparity_px.shape
    disparity = np.nan_to_num(disparity_px, nan=-1.0)
    u_right = np.arange(width, dtype=np.float32) - disparity
    inside = (disparity >= 0) & (u_right >= 0) & (u_right <= width - 1)
    first = np.clip(np.floor(u_right), 0, width - 2).astype(np.int32)
    bins = first + (np.arange(height, dtype=np.int32) * width)[:, None]
    nearest = np.full(height * width, -1.0, dtype=np.float32)
    # Right images are crossed from left to right as left images are; where two surfaces land on
    # one bin the nearer must win, whatever the order.
    flat = bins[inside]
    for offset in (0, 1):
        np.maximum.at(nearest, flat + offset, disparity[inside])
    hidden = np.maximum(nearest[bins], nearest[bins + 1]) > disparity + OCCLUDED_BY_PX
    return inside & ~hidden


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
