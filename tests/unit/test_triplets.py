"""The frame before tells right matches from wrong ones on a shifted texture."""

from dataclasses import replace

import cv2
import numpy as np

from vo.map.local_map import Sighting, empty_map
from vo.tracking.association import Matches
from vo.tracking.circular_check import consistent

SHIFT_PX = np.array([3.0, -2.0])


def test_a_match_must_close_the_triangle():
    """Four landmarks: right, wrong, unseen by the frame before, and matched for the first time."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(30, 226, (30, 40), dtype=np.uint8)
    before = cv2.resize(coarse, (200, 150), interpolation=cv2.INTER_CUBIC)
    now = np.roll(before, SHIFT_PX.astype(int)[::-1], axis=(0, 1))
    pixels = np.array([[60.0, 50], [90, 70], [120, 60], [70, 100]])
    found = pixels + SHIFT_PX
    found[1] += [1.5, 0]
    ids = np.arange(4)
    measured = np.column_stack([found, np.full(4, np.nan)])
    matches = Matches(ids, ids, np.ones((4, 3)), ids, measured, np.ones((4, 3)), np.ones(4))
    landmarks = replace(empty_map().landmarks, ids=ids, views=np.array([5, 5, 5, 1]))
    sighting = Sighting(before, ids[:2], pixels[:2])
    keep = consistent(matches, landmarks, sighting, now, 9)
    np.testing.assert_array_equal(keep, [True, False, False, True])
