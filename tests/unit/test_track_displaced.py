"""A pose by displacements does not choose the landmarks that confirm it."""

from dataclasses import replace

import numpy as np

from vo.config import OdometrySettings
from vo.contract import se3
from vo.contract.clock import Clock
from vo.contract.observations import Observations
from vo.contract.projection import project_points
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.hooks import NO_HOOKS
from vo.map.frame import Detection, Matches, View
from vo.map.local_map import empty_map
from vo.map.state import TrackerState
from vo.tracking.association import spread
from vo.tracking.budget import Budget
from vo.tracking.track_displaced import rank_landmarks, refine_on_inliers
from vo.tracking.tracked import Context

RIG = StereoRig(320, 240, 190.0, 159.5, 119.5, 0.09)
COUNT = 300


def matches_of_a_camera_at_the_origin(rng):
    """Matches with noise of a tenth of a pixel."""
    depth_m = rng.uniform(0.7, 4, COUNT)
    pixels = rng.uniform([0, 0], [319, 239], (COUNT, 2))
    points = RIG.triangulate(pixels, RIG.f_px * RIG.baseline_m / depth_m)
    seen = project_points(points, np.eye(4), RIG) + rng.normal(0, 0.1, (COUNT, 3))
    ids, none = np.arange(COUNT), empty_map().landmarks
    landmarks = replace(none, ids=ids, points_odom=points, spread_odom=np.zeros((COUNT, 3)))
    return Matches.of(landmarks, ids, seen[:, :2], seen[:, 2], np.full((COUNT, 3), 0.1))


def test_inliers_of_a_rough_pose_do_not_confirm_it():
    rng = np.random.default_rng(0)
    black, none = np.zeros((240, 320), np.uint8), np.zeros((0, 0))
    settings = OdometrySettings()
    frame, unseen = StereoFrame(1, black, black), Detection(lambda: (none, none))
    view = View(frame, RIG, unseen, none, settings)
    motion = settings.motion.model_copy(update={"threshold": 2.5 / RIG.f_px})
    rough = replace(view, settings=settings.model_copy(update={"motion": motion}))
    context, errors = Context(NO_HOOKS, rng, Clock(), Budget()), np.zeros((20, 2))
    for error in errors:
        matches = matches_of_a_camera_at_the_origin(rng)
        T_rough = se3.exp(rng.normal(0, [0.005] * 3 + [0.003] * 3))
        for k, views in enumerate([(view,), (rough, view)]):
            pose, _, _ = refine_on_inliers(T_rough, matches, TrackerState(), views, context)
            error[k] = np.linalg.norm(pose.T_world_cam[:3, 3])
    once, twice = np.sqrt(np.mean(errors**2, axis=0))
    assert twice < 0.5 * once
    assert twice < 0.0002


def test_landmarks_of_a_frame_are_those_of_most_information():
    """Of a cell's four, two: the sharp one, though far, then the nearest of the other two."""
    expected = np.array([[5.0, 5, 20], [6, 6, 12], [7, 7, 15], [8, 8, 50]])
    ids = np.arange(4)
    sigma_px = np.array([[0.4, 0.4, 1], [0.1, 0.1, 1], [0.4, 0.4, 1]])
    seen = Observations(ids[:3], expected[:3, :2], expected[:3, 2], sigma_px=sigma_px)
    known, worth = rank_landmarks(ids, expected, seen)
    np.testing.assert_array_equal(known, [True, True, True, False])
    np.testing.assert_array_equal(
        spread(ids, expected, known, 2, OdometrySettings(), worth), [0, 1]
    )
