"""Bound of runs whose tracks do not connect all frames."""

import numpy as np

from trials.diagnosis.bound import MIN_CROSSING, TrueTracks, connected
from trials.evaluation.alignment import Pair


def true_tracks(spans: list[tuple[int, int]]) -> TrueTracks:
    """Landmarks observed in every frame from their first to their last; residuals identify the
    observation."""
    camera = [k for first, last in spans for k in range(first + 1, last + 1)]
    point = [j for j, (first, last) in enumerate(spans) for _ in range(first + 1, last + 1)]
    residual = 100.0 * np.array(point) + np.array(camera)
    points = np.tile(np.arange(len(spans), dtype=float)[:, None], 3)
    born = np.array([first for first, _ in spans])
    return TrueTracks(
        points, born, np.array(camera), np.array(point), np.tile(residual[:, None], 3)
    )


def poses(count: int) -> Pair:
    T = np.tile(np.eye(4), (count, 1, 1))
    return Pair(np.arange(count), T, T)


def test_connected_keeps_tracks_that_connect_all_frames():
    spans = MIN_CROSSING * [(0, 3)] + MIN_CROSSING * [(3, 9)]
    pair, seen = connected(poses(10), true_tracks(spans))
    assert len(pair.timestamps_ns) == 10
    assert len(seen.points_world) == len(spans)
    assert len(seen.camera) == MIN_CROSSING * (3 + 6)


def test_connected_keeps_the_longest_part_of_broken_tracks():
    """Frames 0 to 3, then 4 to 9; one landmark less than needed crosses the gap."""
    spans = 8 * [(0, 3)] + 8 * [(4, 9)] + (MIN_CROSSING - 1) * [(2, 6)]
    pair, seen = connected(poses(10), true_tracks(spans))
    assert pair.timestamps_ns.tolist() == list(range(4, 10))
    assert seen.points_world[:, 0].tolist() == list(range(8, 16))  # born there
    assert seen.born.tolist() == 8 * [0]
    assert sorted(set(seen.camera.tolist())) == [1, 2, 3, 4, 5]
    expected = 100 * (seen.point + 8) + seen.camera + 4
    assert np.array_equal(seen.residual_px[:, 0], expected)
