"""Landmarks followed from the frame before, where templates of keyframes do not match.

A blurred image resembles no sharp template, but it resembles the frame before, blurred alike.
Errors add up from frame to frame, so this only bridges frames until a keyframe has such templates.

Source: Bouguet, Pyramidal Implementation of the Lucas Kanade Feature Tracker, 2000 (in OpenCV).
"""

import cv2
import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.rig import StereoRig
from vo.map.frame import View
from vo.map.local_map import LocalMap, Sighting
from vo.stereo.sparse import measure_disparities
from vo.tracking.association import NO_FEATURE, Matches, expected_at

WINDOW_PX, LEVELS = 21, 3
"""Of the pyramid: blur of 20 pixels is one of few on its top."""

CLOSURE_PX = 1.0
"""Most by which following there and back may miss."""

SIGMA_PX = 0.5
"""Standard deviation of u and v."""


def follow(
    before: Sighting,
    local_map: LocalMap,
    view: View,
    T_odom_cam: Array,
    rig: StereoRig,
) -> Matches:
    """Follow what the frame before saw into a new view.

    Args:
        before: The last frame that had a pose.
        local_map: Of which it saw landmarks.
        view: The new frame.
        T_odom_cam: (4, 4) guessed pose, where following begins.
        rig: Projects.
    """
    s = view.settings
    rows = np.flatnonzero(np.isin(local_map.landmarks.ids, before.ids))
    landmarks = local_map.landmarks.select(rows)
    start = before.pixels[np.searchsorted(before.ids, landmarks.ids)]
    expected = expected_at(landmarks, T_odom_cam, rig)
    ahead = np.isfinite(expected).all(axis=1)
    rows, start, expected = rows[ahead], start[ahead], expected[ahead]
    pixels = _flow(before.left, view.frame.left, start, expected[:, :2])
    returned = _flow(view.frame.left, before.left, pixels, start)
    closed = np.abs(returned - start).max(axis=1, initial=0) < CLOSURE_PX
    rows, pixels, expected = rows[closed], pixels[closed], expected[closed]
    stereo = measure_disparities(
        view.frame, view.dense, pixels, s.stereo,
        expected_px=expected[:, 2], slopes=local_map.landmarks.anchor_slopes[rows],
    )  # fmt: skip
    n = len(rows)
    sigma_d = np.hypot(stereo.sigma_px, s.refinement.sigma_disparity_px)
    return Matches(
        rows,
        local_map.landmarks.ids[rows],
        local_map.landmarks.points_odom[rows],
        np.full(n, NO_FEATURE),
        np.column_stack([pixels, stereo.values_px]),
        np.column_stack([np.full((n, 2), SIGMA_PX), local_map.noise[1] * sigma_d]),
        np.full(n, np.nan),
    )


def _flow(before: Image, now: Image, start: Array, guess: Array) -> Array:
    """Where (N, 2) pixels went; NaN where they cannot be followed."""
    pixels = np.full(start.shape, np.nan)
    known = np.isfinite(guess).all(axis=1)
    if not known.any():
        return pixels
    old, new = (x[known].astype(np.float32).reshape(-1, 1, 2) for x in (start, guess))
    end, found, _ = cv2.calcOpticalFlowPyrLK(
        before, now, old, new, winSize=(WINDOW_PX, WINDOW_PX), maxLevel=LEVELS,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )  # fmt: skip
    pixels[known] = np.where(found.reshape(-1, 1) == 1, end.reshape(-1, 2), np.nan)
    height, width = now.shape
    with np.errstate(invalid="ignore"):
        pixels[((pixels < 0) | (pixels > (width - 1, height - 1))).any(axis=1)] = np.nan
    return pixels
