"""Free space, ways through it and places in it, against geometry worked out by hand."""

import math
from itertools import pairwise

import numpy as np
import pytest
from gym_worlds import write_yard

from sim.batch import build
from sim.world.world import build_world
from trials.gym.env.settings import NavSettings
from trials.gym.world.distance_field import Passages, way_length_m
from trials.gym.world.free_space import hard, standing, survey_free_space
from trials.gym.world.start_goal_sampling import TrialError, check_place, draw_errand, main_part
from vo.contract.errors import SettingsError

CLEARANCE_M = 0.3


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    file = write_yard(tmp_path_factory.mktemp("yard"))
    settings = NavSettings(scene=str(file)).recorded(0)
    return build_world(build(str(file), settings), settings)


@pytest.fixture(scope="module")
def passages(world):
    return Passages(survey_free_space(world, 0.5), CLEARANCE_M)


@pytest.fixture(scope="module")
def part(passages, world):
    return main_part(passages, world.path.waypoints, "yard")


def test_room_is_the_distance_to_the_nearest_outline(passages):
    free = passages.free
    rng = np.random.default_rng(0)
    for point in rng.uniform(-2.9, 2.9, (300, 2)):
        to_pillar = np.linalg.norm(point) - 0.3
        to_wall = 3.0 - np.abs(point).max()
        expected = max(0.0, min(to_pillar, to_wall))
        room = free.room_m[tuple(free.cells(point))]
        assert room == pytest.approx(expected, abs=1.5 * free.cell_m)


def test_what_is_overhead_or_underfoot_is_no_obstacle_but_touching_a_wall_counts(world):
    names = [world.model.geom(int(k)).name for k in np.flatnonzero(standing(world))]
    assert set(names) == {"north", "south", "east", "west", "pillar", "roof"}
    free = survey_free_space(world, 0.5)
    assert free.room_m[tuple(free.cells(np.array([-2.0, 2.0])))] > 0.9  # under the roof
    assert free.room_m[tuple(free.cells(np.array([2.0, -2.0])))] > 0.9  # on the mat
    low = survey_free_space(world, 1.4)
    assert low.room_m[tuple(low.cells(np.array([-2.0, 2.0])))] == 0
    np.testing.assert_array_equal(hard(world), standing(world))


def test_cells_and_points_are_inverse(passages):
    free = passages.free
    cells = np.argwhere(free.room_m > 0)
    np.testing.assert_array_equal(free.cells(free.points(cells)), cells)


def test_a_way_around_the_pillar_is_the_taut_string(passages):
    a, b = np.array([-2.0, 0.0]), np.array([2.0, 0.0])
    ways = passages.ways_to(b)
    way = ways.from_point(a)
    radius = 0.3 + CLEARANCE_M
    tangent = math.sqrt(2.0**2 - radius**2)
    arc = radius * (math.pi - 2 * math.acos(radius / 2.0))
    taut = 2 * tangent + arc
    assert taut - 0.02 < way_length_m(way) < 1.03 * taut
    np.testing.assert_array_equal(way[[0, -1]], [a, b])
    for p, q in pairwise(way):
        assert passages.sees(p, q)
    assert not passages.sees(a, b)
    along_grid = ways.length_m(a)  # octile: at most 8.3 % longer than straight
    assert way_length_m(way) - 0.05 < along_grid < 1.09 * taut
    assert passages.sees(np.array([-2.0, 1.0]), np.array([2.0, 1.0]))


def test_lengths_outside_the_room_go_on_growing(passages):
    ways = passages.ways_to(np.array([2.0, 2.0]))
    assert np.isfinite(ways.length_m(np.array([0.0, 0.0])))  # inside the pillar
    beside = ways.length_m(np.array([-2.6, -2.6]))
    assert ways.length_m(np.array([-2.95, -2.95])) > beside > 6.0


def test_errands_are_seeded_reachable_and_as_long_as_asked(passages, part):
    for seed in range(20):
        errand = draw_errand(passages, part, (2.0, 4.0), np.random.default_rng(seed))
        again = draw_errand(passages, part, (2.0, 4.0), np.random.default_rng(seed))
        np.testing.assert_array_equal(errand.start, again.start)
        np.testing.assert_array_equal(errand.goal, again.goal)
        for place in (errand.start[:2], errand.goal):
            check_place(passages, "place", place)
        length = errand.ways.length_m(errand.start[:2])
        assert 2.0 - 1e-6 <= length <= 4.0 + 1e-6
        ahead = errand.waypoints[1] - errand.waypoints[0]
        askew = math.remainder(errand.start[2] - math.atan2(ahead[1], ahead[0]), 2 * math.pi)
        assert abs(askew) <= math.radians(30)


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        ((0.1, 0.0), "goal (0.1, 0) m: inside pillar"),
        ((2.9, 0.0), "of room beside east, the rover needs 0.3 m"),
        ((99.0, 0.0), "outside the world"),
        ((3.6, 0.0), "no way from the start (-2, 0) m"),
    ],
)
def test_a_goal_that_cannot_be_reached_is_refused_by_name(passages, part, goal, said):
    start, rng = np.array([-2.0, 0.0, 0.0]), np.random.default_rng(0)
    with pytest.raises(TrialError, match="goal") as error:
        draw_errand(passages, part, (1, 9), rng, start, np.array(goal))
    assert said in str(error.value)


def test_a_distance_that_no_two_places_have_is_refused(passages, part):
    with pytest.raises(TrialError, match="no two free places whose way is 50 to 60 m long"):
        draw_errand(passages, part, (50.0, 60.0), np.random.default_rng(0))


def test_a_world_without_room_is_refused(passages, world):
    with pytest.raises(TrialError, match="scene yard: no free place with 5 m of room"):
        main_part(Passages(passages.free, 5.0), world.path.waypoints, "yard")


def test_settings_that_contradict_each_other_are_refused():
    with pytest.raises(ValueError, match="the first must be the smaller"):
        NavSettings(distance_m=(5.0, 4.0))
    with pytest.raises(SettingsError, match=r"unknown setting rig\.wide; valid here"):
        NavSettings(settings={"rig.wide": 3}).recorded(0)
    with pytest.raises(SettingsError, match="unknown disturbance fog"):
        NavSettings(disturb="fog").recorded(0)
