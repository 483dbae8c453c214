"""Phases, begin of a preemption and controller of a signal, against hand-worked cases."""

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trials.routing.phases import (
    EIGHT_PHASES,
    MANEUVERS,
    SIDES,
    are_compatible,
    movement_of,
    own_phase,
    read_phases,
    select_phase,
    selection_table,
)
from trials.routing.preemption import Counts, Discharge, Green, preemption_start_s
from trials.routing.signal_controller import (
    ALL_RED_S,
    CONFLICTS,
    TRANSITION_S,
    YELLOW_S,
    SignalController,
    mean_waits_s,
)
from vo.contract.errors import SettingsError

phase = st.sampled_from(EIGHT_PHASES)
PLAN = [(x, 16.0 if x in ((4, 8), (2, 6)) else 6.0) for x in EIGHT_PHASES]


def test_own_phase_is_that_of_the_vehicles_approach():
    found = {side: own_phase(side) for side in SIDES}
    assert found == {"north": (4, 7), "south": (3, 8), "west": (2, 5), "east": (1, 6)}


def test_movements_follow_the_turns_of_right_hand_traffic():
    assert [movement_of("north", x) for x in ("east", "south", "west")] == [7, 4, 4]
    assert [movement_of("west", x) for x in ("north", "east", "south")] == [5, 2, 2]
    assert [movement_of("south", x) for x in ("west", "north", "east")] == [3, 8, 8]
    assert [movement_of("east", x) for x in ("south", "west", "north")] == [1, 6, 6]


def test_eight_phases_are_all_pairs_without_conflict():
    pairs = {x for x in combinations(range(1, 9), 2) if are_compatible(*x)}
    assert pairs == {*EIGHT_PHASES}
    assert EIGHT_PHASES[0] == (4, 7)


@pytest.mark.parametrize(
    ("present", "origin", "target", "is_congested", "expected"),
    [
        ((3, 8), "north", "south", False, "4+8"),  # not 4+7
        ((4, 7), "north", "south", False, "4+7*"),
        ((4, 8), "north", "west", False, "4+8*"),
        ((1, 6), "north", "east", False, "3+7"),
        ((2, 5), "west", "north", False, "2+5*"),
        ((4, 8), "east", "south", False, "1+5"),
        ((4, 8), "north", "south", True, "4+7"),  # although it would let the vehicle through
        ((4, 7), "north", "east", True, "4+7*"),
        ((2, 6), "south", "west", True, "3+8"),
        ((3, 7), "east", "north", True, "1+6"),
        ((1, 5), "west", "south", True, "2+5"),
    ],
)
def test_selected_phase_of_cells_of_both_tables(present, origin, target, is_congested, expected):
    found = select_phase(EIGHT_PHASES, present, origin, target, is_congested)
    assert found.text == expected


def test_tables_agree_where_the_own_phase_is_on_only():
    low, high = (selection_table(EIGHT_PHASES, x) for x in (False, True))
    same = [
        (way[0], EIGHT_PHASES[k])
        for way in MANEUVERS
        for k in range(8)
        if low[way][k] == high[way][k]
    ]
    assert same == [(a, own_phase(a)) for a, _ in MANEUVERS]
    assert len(same) / (len(MANEUVERS) * 8) == 1 / 8


@pytest.mark.parametrize("is_congested", [False, True])
def test_selected_phase_has_no_conflict_and_lets_through(is_congested):
    for present, way in product(EIGHT_PHASES, MANEUVERS):
        choice = select_phase(EIGHT_PHASES, present, *way, is_congested)
        assert movement_of(*way) in choice.phase
        assert all(are_compatible(a, b) for a, b in combinations(choice.phase, 2))
        assert choice.is_extended == (choice.phase == present)
        if not is_congested:
            assert choice.is_extended == (movement_of(*way) in present)


@settings(max_examples=25)
@given(st.sets(phase, min_size=1), phase, st.sampled_from(MANEUVERS))
def test_selection_among_any_phases_lets_through_or_is_refused(phases, present, way):
    try:
        choice = select_phase(sorted(phases), present, *way, is_congested=False)
    except SettingsError:
        assert not any(movement_of(*way) in x for x in (present, *phases))
    else:
        assert movement_of(*way) in choice.phase
        assert choice.phase in phases or choice.phase == present


@pytest.mark.parametrize(
    ("text", "fragment"),
    [
        ("", "expected movements 1 to 8"),
        ("4+9", "expected movements 1 to 8"),
        ("3+4", "3 (left from the south) and 4 (straight on from the north) conflict"),
        ("4+7,7+4", "4+7 is given twice"),
        ("4+7,3+8,2+5", "lets these movements through: 1 (left from the east), 6 (straight on"),
    ],
)
def test_phases_that_cannot_work_are_refused(text, fragment):
    with pytest.raises(SettingsError) as error:
        read_phases(text)
    assert fragment in str(error.value)


def test_phase_that_lets_no_vehicle_through_is_refused():
    with pytest.raises(SettingsError, match="none lets movement 7"):
        select_phase([(4, 8)], (4, 8), "north", "east", is_congested=False)


def test_preemption_begins_before_the_arrival():
    assert preemption_start_s(60, transition_s=4, margin_s=5) == 51
    # A queue of 8 vehicles: 2 s + 8 * 2 s
    delay_s = Discharge(lost_time_s=2, headway_s=2).delay_s(8)
    assert delay_s == 18
    assert preemption_start_s(60, 4, 5, delay_s) == 33


def test_queue_length_of_hand_worked_counts():
    """12 vehicles arrive in a minute; 4 had left when a green of 10 s began, 7 when it ended."""
    times_s = np.array([0.0, 20, 30, 60])
    counts = Counts("a", times_s, np.array([0.0, 4, 6, 12]), np.array([0.0, 4, 7, 7]))
    assert counts.queue(60, Green(20, 10), 0.5) == 12 - 7
    assert counts.queue(70, Green(20, 10), 0.5) == 14 - 7  # arrivals go on
    # Green has been on for 5 s: 12 - 7 - 0.5 * 5
    assert counts.queue(60, Green(55), 0.5) == 2.5
    assert counts.queue(75, Green(55), 0.5) == 0  # max(0, 15 - 7 - 10)


@pytest.mark.parametrize(
    ("rows", "fragment"),
    [
        ([], "det 1: the detector has no counts"),
        ([(0, 3, 1), (5, 2, 2)], "det 1: arrivals fall from 3 to 2"),
        ([(5, 0, 0), (0, 2, 2)], "det 1: times fall from 5 to 0"),
    ],
)
def test_detector_without_counts_is_refused(rows, fragment):
    with pytest.raises(SettingsError, match=fragment):
        Counts("det 1", *np.array(rows, dtype=float).reshape(-1, 3).T)


def test_controller_follows_its_plan():
    controller = SignalController(PLAN)
    shown = []
    for time_s in range(40):
        controller.step(time_s)
        shown.append("".join(controller.light(x, time_s) for x in (4, 7, 8)))
    expected = ["GGr"] * 6 + ["Gyr"] * 3 + ["Grr"] + ["GrG"] * 16 + ["yrG"] * 3 + ["rrG"] * 7
    assert shown[:36] == expected
    assert controller.last_green(4) == Green(0, 26)
    assert controller.last_green(8) == Green(10, 26)
    assert controller.last_green(3) == Green(30)
    assert controller.last_green(2) is None


def test_preemption_holds_its_phase_and_the_plan_goes_on():
    controller = SignalController(PLAN)
    controller.step(0)
    controller.request((2, 5), 1)
    for time_s in range(1, 60):
        controller.step(time_s)
        assert (controller.light(2, time_s) == "G") == (time_s >= 1 + TRANSITION_S)
    controller.release(60)
    controller.step(60)
    assert controller.phase == (2, 6)


@settings(max_examples=25)
@given(
    st.lists(st.tuples(st.floats(0, 90), st.one_of(st.none(), phase)), max_size=8),
    st.integers(0, 7),
)
def test_lights_never_conflict_whatever_is_requested(events, first):
    """A green ends in yellow and all-red before a conflicting one, also in a transition."""
    controller = SignalController(PLAN[first:] + PLAN[:first])
    events = sorted(events, key=lambda x: x[0])
    ended_s = {}
    before = dict.fromkeys(CONFLICTS, "r")
    for time_s in np.arange(0.0, 100, 0.5).tolist():
        while events and events[0][0] <= time_s:
            _, wanted = events.pop(0)
            if wanted is None:
                controller.release(time_s)
            else:
                controller.request(wanted, time_s)
        controller.step(time_s)
        lights = {x: controller.light(x, time_s) for x in CONFLICTS}
        for x, light in lights.items():
            if before[x] == "G" and light != "G":
                assert light == "y"
                ended_s[x] = time_s
            if light == "G":
                assert all(lights[y] == "r" for y in CONFLICTS[x])
                assert all(time_s - ended_s.get(y, -9) >= TRANSITION_S for y in CONFLICTS[x])
        before = lights
    assert YELLOW_S + ALL_RED_S == TRANSITION_S


def test_mean_wait_of_a_plan():
    plan = dict(PLAN)  # a cycle of 100 s
    assert mean_waits_s(plan)[4] == pytest.approx((100 - 22) ** 2 / 200)
    assert mean_waits_s(plan)[7] == pytest.approx((100 - 12) ** 2 / 200)
