"""Check that both eyes show the same moments: matches of left and right lie in the same rows."""

from contextlib import suppress
from typing import cast

import cv2
import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.errors import ImageError
from vo.contract.remarks import remark
from vo.contract.sequence import StereoSequence

FRAMES = 8
"""Number of frames that are looked at, evenly over a sequence."""

CORNERS, PATCH_PX, MIN_SCORE = 200, 15, 0.8
"""Corners of a left image, side of the patch around each, and zero-mean NCC of a match."""

ROWS_PX, DISPARITIES = 6, 0.25
"""Range of the search: rows up and down, and disparities in image widths."""

WORSE_PX, SURE, RATIO = 0.3, 5.0, 2.0
"""Difference of row errors that counts; standard deviations, and ratio, by which corners that fit
another frame better outnumber those that fit their own better."""

MAX_MEDIAN_ROW_PX, MIN_MATCHED = 1.5, 0.5
"""Median row error above which a calibration is in doubt, if this share of the corners match."""

MIN_CORNERS, FEW = 100, 0.1
"""Number of corners, and half of the share that must match if left and right are swapped."""


def remark_unsynchronized(sequence: StereoSequence) -> None:
    """Remark that eyes are shifted by one frame, swapped or the same, or that their rows differ.

    A shift is noticed where the camera moves: the right image of the frame before, or after, then
    has matches in the rows of the left one, the own right image has not.
    """
    with suppress(ImageError):
        if sequence[0].left.any() and (sequence[0].left == sequence[0].right).all():
            remark(f"{sequence.name}: left and right are the same images")
    rows = np.unique(np.linspace(0, len(sequence) - 1, min(FRAMES, len(sequence))).astype(int))
    looks = [_row_errors(sequence, i) for i in rows.tolist()]
    for step, when in ((-1, "before"), (1, "after")):
        better = sum(_count_worse(x[0], x[step]) for x in looks)
        worse = sum(_count_worse(x[step], x[0]) for x in looks)
        if better > RATIO * worse and better - worse > SURE * np.sqrt(better + worse):
            remark(
                f"{sequence.name}: the left images fit the right ones of the frame {when} better "
                f"than their own ({better} to {worse} corners): one eye is shifted by a frame"
            )
            return
    errors = np.concatenate([x[0] for x in looks])
    matched = errors[np.isfinite(errors)]
    if len(errors) >= MIN_CORNERS and len(matched) < MIN_MATCHED * len(errors):
        swapped = np.concatenate([_row_errors(sequence, i, swap=True)[0] for i in rows.tolist()])
        if np.isfinite(swapped).mean() > 2 * max(FEW, len(matched) / len(errors)):
            remark(f"{sequence.name}: the right images fit as left ones: are the eyes swapped?")
    if len(matched) > MIN_MATCHED * len(errors) and np.median(matched) > MAX_MEDIAN_ROW_PX:
        remark(
            f"{sequence.name}: left and right differ by {np.median(matched):.1f} rows (median) "
            "after rectification: the calibration is of other images, or the eyes are not "
            "synchronized"
        )


def _count_worse(errors_px: Array, other_px: Array) -> int:
    """Count the corners that match in the rows of the other image only; none without an image."""
    if len(errors_px) != len(other_px):
        return 0
    known = np.where(np.isfinite(errors_px), errors_px, np.inf)
    return int(((other_px < 1) & (known > other_px + WORSE_PX)).sum())


def _row_errors(sequence: StereoSequence, i: int, swap: bool = False) -> dict[int, Array]:
    """Match corners of left image i in the right images i - 1, i, i + 1: keys -1, 0, 1.

    The values are |rows| between, (N,), NaN for no match; (0,) without an image. On request, left
    and right are swapped.
    """
    images: dict[int, tuple[Image, Image]] = {}
    for step in (-1, 0, 1):
        if 0 <= i + step < len(sequence):
            with suppress(ImageError):
                frame = sequence[i + step]
                images[step] = (frame.right, frame.left) if swap else (frame.left, frame.right)
    if 0 not in images:
        return dict.fromkeys((-1, 0, 1), np.zeros(0))
    left = images[0][0]
    found = cast("Array | None", cv2.goodFeaturesToTrack(left, CORNERS, 0.01, PATCH_PX // 2))
    corners = [] if found is None else found.reshape(-1, 2).astype(int).tolist()
    return {
        step: np.array([_row_error(left, images[step][1], u, v) for u, v in corners])
        if step in images
        else np.zeros(0)
        for step in (-1, 0, 1)
    }


def _row_error(left: Image, right: Image, u: int, v: int) -> float:
    """Search the patch around (u, v) of the left image in the right one."""
    height, width = left.shape
    half, reach = PATCH_PX // 2, PATCH_PX // 2 + ROWS_PX
    if not (reach <= v < height - reach and half <= u < width - half):
        return np.nan
    start = max(0, u - half - int(DISPARITIES * width))
    patch = left[v - half : v + half + 1, u - half : u + half + 1]
    strip = right[v - reach : v + reach + 1, start : u + half + 2]
    scores = cv2.matchTemplate(strip, patch, cv2.TM_CCOEFF_NORMED)
    row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
    if not scores[row, column] >= MIN_SCORE or row in (0, 2 * ROWS_PX):
        return np.nan
    above, here, below = scores[row - 1 : row + 2, column].astype(float)
    bend = above - 2 * here + below
    return abs(row - ROWS_PX + (0.5 * (above - below) / bend if bend < 0 else 0.0))
