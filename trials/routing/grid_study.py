"""Urgent vehicles in the simulated traffic of a city: all strategies over volumes and seeds."""

import importlib.metadata
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from trials.execution.executor import compute
from trials.execution.tasks import Task
from trials.routing.city import SAMPLE_S, City
from trials.routing.demand import make_demand
from trials.routing.drive import STRATEGIES, Strategy
from trials.routing.phases import EIGHT_PHASES, Phase
from trials.routing.signal_controller import TRANSITION_S
from trials.routing.sumo import require_sumo
from trials.routing.traffic import FREE_S, Traffic, free_times_s
from trials.routing.urgent import Preempted, Router, UrgentVehicle
from vo.contract.arrays import Array

WARM_UP_S, DRIVE_S = 180.0, 420.0
"""Time before the departure of the urgent vehicle, and from then to the end of the simulation."""
STRAIGHT_GREEN_S, GREEN_S = 16.0, 6.0
"""Green of phases in which opposite sides drive straight on, and of all others."""
RECOVERED_VEHICLES = 1.0
"""Excess of a signal's queue at which it has recovered."""


@dataclass(frozen=True)
class GridSettings:
    """A city with its signals and its urgent vehicle.

    Attributes:
        city: The grid.
        phases: Phases of every signal, in their order.
        blocked: Ratio of roads that become blocked during the drive.
        blocked_lanes: Number of their lanes that are blocked, from the outer one.
        start: Entry where the vehicle departs; None for a random one in the west.
        goal: Entry where it leaves the city; None for a random one in the east.
    """

    city: City
    phases: tuple[Phase, ...] = EIGHT_PHASES
    blocked: float = 0.2
    blocked_lanes: int = 1
    start: str | None = None
    goal: str | None = None

    @property
    def plan(self) -> dict[Phase, float]:
        """Green of each phase, s."""
        return {
            phase: STRAIGHT_GREEN_S if all(x % 2 == 0 for x in phase) else GREEN_S
            for phase in self.phases
        }

    @property
    def cycle_s(self) -> float:
        """Duration of all phases with their transitions."""
        return sum(self.plan.values()) + TRANSITION_S * len(self.phases)

    def ends(self, rng: np.random.Generator) -> tuple[str, str]:
        """Return start and goal; random ones are sampled in any case, so that others stay."""
        west, east = (int(k) for k in rng.integers(1, self.city.side + 1, 2))
        return self.start or f"west{west}", self.goal or f"east{east}"


@dataclass(frozen=True)
class Outcome:
    """One drive of the urgent vehicle.

    Attributes:
        strategy: How it was routed, and whether signals were preempted.
        per_hour: Vehicles that enter the city at every entry in an hour.
        seed: Random seed of traffic, ends and blocked lanes.
        travel_s: Time from departure to arrival, or to the end of the simulation.
        has_arrived: Whether it arrived before the end.
        undelayed_s: Time at top speed without signals.
        others_delay_s: Mean delay of the other vehicles.
        jams: Vehicles that SUMO moved out of a jam.
        preempted: Signals that were preempted.
        recoveries_s: For each of these, the time from its release until its queue has recovered;
            NaN if it has not before the end.
    """

    strategy: Strategy
    per_hour: float
    seed: int
    travel_s: float
    has_arrived: bool
    undelayed_s: float
    others_delay_s: float
    jams: int
    preempted: int
    recoveries_s: tuple[float, ...] = ()


def run_study(
    settings: GridSettings,
    volumes: Sequence[float],
    seeds: Sequence[int],
    done: Callable[[object], None],
) -> list[Outcome]:
    """Simulate every strategy with every volume and seed, on all cores; `done` after each four.

    What a version of SUMO has simulated is kept in the cache.

    Raises:
        SettingsError: If SUMO is missing.
        PlanningError: If no path leads to the goal.
        TrafficError: If SUMO refuses an input.
    """
    require_sumo()
    kept, causes = list[Outcome], (f"SUMO {importlib.metadata.version('libsumo')}",)
    tasks = [
        Task("traffic", f"{x:g} an hour, seed {k}", drive_all, (settings, x, k), kept, causes)
        for x in volumes
        for k in seeds
    ]
    return [outcome for outcomes in compute(tasks, done) for outcome in outcomes]


def drive_all(settings: GridSettings, per_hour: float, seed: int) -> list[Outcome]:
    """Simulate one traffic with every strategy, in this process."""
    city, rng = settings.city, np.random.default_rng(seed)
    ends = settings.ends(rng)
    undelayed_s = shortest_s(city, *ends)
    demand = make_demand(city, per_hour, WARM_UP_S + DRIVE_S, settings.blocked, rng)
    blocked = sorted((WARM_UP_S + x * undelayed_s, road) for road, x in demand.blocked.items())
    outcomes: list[Outcome] = []
    uncleared: dict[bool, Array] = {}
    for strategy in STRATEGIES:
        with TemporaryDirectory() as folder:
            traffic = Traffic(city, demand.trips, settings.plan, seed, Path(folder))
            traffic.run(WARM_UP_S)
            router = Router(city, traffic.travel_times_s(strategy.clearing), *ends)
            vehicle = UrgentVehicle(traffic, router, strategy, settings.phases)
            travel_s = _drive(vehicle, blocked, settings.blocked_lanes)
            others_delay_s, jams = traffic.close()
        queues = np.array(traffic.queues, dtype=float)
        if not strategy.clearing:
            uncleared[strategy.dynamic] = queues
        excess = queues - uncleared[strategy.dynamic]
        outcomes.append(
            Outcome(
                strategy, per_hour, seed, travel_s or DRIVE_S, travel_s is not None, undelayed_s,
                others_delay_s, jams, len(vehicle.preempted),
                tuple(_recovery_s(excess, settings, x) for x in vehicle.preempted),
            )
        )  # fmt: skip
    return outcomes


def shortest_s(city: City, start: str, goal: str) -> float:
    """Travel time at top speed without signals.

    Raises:
        SettingsError: If one of the entries does not exist.
        PlanningError: If there is no path.
    """
    return FREE_S + Router(city, free_times_s(city), start, goal).cost_s


def _drive(
    vehicle: UrgentVehicle, blocked: Sequence[tuple[float, str]], lanes: int
) -> float | None:
    """Run a simulation to its end; return the travel time, None if the vehicle did not arrive."""
    traffic, coming = vehicle.traffic, [*blocked]
    travel_s: float | None = None
    while traffic.time_s < WARM_UP_S + DRIVE_S:
        while coming and coming[0][0] <= traffic.time_s:
            traffic.block(coming.pop(0)[1], range(lanes))
        traffic.step()
        if travel_s is None:
            vehicle.step()
            if vehicle.has_arrived:
                travel_s = traffic.time_s - WARM_UP_S
    vehicle.release()
    return travel_s


def _recovery_s(excess: Array, settings: GridSettings, preempted: Preempted) -> float:
    """Time from a release until the queue is as long as without preemption, over a cycle."""
    column = excess[:, settings.city.signals.index(preempted.signal)]
    first = int(preempted.end_s // SAMPLE_S)
    window = round(settings.cycle_s / SAMPLE_S)
    if len(column) - first < window:
        return np.nan
    means = np.convolve(column[first:], np.full(window, 1 / window), "valid")
    recovered = np.flatnonzero(means <= RECOVERED_VEHICLES)
    return float(recovered[0] * SAMPLE_S) if len(recovered) else np.nan
