"""The command route grid: refusals; with SUMO, a small study, its traffic and its vehicle."""

import csv
import json
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from terminal import driftyard

from trials.evaluation.intervals import mean_interval
from trials.navigation import PlanningError
from trials.routing.city import City
from trials.routing.demand import make_demand
from trials.routing.drive import STRATEGIES
from trials.routing.grid_report import Results, hypothesis, rows, saved_s
from trials.routing.grid_study import GridSettings, Outcome, shortest_s
from trials.routing.traffic import BLOCKED_S, FREE_S, TURN_S, Traffic, free_times_s
from trials.routing.urgent import Router, UrgentVehicle

STATIC, DYNAMIC, STATIC_CLEARED, DYNAMIC_CLEARED = STRATEGIES
WITHOUT_WEST = ",".join(f"A{k}-B{k}" for k in (1, 2))


@pytest.fixture
def sumo():
    pytest.importorskip("libsumo", reason="needs Eclipse SUMO: the extra traffic")
    pytest.importorskip("sumo", reason="needs Eclipse SUMO: the extra traffic")


@pytest.mark.parametrize(
    ("words", "fragment"),
    [
        (["--side", "2", "--closed", WITHOUT_WEST], "no path from west1 to east1"),
        (["--start", "west1", "--goal", "west1"], "no path from west1 to west1"),
        (["--start", "A1"], "no entry A1; entries are west1, "),
        (["--closed", "A1-C1"], "no road A1-C1"),
        (["--phases", "4+7"], "no phase lets these movements through"),
        (["--volumes", "200,no"], "--volumes 200,no: expected numbers"),
        (["--volumes", "0"], "--volumes 0: expected numbers"),
    ],
)
def test_route_grid_refuses_wrong_input_in_one_line(tmp_path, words, fragment):
    done = driftyard("route", "grid", "--out", "o", *words, cwd=tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("driftyard: error: ")
    assert fragment in line
    assert not (tmp_path / "o").exists()


def test_route_grid_without_sumo_names_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "libsumo", None)
    done = driftyard("route", "grid", "--out", "o", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert 'pip install "driftyard[traffic]"' in done.stderr


def test_grid_has_the_turns_of_its_roads():
    city = City(2)
    assert len(city.roads) == 2 * (4 + 8)
    assert city.turns["west1-A1", "A1-B1"] == 2
    assert city.turns["west1-A1", "A1-A2"] == 5  # left, to the north
    assert city.turns["A2-A1", "A1-B1"] == 7
    assert ("west1-A1", "A1-west1") not in city.turns
    assert shortest_s(city, "west1", "east1") == pytest.approx(3 * FREE_S)
    assert shortest_s(city, "west1", "east2") == pytest.approx(4 * FREE_S + 2 * TURN_S)
    with pytest.raises(PlanningError, match="no path from west1 to east2"):
        shortest_s(City(2, tuple(WITHOUT_WEST.split(","))), "west1", "east2")


def test_router_avoids_a_road_that_has_become_slow():
    city = City(3)
    free_s = free_times_s(city)
    router = Router(city, free_s, "west2", "east2")
    assert router.path() == ["west2-A2", "A2-B2", "B2-C2", "C2-east2"]
    slow = free_s * [10.0 if road == "A2-B2" else 1.0 for road, _ in city.turns]
    around = router.replan("west2-A2", slow)
    assert len(around) == 6
    assert "A2-B2" not in around
    assert router.replan("A2-B2", slow) == ["A2-B2", "B2-C2", "C2-east2"]  # too late


def test_demand_is_repeatable_and_keeps_its_trips():
    city = City(3)
    some, none = (
        make_demand(city, 300, 200, blocked, np.random.default_rng(1)) for blocked in (0.5, 0.0)
    )
    assert some.trips == none.trips
    assert (len(some.blocked) > 3, len(none.blocked)) == (True, 0)
    assert len(some.trips) == pytest.approx(12 * 300 * 200 / 3600, rel=0.3)
    for depart_s, roads in some.trips:
        assert 0 <= depart_s <= 200
        assert all(x in city.turns for x in pairwise(roads))


def outcomes(travel_s):
    """Of 20 seeds, with the mean travel time of each strategy, and noise that seeds share."""
    noise = np.random.default_rng(0).normal(0, 20, 20)
    first = Outcome(STATIC, 300, 0, 0.0, True, 90.0, 100.0, 0, 0, ())
    return [
        replace(first, strategy=strategy, seed=k, travel_s=mean_s + noise[k])
        for strategy, mean_s in zip(STRATEGIES, travel_s, strict=True)
        for k in range(20)
    ]


def test_hypothesis_is_tested_in_the_same_traffic():
    results = Results(outcomes([300, 250, 120, 110]))
    assert hypothesis(results).holds
    assert saved_s(results, STATIC_CLEARED).value == pytest.approx(10)
    assert not hypothesis(Results(outcomes([300, 250, 110, 110]))).holds
    assert not hypothesis(Results(outcomes([300, 100, 120, 110]))).holds
    mean = mean_interval(np.array([x.travel_s for x in results.of(STATIC, 300)]))
    assert rows(results, 300)[0][:3] == ("static", "20/20", mean.text(0))


@pytest.fixture
def traffic(sumo, tmp_path):
    """A city of four intersections with some vehicles."""
    city, settings = City(2), GridSettings(City(2))
    trips = make_demand(city, 150, 120, 0, np.random.default_rng(0)).trips
    started = Traffic(city, trips, settings.plan, 0, tmp_path)
    yield started
    started.close()


def test_detectors_count_what_passes(traffic):
    traffic.run(200)
    counts = traffic.counts("west1-A1")
    entered = sum(roads[0] == "west1-A1" for _, roads in make_trips())
    assert counts.arrivals[-1] == counts.departures[-1] == entered > 2
    assert (counts.arrivals > counts.departures - 1).all()
    assert (traffic.travel_times_s() >= FREE_S).all()
    cleared = traffic.travel_times_s(is_cleared=True)
    assert (cleared <= traffic.travel_times_s()).all()


def test_blocked_road_is_reported_until_it_is_free(traffic):
    before_s = traffic.travel_times_s()
    traffic.block("A1-B1", [0, 1])
    traffic.run(20)
    added_s = traffic.travel_times_s() - before_s
    is_blocked = np.array([road == "A1-B1" for road, _ in traffic.city.turns])
    assert (added_s[is_blocked] > 150).all()
    assert (added_s[~is_blocked] < 60).all()
    traffic.run(BLOCKED_S + 20)
    assert (traffic.travel_times_s() - before_s < 60).all()
    assert "blocked A1-B1 0" not in traffic.sumo.vehicle.getIDList()


def make_trips():
    return make_demand(City(2), 150, 120, 0, np.random.default_rng(0)).trips


@pytest.mark.parametrize("strategy", [STATIC, DYNAMIC_CLEARED])
def test_urgent_vehicle_arrives_sooner_with_preemption(traffic, strategy):
    traffic.run(30)
    router = Router(traffic.city, traffic.travel_times_s(), "west1", "east2")
    vehicle = UrgentVehicle(traffic, router, strategy, GridSettings(traffic.city).phases)
    traffic.block("A1-A2", [0])
    while not vehicle.has_arrived and traffic.time_s < 400:
        traffic.step()
        vehicle.step()
    travel_s = traffic.time_s - 30
    assert travel_s > 0.9 * 4 * FREE_S
    assert (travel_s < 1.4 * 4 * FREE_S) == strategy.clearing
    assert len(vehicle.preempted) == (3 if strategy.clearing else 0)
    assert traffic.sumo.vehicle.getSpeed("blocked A1-A2 0") == 0


def test_route_grid_writes_figure_tables_and_verdict(sumo, tmp_path):
    words = (
        "route",
        "grid",
        "--side",
        "2",
        "--volumes",
        "150",
        "--seeds",
        "2",
        "--closed",
        "A1-B1",
    )
    done = [driftyard(*words, "--out", out, cwd=tmp_path) for out in ("a", "b")]
    assert done[0].returncode == 0, done[0].stderr
    assert "dynamic routing with preemption is faster than each other strategy" in done[0].stdout
    names = {path.name for path in (tmp_path / "a").iterdir()}
    assert names == {f"routing_grid.{x}" for x in ("png", "csv", "md", "json")}
    text = (tmp_path / "a/routing_grid.csv").read_text()
    table = [*csv.DictReader(text.splitlines())]
    assert len(table) == 8
    assert (tmp_path / "b/routing_grid.csv").read_text() == text
    assert len([*(tmp_path / "build/cache/results").glob("traffic-*")]) == 2  # b reads them
    summary = json.loads((tmp_path / "a/routing_grid.json").read_text())
    assert summary["settings"]["volumes"] == [150]
