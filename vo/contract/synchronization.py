"""Check that both eyes show the same moments: matches of left and right lie in the same rows."""

from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np

from vo.contract.arrays import Array, Image, Mask
from vo.contract.errors import ImageError
from vo.contract.remarks import remark
from vo.contract.sequence import StereoSequence

FRAMES = 8
"""Number of frames that are looked at, evenly over a sequence."""

CORNERS, MIN_MATCHES = 200, 20
"""Corners of a left image, and fewest of them whose matches count."""

WINDOW, FLOW_LEVELS = (15, 15), 4
"""Window, px, and pyramid levels of the Lucas–Kanade tracker."""

MAX_RETURN_PX = 0.5
"""Largest distance to a corner after tracking it to the other image and back."""

MAX_ROW_PX, MIN_DISPARITY_PX = 1.0, -1.0
"""Limits on row difference and disparity of a match that fits a rectified pair."""

GOOD_SHARE, GAIN = 0.8, 0.2
"""Share of fitting matches of a synchronized frame, and how much more another one must have."""

MAX_MEDIAN_ROW_PX = 1.5
"""Median row difference of a sequence above which its calibration is in doubt."""


@dataclass(frozen=True)
class _Fit:
    """Share of the matches of a pair that fit, and median row difference, px."""

    share: float
    row_px: float


def remark_unsynchronized(sequence: StereoSequence) -> None:
    """Remark that the eyes are shifted by one frame, or that their rows differ.

    A shift is noticed where the camera moves: in most of the frames that do not fit, the right
    image of the frame before, or after, fits better.
    """
    rows = np.unique(np.linspace(0, len(sequence) - 1, min(FRAMES, len(sequence))).astype(int))
    own = {i: fit for i in rows.tolist() if (fit := _fit(sequence, i, i)) is not None}
    doubtful = [i for i, fit in own.items() if fit.share < GOOD_SHARE]
    for step, when in ((-1, "before"), (1, "after")):
        others = [(own[i], _fit(sequence, i, i + step)) for i in doubtful]
        better = sum(x is not None and x.share > now.share + GAIN for now, x in others)
        if better >= 2 and better > len(doubtful) / 2:
            remark(
                f"{sequence.name}: the left images belong to the right ones of the frame {when} "
                f"({better} of {len(own)} frames looked at): one eye is shifted by a frame"
            )
            return
    row_px = float(np.median([x.row_px for x in own.values()])) if own else 0.0
    if row_px > MAX_MEDIAN_ROW_PX:
        remark(
            f"{sequence.name}: left and right differ by {row_px:.1f} rows (median) after "
            "rectification: the calibration is of other images, or the eyes are not synchronized"
        )


def _fit(sequence: StereoSequence, i: int, j: int) -> _Fit | None:
    """Match left image i with right image j; None without such images or enough matches."""
    if not 0 <= j < len(sequence):
        return None
    try:
        return _match(sequence[i].left, sequence[j].right)
    except ImageError:
        return None


def _match(left: Image, right: Image) -> _Fit | None:
    found = cast("Array | None", cv2.goodFeaturesToTrack(left, CORNERS, 0.01, 7))
    if found is None:
        return None
    corners = found
    there, ok = _track(left, right, corners)
    back, ok_back = _track(right, left, there)
    error_px = np.linalg.norm((back - corners).reshape(-1, 2), axis=1)
    is_match = ok & ok_back & (error_px < MAX_RETURN_PX)
    if is_match.sum() < MIN_MATCHES:
        return None
    disparity, row = (corners - there).reshape(-1, 2)[is_match].T
    fits = (np.abs(row) < MAX_ROW_PX) & (disparity > MIN_DISPARITY_PX)
    return _Fit(float(fits.mean()), float(np.median(np.abs(row))))


def _track(a: Image, b: Image, pixels_a: Array) -> tuple[Array, Mask]:
    """Track (N, 1, 2) pixels from image a to b; the mask (N,) marks those that are found."""
    guess = np.empty_like(pixels_a)  # unused
    pixels_b, found, _ = cv2.calcOpticalFlowPyrLK(
        a, b, pixels_a, guess, winSize=WINDOW, maxLevel=FLOW_LEVELS
    )
    return pixels_b, found.ravel() == 1
