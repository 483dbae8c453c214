"""Twins: the stretch of a route that turns as a real path did, and how near a scene is."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scenes.geometry.routes import arc_lengths, rounded_loop
from trials.evaluation.runs import SavedRun
from trials.realism.comparison import Comparison, Distance
from trials.realism.landmarks import steps_of
from trials.realism.quantities import Measured
from trials.realism.twin_route import route_of, stretch_of
from trials.realism.twins import UNKNOWN_RATIO, halts_of, mean_ratio, places_of
from vo.contract.trajectory import Trajectory

LOOP = rounded_loop(np.array([(0, 0), (30, 0), (30, 8), (0, 8)], float), 3.0)
STEP_M = 0.5


def turned(waypoints):
    headings = np.unwrap(np.arctan2(*np.diff(waypoints, axis=0).T[::-1]))
    return np.ptp(headings)


def test_straight_path_gets_the_straight_stretch():
    found = stretch_of(LOOP, 15.0, STEP_M, np.zeros(20))
    assert turned(found) < 0.02
    assert arc_lengths(found)[-1] == pytest.approx(15, abs=0.1)
    assert abs(LOOP[:, None] - found[None]).max(axis=2).min(axis=0).max() < 0.1  # on the route


def test_winding_path_gets_a_stretch_with_corners():
    turns = np.where(np.arange(20) % 4 < 2, STEP_M / 3, 0.0)  # half of it on arcs of 3 m
    assert turned(stretch_of(LOOP, 10.0, STEP_M, turns)) > 1.4


def test_stretch_of_a_closed_route_may_cross_its_start():
    """Only the edge in which this loop begins is straight for 20 m."""
    loop = np.roll(LOOP[:-1], len(LOOP) // 2 - np.argmin(LOOP[:-1, 1]), axis=0)
    loop = np.vstack([loop, loop[:1]])
    assert turned(stretch_of(loop, 20.0, STEP_M, np.zeros(20))) < 0.02


def test_route_without_a_choice_has_none():
    assert stretch_of(LOOP, 200.0, STEP_M, np.zeros(5)) is None
    assert stretch_of(LOOP, 5.0, STEP_M, np.zeros(0)) is None


def test_stretch_of_an_open_route_stays_on_it():
    route = np.array([(0.0, 0.0), (10.0, 0.0)])
    found = stretch_of(route, 8.0, STEP_M, np.zeros(5))
    assert found[:, 0].min() >= 0
    assert found[:, 0].max() <= 10.01
    assert arc_lengths(found)[-1] == pytest.approx(8, abs=0.1)


def test_steps_and_turns_of_a_path():
    """One metre ahead, then 0.1 rad to the right (clockwise from above) on the spot."""
    T = np.tile(np.eye(4), (3, 1, 1))
    T[1:, 2, 3] = 1.0
    T[2, :3, :3] = Rotation.from_rotvec([0, 0.1, 0]).as_matrix()
    run = SavedRun(Path("run.txt"), "", Trajectory(np.arange(3), T))
    steps_m, turns = steps_of(run)
    assert steps_m == pytest.approx([1, 0])
    assert turns == pytest.approx([0, 0.1])


def test_missing_landmarks_count_as_far():
    both = {"grey": Distance("grey", 0.1, 0.01, 0.02), "motion": Distance("motion", 0.2)}
    default = Comparison(*(Measured("x", 4, {}),) * 2, both)
    assert mean_ratio(default, default) == pytest.approx(1)
    lost = Comparison(*(Measured("x", 4, {}),) * 2, {**both, "motion": Distance("motion")})
    assert mean_ratio(lost, default) == pytest.approx(UNKNOWN_RATIO**0.5)


def test_halts_are_in_proportion():
    steps_m = np.r_[np.zeros(9), np.full(40, 0.04), np.zeros(10), np.full(40, 0.04)]
    assert halts_of(steps_m, 100) == (2, 19.0)
    assert halts_of(steps_m, 50) == (1, 9.5)
    assert halts_of(steps_m, 4) == (0, 0.0)  # less than two frames
    assert halts_of(np.full(20, 0.04), 50) == (0, 0.0)
    assert halts_of(np.zeros(0), 50) == (0, 0.0)


def test_sandbox_is_two_places_of_one_route():
    garden, hall = places_of(["sandbox"])
    assert (garden.label, hall.label) == ("sandbox", "sandbox scene.surround=hall")
    assert np.array_equal(route_of("sandbox", 1), route_of("sandbox", 1, hall.options))
