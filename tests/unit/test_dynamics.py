"""Dynamic agents react to the rover, give way to it, and are decided by the seed."""

import math
from itertools import pairwise

import numpy as np
import pytest
from gym_worlds import write_yard

from sim.batch import build
from sim.world.world import START_S, build_world
from trials.gym.env.settings import NavSettings
from trials.gym.world.barrier_slots import with_slots_closed
from trials.gym.world.dynamic_agents import Barrier, Cart, Door, Gate, Load, Slot
from trials.gym.world.dynamics import parse_dynamics, sample_dynamics, with_agents
from trials.gym.world.free_space import TraversableSpace, map_free_space
from trials.gym.world.simulation import Simulation
from trials.gym.world.start_goal_sampling import main_component, sample_start_goal
from vo.contract.errors import SettingsError
from vo.contract.settings import validated

SLOT = Slot(np.zeros(3), 0.0, np.array([0.4, 1.0]))
FAR = np.array([-5.0, 0.0])
DT = 0.02


def simulate(agent, seconds, rover, since_s=1.0):
    """Advance an agent with the rover at `rover`; returns times and coordinates."""
    times = np.arange(since_s, since_s + seconds, DT)
    places = []
    for time_s in times.tolist():
        agent.advance(time_s, rover(time_s) if callable(rover) else rover)
        places.append(agent.coordinate)
    return times, np.array(places)


def test_slot_distance_matches_hand_computation():
    slot = Slot(np.array([1.0, 2.0, 0.0]), math.pi / 2, np.array([0.4, 1.0]))
    # Its depth points along y: 0.4 m to either side in y, 1 m in x.
    assert slot.distance_m(np.array([1.9, 2.3])) == 0
    assert slot.distance_m(np.array([3.0, 2.0])) == pytest.approx(1.0)
    assert slot.distance_m(np.array([2.3, 2.8])) == pytest.approx(0.5)
    np.testing.assert_allclose(np.abs(slot.corners - (1, 2)), [[1.0, 0.4]] * 4, atol=1e-12)


def test_load_comes_down_at_its_time_or_near_the_rover_and_stays():
    load = Load(SLOT, at_s=5.0, near_m=2.0)
    times, heights = simulate(load, 10, FAR)
    assert heights[times < 5].min() == Barrier.LIFT_M
    assert heights[times > 5 + Barrier.LIFT_M / Barrier.SPEED_MPS + 2 * DT].max() == 0
    near = Load(SLOT, at_s=math.inf, near_m=2.0)
    _, heights = simulate(near, 2, FAR)
    assert heights.min() == Barrier.LIFT_M
    _, heights = simulate(near, 3, np.array([-2.0, 0.0]), since_s=3.0)
    assert heights[-1] == 0
    _, heights = simulate(near, 3, FAR, since_s=6.0)
    assert heights.max() == 0


@pytest.mark.parametrize("away_m", [0.0, 0.3, Barrier.SAFE_M - 0.01])
def test_barrier_near_the_rover_does_not_come_down(away_m):
    close = np.array([-0.4 - away_m, 0.0])
    for barrier in (Load(SLOT, 1.0, 5.0), Door(SLOT, 10.0, 0.0, 0.0), Gate(SLOT, 1.0, 99, 99)):
        barrier._initial = Barrier.LIFT_M
        barrier.reset()
        _, heights = simulate(barrier, 5, close)
        assert heights.min() == Barrier.LIFT_M
        barrier.reset()
        _, heights = simulate(barrier, 0.6, FAR)
        assert 0 < heights[-1] < Barrier.LIFT_M
        _, heights = simulate(barrier, 3, close, since_s=1.7)
        assert heights[-1] == Barrier.LIFT_M
        _, heights = simulate(barrier, 5, FAR, since_s=5.0)
        assert heights[-1] == 0
        _, heights = simulate(barrier, 1, close, since_s=10.1)
        assert heights.max() < Barrier.LIFT_M * (barrier.__class__ is Door) + 1e-9


def test_door_is_open_for_its_fraction():
    door = Door(SLOT, period_s=20.0, open_fraction=0.5, phase=0.0)
    times, heights = simulate(door, 60, FAR)
    travel_s = Barrier.LIFT_M / Barrier.SPEED_MPS
    assert (heights >= Barrier.LIFT_M).mean() == pytest.approx(0.5 - travel_s / 20, abs=0.03)
    assert (heights <= 0).mean() == pytest.approx(0.5 - travel_s / 20, abs=0.03)
    assert heights[np.searchsorted(times, 15.0)] == 0


def test_gate_opens_after_wait_or_lead_whichever_is_first():
    here = np.array([-1.4, 0.0])
    for requested_s, opens_s in ((None, 1 + 6.0), (1.0, 1 + 4.0), (6.0, 1 + 6.0)):
        gate = Gate(SLOT, closes_s=-math.inf, wait_s=6.0, lead_s=4.0)
        if requested_s is not None:
            gate.request(requested_s)
        times, heights = simulate(gate, 12, here)
        assert times[np.argmax(heights > 0)] == pytest.approx(opens_s, abs=2 * DT)
        assert gate.is_up
    waived = Gate(SLOT, closes_s=3.0, wait_s=6.0, lead_s=4.0)
    waived.enter(2.9)
    assert simulate(waived, 8, FAR)[1].min() == Barrier.LIFT_M


def test_cart_waits_for_the_rover_then_turns_back():
    cart = Cart(np.array([[0.0, 0.0], [4.0, 0.0]]), 0.0, 0.5, 0.0)
    times, places = simulate(cart, 16, FAR)
    wave = 4 - np.abs((times - 1.0) * 0.5 % 8 - 4)
    np.testing.assert_allclose(places, wave, atol=0.05)
    assert (places.min(), places.max()) == pytest.approx((0, 4), abs=0.02)
    cart.reset()
    rover = np.array([2.5, 0.0])
    times, places = simulate(cart, 12, rover)
    assert places.max() <= 2.5 - Cart.SAFE_M + 1e-9
    waiting = times[places > places.max() - 1e-6]
    assert np.ptp(waiting) == pytest.approx(Cart.MAX_WAIT_S, abs=3 * DT)
    assert places[times > waiting.max() + 1].min() < places.max() - 0.3


def test_agent_replays_its_past_poses():
    cart = Cart(np.array([[0.0, 0.0], [4.0, 0.0]]), 0.2, 0.5, 0.0)
    times, places = simulate(cart, 6, FAR)
    for time_s, place in zip(times.tolist(), places.tolist(), strict=True):
        np.testing.assert_allclose(cart(time_s)[:3, 3], (place, 0, 0.2), atol=1e-9)
    between = 0.5 * (times[10] + times[11])
    assert cart(float(between))[0, 3] == pytest.approx(0.5 * (places[10] + places[11]), abs=1e-6)
    assert cart(0.0)[0, 3] == places[0]
    assert cart(99.0)[0, 3] == places[-1]


def test_parse_dynamics_refuses_unknown_kinds_and_numbers():
    assert parse_dynamics("blocked_aisles=3, doors") == {"blocked_aisles": 3, "doors": 1}
    assert parse_dynamics("") == {}
    for text in ("gates", "doors=x", "doors=-1", "doors=11"):
        with pytest.raises(SettingsError, match=text.split("=")[0]):
            parse_dynamics(text)
    with pytest.raises(SettingsError, match="unknown dynamics gates"):
        validated(NavSettings, {"dynamics": "gates"})


@pytest.fixture(scope="module")
def yard(tmp_path_factory):
    """A yard in which the pillar leaves a passage of 2.7 m on either side."""
    file = str(write_yard(tmp_path_factory.mktemp("yard")))
    settings = NavSettings(scene=file).recorded(0)
    scene = build(file, settings)
    world = build_world(scene, settings)
    traversable = TraversableSpace(map_free_space(world, 0.5), 0.3)
    component = main_component(traversable, world.path.waypoints, "yard")
    start, goal = np.array([-2.2, 0.3, 0.0]), np.array([2.2, 0.3])
    rng = np.random.default_rng(0)
    ends = sample_start_goal(traversable, component, (1, 9), rng, start, goal)
    return settings, scene, traversable, ends


@pytest.mark.parametrize("seed", range(4))
def test_loads_leave_a_path_to_the_goal(yard, seed):
    _, scene, traversable, ends = yard
    movers = sample_dynamics(scene, ends, 0.5, "blocked_aisles=3,doors", seed)
    loads = [m.slot for m in movers.values() if isinstance(m, Load)]
    assert len(loads) == 1  # a second one would close the other side of the pillar
    assert all(traversable.mask[tuple(traversable.space.cells(slot.centre[:2]))] for slot in loads)
    closed = with_slots_closed(traversable, loads)
    assert closed.shortest_path(ends.start[:2], ends.field.goal) is not None
    assert not all(closed.has_line(a, b) for a, b in pairwise(ends.path))
    again = sample_dynamics(scene, ends, 0.5, "blocked_aisles=3,doors", seed)
    assert {k: m(1.0).tolist() for k, m in again.items()} == {
        k: m(1.0).tolist() for k, m in movers.items()
    }
    fewer = sample_dynamics(scene, ends, 0.5, "blocked_aisles=3", seed)
    assert fewer["blocked_aisles_0"](1.0).tolist() == movers["blocked_aisles_0"](1.0).tolist()


def test_load_stops_the_rover_only_when_it_is_down(yard):
    settings, scene, _, ends = yard
    slot = Slot(np.array([-0.9, 0.3, 0.0]), 0.0, np.array([0.1, 0.8]))
    for at_s, stopped in ((START_S, True), (1e6, False)):
        movers = {"load": Load(slot, at_s, 0.0)}
        world = build_world(with_agents(scene, movers, 0), settings)
        simulation = Simulation(world, settings, 1.0)
        assert simulation.reset(ends.start)
        for _ in range(60 if stopped else 0):
            simulation.advance(np.zeros(2))
        touched = False
        while not touched and simulation.pose2[0] < -0.7 and simulation.time_s < 60:
            simulation.advance(np.full(2, 4.0))
            touched = bool((simulation.touched & simulation.rigid).any())
        assert touched == stopped
        assert (simulation.pose2[0] < -1.0) == stopped


def test_with_agents_without_agents_returns_the_scene(yard):
    _, scene, _, _ = yard
    assert with_agents(scene, {}, 0) is scene
