"""Pixels in the right image, searched along u and v."""

import numpy as np

from vo.contract.arrays import Array
from vo.contract.sequence import StereoFrame
from vo.patches.alignment import align
from vo.patches.templates import extract_templates
from vo.stereo.right_camera import right_camera_of


def expect_right(frame: StereoFrame, pixels: Array, disparity_px: Array) -> Array:
    """Pixels (N, 2) in the right image of left ones (N, 2), by their disparities (N,)."""
    if right := right_camera_of(frame):
        return right.see(pixels, disparity_px)
    return pixels - np.column_stack([disparity_px, np.zeros(len(pixels))])


def find_right(frame: StereoFrame, pixels: Array, start: Array, side: int) -> Array:
    """Align square patches about left pixels (N, 2) in the right image, from starts (N, 2).

    The pixels (N, 2) there are NaN where alignment fails.
    """
    templates = extract_templates(frame.left, pixels, side)
    return align(templates, frame.right, start).pixels
