"""Landmarks followed over a shifted texture, smeared in both frames."""

from dataclasses import replace

import cv2
import numpy as np

from vo.config import OdometrySettings
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.features.detector import Features
from vo.map.frame import View
from vo.map.local_map import Sighting, empty_map
from vo.tracking.klt import SIGMA_PX, follow

RIG = StereoRig(320, 240, 230.0, 159.5, 119.5, 0.09)
DISPARITY_PX, SHIFT_PX = 12, 9
"""Of a wall, and how far it moves to the left from frame to frame."""


def wall(shift_px):
    """A wall (240, 320) that lies so many pixels further left."""
    coarse = np.random.default_rng(3).integers(30, 226, (48, 80), dtype=np.uint8)
    wide = cv2.resize(coarse, (480, 288), interpolation=cv2.INTER_CUBIC)
    wide = cv2.blur(wide, (15, 1))
    return np.ascontiguousarray(wide[20:260, 60 + shift_px : 380 + shift_px])


def seen(frame):
    """A view without features: following needs none."""
    features = Features(np.zeros((0, 2)))
    return View(frame, features, np.zeros((0, 169)), np.zeros((0, 0)), OdometrySettings())


def test_what_the_frame_before_saw_is_found_by_identity():
    pixels = np.array([[100.0, 60], [160, 120], [220, 180], [120, 200], [4, 100]])
    ids = np.array([3, 5, 8, 9, 11])
    depth_m = RIG.f_px * RIG.baseline_m / DISPARITY_PX
    points = np.column_stack([RIG.normalized(pixels), np.ones(5)]) * depth_m
    known = np.array([0, 1, 3, 4])  # the map has dropped one of them
    landmarks = replace(
        empty_map().landmarks,
        ids=ids[known],
        points_odom=points[known],
        vectors=np.zeros((4, 169)),
        views=np.full(4, 3),
        anchor=np.zeros(4, np.int64),
        anchor_pixels=pixels[known],
        anchor_depth_m=np.full(4, depth_m),
        anchor_slopes=np.zeros((4, 2)),
    )
    local_map = replace(empty_map(), landmarks=landmarks)
    frame = StereoFrame(1, wall(SHIFT_PX), wall(SHIFT_PX + DISPARITY_PX))
    found = follow(Sighting(wall(0), ids, pixels), local_map, seen(frame), np.eye(4), RIG)
    assert np.isnan(found.zncc).all()  # nobody asked the templates
    np.testing.assert_array_equal(found.ids, [3, 5, 9])  # the last one has left the image
    np.testing.assert_allclose(found.pixels, pixels[[0, 1, 3]] - [SHIFT_PX, 0], atol=0.3)
    np.testing.assert_allclose(found.measured[:, 2], DISPARITY_PX, atol=0.3)
    assert (found.sigma[:, :2] == SIGMA_PX).all()


def test_nothing_was_seen_before():
    frame = StereoFrame(1, wall(0), wall(DISPARITY_PX))
    before = Sighting(wall(0), np.zeros(0, np.int64), np.zeros((0, 2)))
    assert len(follow(before, empty_map(), seen(frame), np.eye(4), RIG)) == 0
