"""Free space, shortest paths, and start and goal, against geometry worked out by hand."""

import math
from itertools import pairwise

import numpy as np
import pytest
from gym_worlds import write_yard

from sim.batch import build
from sim.world.world import World, build_world
from trials.gym.env.settings import NavSettings
from trials.gym.world.free_space import (
    TraversableSpace,
    map_free_space,
    path_length_m,
    rigid_geoms,
    static_geoms,
)
from trials.gym.world.start_goal_sampling import (
    TrialError,
    expect_clear,
    expect_route,
    main_component,
    sample_start_goal,
)
from vo.contract.errors import SettingsError

CLEARANCE_M = 0.3


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    file = write_yard(tmp_path_factory.mktemp("yard"))
    settings = NavSettings(scene=str(file)).recorded(0)
    return build_world(build(str(file), settings), settings)


@pytest.fixture(scope="module")
def traversable(world):
    return TraversableSpace(map_free_space(world, 0.5), CLEARANCE_M)


@pytest.fixture(scope="module")
def component(traversable, world):
    return main_component(traversable, world.path.waypoints, "yard")


def test_clearance_is_the_distance_to_the_nearest_outline(traversable):
    space = traversable.space
    rng = np.random.default_rng(0)
    for point in rng.uniform(-2.9, 2.9, (300, 2)):
        to_pillar = np.linalg.norm(point) - 0.3
        to_wall = 3.0 - np.abs(point).max()
        expected = max(0.0, min(to_pillar, to_wall))
        clearance = space.clearance_m[tuple(space.cells(point))]
        assert clearance == pytest.approx(expected, abs=1.5 * space.cell_m)


def test_free_space_ignores_what_is_overhead_or_underfoot(world):
    names = [world.model.geom(int(k)).name for k in np.flatnonzero(static_geoms(world))]
    assert set(names) == {"north", "south", "east", "west", "pillar", "roof"}
    space = map_free_space(world, 0.5)
    assert space.clearance_m[tuple(space.cells(np.array([-2.0, 2.0])))] > 0.9  # under the roof
    assert space.clearance_m[tuple(space.cells(np.array([2.0, -2.0])))] > 0.9  # on the mat
    low = map_free_space(world, 1.4)
    assert low.clearance_m[tuple(low.cells(np.array([-2.0, 2.0])))] == 0
    np.testing.assert_array_equal(rigid_geoms(world), static_geoms(world))


def test_free_space_cells_and_points_are_inverse(traversable):
    space = traversable.space
    cells = np.argwhere(space.clearance_m > 0)
    np.testing.assert_array_equal(space.cells(space.points(cells)), cells)


def test_shortest_path_around_the_pillar_is_the_taut_string(traversable):
    a, b = np.array([-2.0, 0.0]), np.array([2.0, 0.0])
    field = traversable.distance_field(b)
    path = field.path_from(a)
    radius = 0.3 + CLEARANCE_M
    tangent = math.sqrt(2.0**2 - radius**2)
    arc = radius * (math.pi - 2 * math.acos(radius / 2.0))
    taut = 2 * tangent + arc
    assert taut - 0.02 < path_length_m(path) < 1.03 * taut
    np.testing.assert_array_equal(path[[0, -1]], [a, b])
    for p, q in pairwise(path):
        assert traversable.has_line(p, q)
    assert not traversable.has_line(a, b)
    near = np.where(field.distances_m <= 2.5, field.distances_m, np.inf)
    np.testing.assert_array_equal(traversable.distances_m(b, 2.5), near)
    along_grid = field.distance_m(a)  # octile: at most 8.3 % longer than straight
    assert path_length_m(path) - 0.05 < along_grid < 1.09 * taut
    assert traversable.has_line(np.array([-2.0, 1.0]), np.array([2.0, 1.0]))


def test_distance_field_grows_where_there_is_no_clearance(traversable):
    field = traversable.distance_field(np.array([2.0, 2.0]))
    assert np.isfinite(field.distance_m(np.array([0.0, 0.0])))  # inside the pillar
    beside = field.distance_m(np.array([-2.6, -2.6]))
    assert field.distance_m(np.array([-2.95, -2.95])) > beside > 6.0


def test_start_goal_is_seeded_reachable_and_at_the_distance(traversable, component):
    for seed in range(20):
        ends = sample_start_goal(traversable, component, (2.0, 4.0), np.random.default_rng(seed))
        again = sample_start_goal(traversable, component, (2.0, 4.0), np.random.default_rng(seed))
        np.testing.assert_array_equal(ends.start, again.start)
        np.testing.assert_array_equal(ends.field.goal, again.field.goal)
        for place in (ends.start[:2], ends.field.goal):
            expect_clear(traversable, "place", place)
        length = ends.field.distance_m(ends.start[:2])
        assert 2.0 - 1e-6 <= length <= 4.0 + 1e-6
        ahead = ends.path[1] - ends.path[0]
        askew = math.remainder(ends.start[2] - math.atan2(ahead[1], ahead[0]), 2 * math.pi)
        assert abs(askew) <= math.radians(30)


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        ((0.1, 0.0), "goal (0.1, 0) m: inside pillar"),
        ((2.9, 0.0), "of clearance beside east, the rover needs 0.3 m"),
        ((99.0, 0.0), "outside the world"),
        ((3.6, 0.0), "no path from the start (-2, 0) m"),
    ],
)
def test_start_goal_names_why_a_goal_is_refused(traversable, component, goal, said):
    start, rng = np.array([-2.0, 0.0, 0.0]), np.random.default_rng(0)
    with pytest.raises(TrialError, match="goal") as error:
        sample_start_goal(traversable, component, (1, 9), rng, start, np.array(goal))
    assert said in str(error.value)


def test_start_goal_refuses_an_impossible_distance(traversable, component):
    with pytest.raises(TrialError, match="no start and goal with a path of 50 to 60 m"):
        sample_start_goal(traversable, component, (50.0, 60.0), np.random.default_rng(0))


def test_main_component_refuses_a_world_without_clearance(traversable, world):
    with pytest.raises(TrialError, match="scene yard: no place with 5 m of clearance"):
        main_component(TraversableSpace(traversable.space, 5.0), world.path.waypoints, "yard")


SLAB = '<geom type="box" name="slab" pos="0 -.5 -.1" size="2 1.5 .1"/>'
TILES = "".join(
    f'<geom type="box" pos="{x} {y} -.05" size=".5 .5 .05" rgba="1 1 1 {abs(x) % 2}"/>'
    for x in range(-2, 3)
    for y in range(-2, 3)
    if (x, y) != (1, 1)
)
PLANES = """<geom type="plane" size="9 9 1"/><geom type="box" pos="3 0 .5" size=".1 .1 .5"/>
<geom name="wall" type="plane" size="9 9 1" pos="1.6 0 0" zaxis="-1 0 0"/>"""


def world_on(ground: str, folder) -> World:
    file = folder / "world.xml"
    file.write_text(f"<mujoco><worldbody>{ground}</worldbody></mujoco>")
    settings = NavSettings(scene=str(file)).recorded(0)
    return build_world(build(str(file), settings), settings)


@pytest.mark.parametrize(
    ("ground", "outside", "said"),
    [
        (SLAB, lambda x, y: (abs(x) > 1.75) | (abs(y + 0.5) > 1.25), "there is no ground"),
        (TILES, lambda x, y: (abs(x - 1) < 0.75) & (abs(y - 1) < 0.75), "there is no ground"),
        (PLANES, lambda x, _: x > 1.35, "inside wall"),
    ],
)
def test_users_world_has_no_goal_off_its_ground(tmp_path, ground, outside, said):
    world = world_on(ground, tmp_path)
    traversable = TraversableSpace(map_free_space(world, 0.5), CLEARANCE_M)
    x, y = traversable.space.points(np.argwhere(traversable.mask)).T
    assert len(x) > 500
    assert not outside(x, y).any()
    with pytest.raises(TrialError, match=f"goal .* m: .*{said}"):
        expect_clear(traversable, "goal", np.array([1.9, 1.2] if ground != TILES else [1.0, 1.0]))
    on = main_component(traversable, world.path.waypoints, "world")
    sample_start_goal(traversable, on, (1.0, 5.0), np.random.default_rng(0))


def test_sampled_places_keep_to_the_drawn_part_of_a_plane(tmp_path):
    plane = '<geom type="plane" size="1.5 1.5 1"/><geom type="box" pos="4 0 .5" size=".1 .1 .5"/>'
    traversable = TraversableSpace(map_free_space(world_on(plane, tmp_path), 0.5), CLEARANCE_M)
    expect_clear(traversable, "goal", np.array([3.0, 0.5]))
    expect_route(traversable, np.array([[0.0, 0.0], [3.0, 0.5]]))
    rng, on = np.random.default_rng(0), traversable.mask
    for _ in range(20):
        ends = sample_start_goal(traversable, on, (0.5, 9.0), rng)
        assert np.abs(ends.path[[0, -1]]).max() <= 1.55


def test_what_stands_far_away_does_not_coarsen_the_map(tmp_path):
    far = '<geom type="box" pos="4000 0 9" size="9 9 9"/>'
    space = map_free_space(world_on(SLAB + far, tmp_path), 0.5)
    assert space.cell_m == 0.05
    assert max(space.obstacles.shape) < 110


def test_route_off_the_ground_is_refused(tmp_path):
    traversable = TraversableSpace(map_free_space(world_on(SLAB, tmp_path), 0.5), CLEARANCE_M)
    expect_route(traversable, np.array([[0.0, -1.0], [1.9, -1.0]]))
    with pytest.raises(TrialError, match=r"route near \(0\.00, 1\.50\) m: there is no ground"):
        expect_route(traversable, np.array([[0.0, -1.0], [0.0, 1.5], [0.0, 0.0]]))


def test_nav_settings_refuse_contradictions():
    with pytest.raises(ValueError, match="the first must be the smaller"):
        NavSettings(distance_m=(5.0, 4.0))
    with pytest.raises(SettingsError, match=r"unknown setting rig\.wide; valid here"):
        NavSettings(settings={"rig.wide": 3}).recorded(0)
    with pytest.raises(SettingsError, match="unknown disturbance hail"):
        NavSettings(disturb="hail").recorded(0)
