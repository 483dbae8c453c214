"""Matches that are consistent over three frames (thesis 5.1.2, F4; `matching.circular_check`).

A landmark's template connects it to this frame and to the previous frame; aligning the previous
frame with this one directly closes the circle.
"""

import numpy as np

from vo.contract.arrays import Mask
from vo.map.frame import View
from vo.map.local_map import Landmarks, TrackedFrame
from vo.map.matches import Matches
from vo.patches.alignment import align
from vo.patches.templates import extract_templates

MAX_CLOSURE_PX = 0.75
"""Largest difference between the two ways to this frame."""


def is_consistent(
    matches: Matches, landmarks: Landmarks, previous: TrackedFrame, view: View
) -> Mask:
    """Which matches (N,) the previous frame confirms.

    A landmark that no frame has matched yet is kept; one that others have matched but the previous
    frame has not is dropped.
    """
    keep = landmarks.views[matches.rows] == 1
    seen = previous.observations
    _, now, then = np.intersect1d(matches.ids, seen.ids, assume_unique=True, return_indices=True)
    patch_px = view.settings.matching.align_px
    templates = extract_templates(previous.left, seen.pixels[then], patch_px)
    direct = align(templates, view.frame.left, matches.pixels[now]).pixels
    with np.errstate(invalid="ignore"):
        error_px = np.abs(direct - matches.pixels[now]).max(axis=1)
        keep[now] = error_px < MAX_CLOSURE_PX  # not NaN
    return keep
