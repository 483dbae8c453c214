"""Maps that began on a bad image are left soon: a view that shows more, or a new start."""

import numpy as np
import pytest

from vo.config import RefinementSettings
from vo.map.local_map import Keyframe, Landmarks, empty_map
from vo.map.state import PROVEN_VIEWS, Journey
from vo.mapping.keyframes import is_new_view
from vo.tracking.association import Matches

PATIENCE = 5


def _keyframe(count: int) -> Keyframe:
    rng = np.random.default_rng(0)
    measured = rng.uniform([20, 20, 5], [620, 460, 30], (count, 3))
    left = np.zeros((480, 640), np.uint8)
    return Keyframe(
        0, np.eye(4), np.zeros((6, 6)), left, np.arange(count), measured, np.ones((count, 3))
    )


def _matches(keyframe: Keyframe, count: int, flow_px: float) -> Matches:
    ids = keyframe.ids[:count]
    measured = keyframe.measured[:count] + np.array([flow_px, 0, 0])
    points = np.ones((count, 3))
    return Matches(ids, ids, points, ids, measured, np.ones((count, 3)), np.ones(count))


@pytest.mark.parametrize(
    ("count", "flow_px", "new"), [(24, 3.0, True), (26, 3.0, False), (24, 0.5, False)]
)
def test_few_inliers_are_a_reason_for_a_keyframe_if_the_camera_moved(count, flow_px, new) -> None:
    keyframe = _keyframe(40)
    matches = _matches(keyframe, count, flow_px)
    assert is_new_view(keyframe, matches, RefinementSettings(), least=25) == new
    assert not is_new_view(keyframe, matches, RefinementSettings())


def test_a_keyframe_begins_when_the_near_landmarks_have_left_however_many_far_ones_stay() -> None:
    keyframe = _keyframe(200)
    keyframe.measured[:160, 2], keyframe.measured[160:, 2] = 4.0, 40.0
    everything, far = _matches(keyframe, 200, 3.0), _matches(keyframe, 160, 3.0)
    assert not is_new_view(keyframe, everything, RefinementSettings())
    assert is_new_view(keyframe, far, RefinementSettings())
    near = Matches(**{name: value[160:] for name, value in vars(everything).items()})
    assert not is_new_view(keyframe, near, RefinementSettings())


@pytest.mark.parametrize("views", [1, PROVEN_VIEWS - 1, PROVEN_VIEWS, PATIENCE, 10 * PATIENCE])
def test_a_map_is_waited_for_as_long_as_it_was_seen(views: int) -> None:
    journey, n = Journey(), 20
    landmarks = Landmarks(
        np.arange(n), np.ones((n, 3)), np.zeros((n, 9)), np.full(n, views), np.zeros(n, np.int64),
        np.ones((n, 2)), np.ones(n), np.zeros((n, 2)),
    )  # fmt: skip
    start = empty_map(1, n)
    journey.map = type(start)((_keyframe(n),), landmarks, 1, n)
    waited = 0
    while journey.map.keyframes:
        journey.lose(PATIENCE)
        waited += 1
    proven = views >= PROVEN_VIEWS
    assert waited == (min(PATIENCE, views) + 1 if proven else 1)
    assert (journey.lost_map is not None) == proven
