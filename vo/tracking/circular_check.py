"""Matches that are consistent over three frames (thesis 5.1.2, F4).

A landmark's template ties it to this frame and to the frame before; aligning the frame before
with this one directly closes the triangle.
"""

import numpy as np

from vo.contract.arrays import Image, Mask
from vo.map.local_map import Landmarks, Sighting
from vo.patches.alignment import align
from vo.patches.templates import extract_templates
from vo.tracking.association import Matches

CLOSURE_PX = 0.75
"""Most by which the two ways to this frame may differ."""


def consistent(
    matches: Matches, landmarks: Landmarks, before: Sighting, image: Image, patch_px: int
) -> Mask:
    """Which matches the frame before confirms, (N,).

    A landmark that no frame has matched yet may still become a triplet, and is kept; one that
    others have matched but the frame before has not is dropped.

    Args:
        matches: Of a new frame.
        landmarks: The map's, of which the matches are rows.
        before: The last frame that had a pose.
        image: (H, W) uint8, the new frame's left.
        patch_px: Side of the patch that is aligned.
    """
    keep = landmarks.views[matches.rows] == 1
    _, now, then = np.intersect1d(matches.ids, before.ids, assume_unique=True, return_indices=True)
    templates = extract_templates(before.left, before.pixels[then], patch_px)
    direct = align(templates, image, matches.pixels[now]).pixels
    with np.errstate(invalid="ignore"):
        keep[now] = np.abs(direct - matches.pixels[now]).max(axis=1) < CLOSURE_PX  # not NaN
    return keep
