"""KLT tracking of landmarks from the previous frame, where templates of keyframes do not match.

A blurred image does not resemble a sharp template, but it resembles the previous frame with the
same blur. Errors accumulate, so KLT only bridges frames until a keyframe holds such templates.

Source: Bouguet, Pyramidal Implementation of the Lucas Kanade Feature Tracker, 2000 (in OpenCV).
"""

import cv2
import numpy as np

from vo.contract.arrays import Array, Image
from vo.map.frame import Matches, View
from vo.map.local_map import LocalMap, TrackedFrame
from vo.stereo.sparse import measure_disparities
from vo.tracking.association import project_landmarks

WINDOW_PX, LEVELS = 21, 3
"""Of the pyramid: blur of 20 pixels is one of few on its top."""

MAX_CLOSURE_PX = 1.0
"""Largest error of tracking forwards and backwards."""

SIGMA_PX = 0.5
"""Standard deviation of u and v."""


def track_klt(
    previous: TrackedFrame, local_map: LocalMap, view: View, T_odom_cam: Array
) -> Matches:
    """Track the previous frame's observations into a view, from projections by a pose (4, 4)."""
    s, seen = view.settings, previous.observations
    rows = np.flatnonzero(np.isin(local_map.landmarks.ids, seen.ids))
    landmarks = local_map.landmarks.select(rows)
    start = seen.pixels[np.searchsorted(seen.ids, landmarks.ids)]
    expected = project_landmarks(landmarks, T_odom_cam, view)
    ahead = np.isfinite(expected).all(axis=1)
    rows, start, expected = rows[ahead], start[ahead], expected[ahead]
    pixels = _flow(previous.left, view.frame.left, start, expected[:, :2])
    returned = _flow(view.frame.left, previous.left, pixels, start)
    closed = np.abs(returned - start).max(axis=1, initial=0) < MAX_CLOSURE_PX
    rows, pixels, expected = rows[closed], pixels[closed], expected[closed]
    stereo = measure_disparities(
        view.frame, view.dense, pixels, s.stereo,
        expected_px=expected[:, 2], slopes=local_map.landmarks.anchor_slopes[rows],
    )  # fmt: skip
    sigma_d = local_map.noise[1] * np.hypot(stereo.sigma_px, s.refinement.sigma_disparity_px)
    sigma_px = np.column_stack([np.full((len(rows), 2), SIGMA_PX), sigma_d])
    return Matches.of(local_map.landmarks, rows, pixels, stereo.values_px, sigma_px)


def _flow(before: Image, now: Image, start: Array, guess: Array) -> Array:
    """Positions (N, 2) of pixels in another image; NaN where they cannot be tracked."""
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
