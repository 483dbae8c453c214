"""A ribbon's coordinates: distances along and across are kept."""

import numpy as np
import pytest

from scenes.geometry.routes import Ribbon, rounded_loop

RIBBON = Ribbon(
    rounded_loop(np.array([(9.0, -5), (9, 5), (-9, 5), (-9, -5)]), radius_m=3.0, step_m=0.05)
)


def test_ribbon_offsets_are_distances_to_the_left():
    s = np.linspace(0, RIBBON.length_m, 50)
    middle = RIBBON.at(np.column_stack([s, 0 * s]))
    left = RIBBON.at(np.column_stack([s, 0 * s + 1.2]))
    np.testing.assert_allclose(np.linalg.norm(left - middle, axis=1), 1.2, rtol=1e-3)
    ahead = RIBBON.at(np.column_stack([s + 0.05, 0 * s])) - middle
    turn = ahead[:, 0] * (left - middle)[:, 1] - ahead[:, 1] * (left - middle)[:, 0]
    assert (turn > 0).all()


def test_ribbon_along_is_arc_length_and_closes():
    start, end = RIBBON.at(np.array([(0.0, 0.5), (RIBBON.length_m, 0.5)]))
    np.testing.assert_allclose(start, end, atol=1e-9)
    step = RIBBON.at(np.array([(4.0, 0.0), (4.5, 0.0)]))
    assert np.linalg.norm(step[1] - step[0]) == pytest.approx(0.5, rel=1e-3)


def test_ribbon_yaw_points_along_the_route():
    for s in (1.0, 7.3, 20.0):
        a, b = RIBBON.at(np.array([(s - 0.02, 0.0), (s + 0.02, 0.0)]))
        assert np.cos(RIBBON.yaw(s) - np.arctan2(*(b - a)[::-1])) > 0.9999
