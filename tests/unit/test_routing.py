"""Routing against hand-worked drives and, where nothing changes on the way, against Dijkstra."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from trials.navigation import PlanningError
from trials.routing.drive import STRATEGIES, Delays, Strategy, drive, undelayed_s
from trials.routing.network import (
    LONG_WAY,
    SHORT_WAY,
    SMALL_CONGESTED,
    Network,
    large_network,
    read_map,
    small_network,
)
from trials.routing.study import (
    Randomised,
    Sweep,
    both_never_worse,
    clearing_saves_more,
    random_case,
    randomised,
    small_case,
    sweep,
)

STATIC, DYNAMIC, STATIC_CLEARED, DYNAMIC_CLEARED = STRATEGIES
SHORT_S = (4 + 2 * np.hypot(4, 1.5) + 4) / 120 * 3600
LONG_S = (4 + 5 + 4 + 5) / 120 * 3600
DETOUR = (0, *LONG_WAY)


def small_drive(strategy, wait_s=0.0, queue_s=0.0, since_s=1.0, lead_s=0.0):
    network = small_network()
    queues = {SMALL_CONGESTED: (since_s, queue_s)} if queue_s else {}
    return drive(network, Delays(np.full(7, wait_s), queues, lead_s), 0, 6, strategy)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_drive_without_delays_takes_the_shorter_way(strategy):
    result = small_drive(strategy)
    assert result.nodes == SHORT_WAY
    assert result.time_s == pytest.approx(SHORT_S)


def test_drive_waits_at_inner_nodes_that_are_not_cleared():
    assert small_drive(STATIC, wait_s=60).time_s == pytest.approx(SHORT_S + 3 * 60)
    assert small_drive(DYNAMIC, wait_s=60).time_s == pytest.approx(SHORT_S + 3 * 60)
    assert small_drive(STATIC_CLEARED, wait_s=60).time_s == pytest.approx(SHORT_S)


def test_late_clearing_leaves_the_rest_of_the_wait():
    # The fork is reached after 120 s, the next node 128 s later.
    late = small_drive(STATIC_CLEARED, wait_s=60, lead_s=150)
    assert late.time_s == pytest.approx(SHORT_S + 30)
    useless = small_drive(STATIC_CLEARED, wait_s=60, lead_s=1e6)
    assert useless.time_s == pytest.approx(SHORT_S + 3 * 60)


def test_dynamic_routing_takes_the_detour_where_it_pays():
    detour_s = LONG_S - SHORT_S
    for queue_s in (0.9 * detour_s, 1.1 * detour_s, 400.0):
        assert small_drive(STATIC, queue_s=queue_s).time_s == pytest.approx(SHORT_S + queue_s)
        best = min(SHORT_S + queue_s, LONG_S)
        assert small_drive(DYNAMIC, queue_s=queue_s).time_s == pytest.approx(best)
    assert small_drive(DYNAMIC, queue_s=400).nodes == DETOUR


def test_dynamic_routing_with_a_late_queue():
    fork_s, entry_s = 120.0, 120 + np.hypot(4, 1.5) * 30
    assert small_drive(DYNAMIC, queue_s=400, since_s=entry_s + 1).time_s == pytest.approx(SHORT_S)
    # Too late to turn at the fork: back to it and around, or through.
    late = small_drive(DYNAMIC, queue_s=400, since_s=fork_s + 1)
    back_s = 2 * np.hypot(4, 1.5) * 30
    assert late.time_s == pytest.approx(min(SHORT_S + 400, LONG_S + back_s))


@pytest.mark.parametrize("seed", range(5))
def test_dynamic_routing_with_known_queues_is_optimal(seed):
    rng = np.random.default_rng(seed)
    network = large_network(rng, side=8)
    case = random_case(network, 0.4, rng)
    waits_s = rng.uniform(0, 180, 64)
    queues = {road: (0.0, rng.uniform(1, 420)) for road in case.onsets_s}
    for strategy in (DYNAMIC, DYNAMIC_CLEARED):
        costs = np.full((64, 64), 0.0)
        for (a, b), length_m in network.lengths_m.items():
            wait_s = 0 if b == case.goal or strategy.clearing else waits_s[b]
            costs[a, b] = length_m / network.top_speed_mps + queues.get((a, b), (0, 0))[1] + wait_s
        best_s = dijkstra(csr_matrix(costs), indices=case.start)[case.goal]
        result = drive(network, Delays(waits_s, queues, 0.0), case.start, case.goal, strategy)
        assert result.time_s == pytest.approx(best_s, rel=1e-9)


def test_large_network_is_connected_its_heuristic_admissible():
    network = large_network(np.random.default_rng(1))
    graph = network.graph(np.zeros(len(network.names)))
    assert (graph.bounds[graph.tails, graph.heads] <= graph.costs).all()
    roads = np.array(list(network.lengths_m))
    matrix = csr_matrix((np.ones(len(roads)), roads.T), shape=(225, 225))
    assert np.isfinite(dijkstra(matrix, indices=0)).all()
    assert min(network.lengths_m.values()) >= 1000  # a lead of 30 s at 120 km/h is always kept


def test_drive_without_a_path_is_refused():
    xy_m = np.array([(0.0, 0), (1, 0), (2, 0)])
    network = Network(("a", "b", "c"), xy_m, {(0, 1): 1.0, (2, 1): 1.0}, 1.0)
    for strategy in STRATEGIES:
        with pytest.raises(PlanningError, match="no path from a to c"):
            drive(network, Delays(np.zeros(3), {}, 0.0), 0, 2, strategy)
    with pytest.raises(PlanningError, match="no path"):
        undelayed_s(network, 0, 2)


def test_sweeps_of_the_small_network_match_hand_computation():
    network = small_network()
    case = small_case(network)
    done = []
    over_queue = sweep(network, [case], "queue", 30.0, done.append)
    assert len(done) == len(over_queue.delays_s)
    static, dynamic = over_queue.times_s[:2, :, 0]
    np.testing.assert_allclose(static, SHORT_S + 3 * 90 + over_queue.delays_s)
    np.testing.assert_allclose(dynamic, np.minimum(static, LONG_S + 3 * 90))
    over_node = sweep(network, [case], "node", 30.0, done.append)
    np.testing.assert_allclose(np.ptp(over_node.times_s[2:], axis=1), 0, atol=1e-9)


def test_dynamic_with_clearing_and_known_queues_is_never_worse():
    rng = np.random.default_rng(4)
    network = large_network(rng, side=8)
    cases = [random_case(network, 0.3, rng) for _ in range(10)]
    known = randomised(network, cases, 30.0, rng, lambda _: None, known_s=0.0)
    assert (known.times_s[3] <= known.times_s[:3].min(axis=0) + 1e-9).all()
    assert (known.increase_percent >= 0).all()
    assert known.increase_percent[0].max() > 20


def test_verdicts_distinguish_worse_from_better():
    free_s = np.full(50, 100.0)
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 1, 50)
    good = np.array([200 + noise, 180 + noise, 150 + noise, 120 + noise])
    swapped = good[[0, 2, 1, 3]]
    node = Sweep(np.array([0.0, 60]), np.array([good[:, :2], good[:, :2]]).swapaxes(0, 1))
    assert clearing_saves_more(Randomised(free_s, good), node).holds
    assert not clearing_saves_more(Randomised(free_s, swapped), node).holds
    assert both_never_worse(Randomised(free_s, good), Randomised(free_s, good), [node]).holds
    good[3, 7] = good[2, 7] + 60
    verdict = both_never_worse(Randomised(free_s, good), Randomised(free_s, good), [node])
    assert not verdict.holds
    assert "worse in 1 of 50, at most by 1.0 min" in verdict.because


def test_strategy_names_are_unique():
    assert Strategy(dynamic=True, clearing=True).name == "dynamic + clearing"
    assert len({s.name for s in STRATEGIES}) == 4


def test_documented_map_can_be_driven(tmp_path):
    text = (Path(__file__).parents[2] / "docs/routing.md").read_text()
    (tmp_path / "town.json").write_text(re.findall(r"```json\n(.*?)```", text, re.DOTALL)[0])
    network = read_map(tmp_path / "town.json")
    assert (network.start, network.goal) == (0, 3)
    assert network.lengths_m[0, 2] == network.lengths_m[2, 0] == 1100
    assert (3, 1) not in network.lengths_m  # one way
    assert undelayed_s(network, 0, 3) == pytest.approx(2 * np.hypot(900, 400) / 50 * 3.6)
