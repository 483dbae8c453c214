"""The previous frame tells right matches from wrong ones on a shifted texture."""

from dataclasses import replace

import cv2
import numpy as np

from vo.config import OdometrySettings
from vo.contract.observations import Observations
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.map.frame import Detection, Matches, View
from vo.map.local_map import TrackedFrame, empty_map
from vo.tracking.association import is_consistent

RIG = StereoRig(200, 150, 150.0, 99.5, 74.5, 0.09)
SHIFT_PX = np.array([3.0, -2.0])


def test_circular_check_keeps_matches_that_close_the_circle():
    """Four landmarks: right, wrong, not seen in the previous frame, matched for the first time."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(30, 226, (30, 40), dtype=np.uint8)
    before = cv2.resize(coarse, (200, 150), interpolation=cv2.INTER_CUBIC)
    now = np.roll(before, SHIFT_PX.astype(int)[::-1], axis=(0, 1))
    pixels = np.array([[60.0, 50], [90, 70], [120, 60], [70, 100]])
    found = pixels + SHIFT_PX
    found[1] += [1.5, 0]
    ids = np.arange(4)
    unknown = np.full(4, np.nan)
    matches = Matches(
        ids=ids, pixels=found, disparity_px=unknown, rows=ids, points_odom=np.ones((4, 3)),
        features=ids, zncc=np.ones(4),
    )  # fmt: skip
    landmarks = replace(empty_map().landmarks, ids=ids, views=np.array([5, 5, 5, 1]))
    previous = TrackedFrame(before, Observations(ids[:2], pixels[:2], unknown[:2]))
    none, settings = np.zeros((0, 0)), OdometrySettings()
    assert settings.matching.align_px == 9
    view = View(StereoFrame(1, now, now), RIG, Detection(lambda: (none, none)), none, settings)
    keep = is_consistent(matches, landmarks, previous, view)
    np.testing.assert_array_equal(keep, [True, False, False, True])
