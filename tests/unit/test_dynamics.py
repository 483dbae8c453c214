"""What moves in a trial reacts to the rover, gives way to it, and is the same by seed."""

import math
from itertools import pairwise

import numpy as np
import pytest
from gym_worlds import write_yard

from sim.batch import build
from sim.world.world import START_S, build_world
from trials.gym.env.settings import NavSettings
from trials.gym.world.barriers import KEEP_M, Barrier, Door, Gate, Load, Slot
from trials.gym.world.carts import KEEP_M as CART_KEEP_M
from trials.gym.world.carts import PATIENCE_S, Cart
from trials.gym.world.crossings import way_between, with_closed
from trials.gym.world.distance_field import Passages
from trials.gym.world.dynamics import draw_dynamics, parse_dynamics
from trials.gym.world.free_space import survey_free_space
from trials.gym.world.obstacle_bodies import with_dynamics
from trials.gym.world.simulation import Simulation
from trials.gym.world.start_goal_sampling import draw_errand, main_part
from vo.contract.errors import SettingsError
from vo.contract.settings import validated

SLOT = Slot(np.zeros(3), 0.0, np.array([0.4, 1.0]))
FAR = np.array([-5.0, 0.0])
DT = 0.02


def watch(mover, seconds, rover, since_s=1.0):
    """Let time pass with the rover where `rover` puts it; returns times and coordinates."""
    times = np.arange(since_s, since_s + seconds, DT)
    places = []
    for time_s in times.tolist():
        mover.react(time_s, rover(time_s) if callable(rover) else rover)
        places.append(mover.place)
    return times, np.array(places)


def test_distance_from_a_slot_by_hand():
    slot = Slot(np.array([1.0, 2.0, 0.0]), math.pi / 2, np.array([0.4, 1.0]))
    # Its depth points along y: 0.4 m to either side in y, 1 m in x.
    assert slot.away_m(np.array([1.9, 2.3])) == 0
    assert slot.away_m(np.array([3.0, 2.0])) == pytest.approx(1.0)
    assert slot.away_m(np.array([2.3, 2.8])) == pytest.approx(0.5)
    np.testing.assert_allclose(np.abs(slot.corners - (1, 2)), [[1.0, 0.4]] * 4, atol=1e-12)


def test_a_load_comes_down_at_its_time_or_when_the_rover_is_near_and_stays():
    load = Load(SLOT, at_s=5.0, near_m=2.0)
    times, heights = watch(load, 10, FAR)
    assert heights[times < 5].min() == Barrier.LIFT_M
    assert heights[times > 5 + Barrier.LIFT_M / Barrier.SPEED_MPS + 2 * DT].max() == 0
    near = Load(SLOT, at_s=math.inf, near_m=2.0)
    _, heights = watch(near, 2, FAR)
    assert heights.min() == Barrier.LIFT_M
    _, heights = watch(near, 3, np.array([-2.0, 0.0]), since_s=3.0)
    assert heights[-1] == 0
    _, heights = watch(near, 3, FAR, since_s=6.0)
    assert heights.max() == 0


@pytest.mark.parametrize("away_m", [0.0, 0.3, KEEP_M - 0.01])
def test_nothing_comes_down_while_the_rover_is_close_and_what_is_down_stays(away_m):
    close = np.array([-0.4 - away_m, 0.0])
    for barrier in (Load(SLOT, 1.0, 5.0), Door(SLOT, 10.0, 0.0, 0.0), Gate(SLOT, 1.0, 99, 99)):
        barrier._first = Barrier.LIFT_M
        barrier.begin()
        _, heights = watch(barrier, 5, close)
        assert heights.min() == Barrier.LIFT_M
        barrier.begin()
        _, heights = watch(barrier, 0.6, FAR)
        assert 0 < heights[-1] < Barrier.LIFT_M
        _, heights = watch(barrier, 3, close, since_s=1.7)
        assert heights[-1] == Barrier.LIFT_M
        _, heights = watch(barrier, 5, FAR, since_s=5.0)
        assert heights[-1] == 0
        _, heights = watch(barrier, 1, close, since_s=10.1)
        assert heights.max() < Barrier.LIFT_M * (barrier.__class__ is Door) + 1e-9


def test_a_door_is_open_for_its_share():
    door = Door(SLOT, period_s=20.0, open_share=0.5, phase=0.0)
    times, heights = watch(door, 60, FAR)
    travel_s = Barrier.LIFT_M / Barrier.SPEED_MPS
    assert (heights >= Barrier.LIFT_M).mean() == pytest.approx(0.5 - travel_s / 20, abs=0.03)
    assert (heights <= 0).mean() == pytest.approx(0.5 - travel_s / 20, abs=0.03)
    assert heights[np.searchsorted(times, 15.0)] == 0


def test_a_gate_opens_after_the_wait_or_after_the_lead_whichever_is_first():
    here = np.array([-1.4, 0.0])
    for requested_s, opens_s in ((None, 1 + 6.0), (1.0, 1 + 4.0), (6.0, 1 + 6.0)):
        gate = Gate(SLOT, since_s=-math.inf, wait_s=6.0, lead_s=4.0)
        if requested_s is not None:
            gate.request(requested_s)
        times, heights = watch(gate, 12, here)
        assert times[np.argmax(heights > 0)] == pytest.approx(opens_s, abs=2 * DT)
        assert gate.is_up
    waived = Gate(SLOT, since_s=3.0, wait_s=6.0, lead_s=4.0)
    waived.waive()
    assert watch(waived, 8, FAR)[1].min() == Barrier.LIFT_M


def test_a_cart_rolls_to_and_fro_and_waits_for_the_rover_until_it_turns_back():
    cart = Cart(np.array([[0.0, 0.0], [4.0, 0.0]]), 0.0, 0.5, 0.0)
    times, places = watch(cart, 16, FAR)
    wave = 4 - np.abs((times - 1.0) * 0.5 % 8 - 4)
    np.testing.assert_allclose(places, wave, atol=0.05)
    assert (places.min(), places.max()) == pytest.approx((0, 4), abs=0.02)
    cart.begin()
    rover = np.array([2.5, 0.0])
    times, places = watch(cart, 12, rover)
    assert places.max() <= 2.5 - CART_KEEP_M + 1e-9
    waiting = times[places > places.max() - 1e-6]
    assert np.ptp(waiting) == pytest.approx(PATIENCE_S, abs=3 * DT)
    assert places[times > waiting.max() + 1].min() < places.max() - 0.3


def test_what_was_is_remembered():
    cart = Cart(np.array([[0.0, 0.0], [4.0, 0.0]]), 0.2, 0.5, 0.0)
    times, places = watch(cart, 6, FAR)
    for time_s, place in zip(times.tolist(), places.tolist(), strict=True):
        np.testing.assert_allclose(cart(time_s)[:3, 3], (place, 0, 0.2), atol=1e-9)
    between = 0.5 * (times[10] + times[11])
    assert cart(float(between))[0, 3] == pytest.approx(0.5 * (places[10] + places[11]), abs=1e-6)
    assert cart(0.0)[0, 3] == places[0]
    assert cart(99.0)[0, 3] == places[-1]


def test_kinds_are_read_and_others_refused():
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
    passages = Passages(survey_free_space(world, 0.5), 0.3)
    part = main_part(passages, world.path.waypoints, "yard")
    start, goal = np.array([-2.2, 0.3, 0.0]), np.array([2.2, 0.3])
    rng = np.random.default_rng(0)
    return settings, scene, passages, draw_errand(passages, part, (1, 9), rng, start, goal)


@pytest.mark.parametrize("seed", range(4))
def test_a_way_remains_when_all_loads_are_down(yard, seed):
    _, scene, passages, errand = yard
    movers = draw_dynamics(scene, passages, errand, 0.5, "blocked_aisles=3,doors", seed)
    loads = [m.slot for m in movers.values() if isinstance(m, Load)]
    assert len(loads) == 1  # a second one would close the other side of the pillar
    assert way_between(with_closed(passages, loads), errand.start[:2], errand.goal) is not None
    assert all(passages.open[tuple(passages.free.cells(slot.centre[:2]))] for slot in loads)
    closed = with_closed(passages, loads)
    assert not all(closed.sees(a, b) for a, b in pairwise(errand.waypoints))
    again = draw_dynamics(scene, passages, errand, 0.5, "blocked_aisles=3,doors", seed)
    assert {k: m(1.0).tolist() for k, m in again.items()} == {
        k: m(1.0).tolist() for k, m in movers.items()
    }
    fewer = draw_dynamics(scene, passages, errand, 0.5, "blocked_aisles=3", seed)
    assert fewer["blocked_aisles_0"](1.0).tolist() == movers["blocked_aisles_0"](1.0).tolist()


def test_what_is_down_is_felt_and_what_is_up_is_driven_under(yard):
    settings, scene, _, errand = yard
    slot = Slot(np.array([-0.9, 0.3, 0.0]), 0.0, np.array([0.1, 0.8]))
    for at_s, stopped in ((START_S, True), (1e6, False)):
        movers = {"load": Load(slot, at_s, 0.0)}
        world = build_world(with_dynamics(scene, movers, 0), settings)
        simulation = Simulation(world, settings, 1.0)
        assert simulation.reset(errand.start)
        for _ in range(60 if stopped else 0):
            simulation.advance(np.zeros(2))
        touched = False
        while not touched and simulation.place[0] < -0.7 and simulation.time_s < 60:
            simulation.advance(np.full(2, 4.0))
            touched = bool((simulation.touched & simulation.hard).any())
        assert touched == stopped
        assert (simulation.place[0] < -1.0) == stopped


def test_a_scene_without_movers_stays_itself(yard):
    _, scene, _, _ = yard
    assert with_dynamics(scene, {}, 0) is scene
