"""KLT over a shifted texture, smeared in both frames."""

from dataclasses import replace

import cv2
import numpy as np

from vo.config import OdometrySettings
from vo.contract.observations import Observations
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.map.frame import Detection, View
from vo.map.local_map import TrackedFrame, empty_map
from vo.tracking.klt import SIGMA_PX, track_klt

RIG = StereoRig(320, 240, 230.0, 159.5, 119.5, 0.09)
DISPARITY_PX, SHIFT_PX = 12, 9
"""Of a wall, and how far it moves to the left from frame to frame."""


def wall(shift_px):
    """A wall (240, 320) that lies so many pixels further left."""
    coarse = np.random.default_rng(3).integers(30, 226, (48, 80), dtype=np.uint8)
    wide = cv2.resize(coarse, (480, 288), interpolation=cv2.INTER_CUBIC)
    wide = cv2.blur(wide, (15, 1))
    return np.ascontiguousarray(wide[20:260, 60 + shift_px : 380 + shift_px])


def view_of(frame):
    """A view without features: KLT needs none."""
    detection = Detection(lambda: (np.zeros((0, 2)), np.zeros((0, 169))))
    return View(frame, RIG, detection, np.zeros((0, 0)), OdometrySettings())


def previous(ids, pixels):
    return TrackedFrame(wall(0), Observations(ids, pixels, np.full(len(ids), np.nan)))


def test_klt_tracks_known_landmarks_of_the_previous_frame():
    pixels = np.array([[100.0, 60], [160, 120], [220, 180], [120, 200], [4, 100]])
    ids = np.array([3, 5, 8, 9, 11])
    depth_m = RIG.f_px * RIG.baseline_m / DISPARITY_PX
    points = np.column_stack([RIG.normalized(pixels), np.ones(5)]) * depth_m
    known = np.array([0, 1, 3, 4])  # the map has dropped one of them
    landmarks = replace(
        empty_map().landmarks,
        ids=ids[known],
        points_odom=points[known],
        spread_odom=np.zeros((4, 3)),
        descriptors=np.zeros((4, 169)),
        views=np.full(4, 3),
        anchor=np.zeros(4, np.int64),
        anchor_pixels=pixels[known],
        anchor_depth_m=np.full(4, depth_m),
        anchor_slopes=np.zeros((4, 2)),
    )
    local_map = replace(empty_map(), landmarks=landmarks)
    frame = StereoFrame(1, wall(SHIFT_PX), wall(SHIFT_PX + DISPARITY_PX))
    found = track_klt(previous(ids, pixels), local_map, view_of(frame), np.eye(4))
    assert np.isnan(found.zncc).all()  # templates are not used
    np.testing.assert_array_equal(found.ids, [3, 5, 9])  # the last one has left the image
    np.testing.assert_allclose(found.pixels, pixels[[0, 1, 3]] - [SHIFT_PX, 0], atol=0.3)
    np.testing.assert_allclose(found.disparity_px, DISPARITY_PX, atol=0.3)
    assert (found.sigma_px[:, :2] == SIGMA_PX).all()


def test_klt_without_observations_is_empty():
    frame = StereoFrame(1, wall(0), wall(DISPARITY_PX))
    before = previous(np.zeros(0, np.int64), np.zeros((0, 2)))
    assert len(track_klt(before, empty_map(), view_of(frame), np.eye(4))) == 0
