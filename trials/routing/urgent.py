"""An urgent vehicle in a city's traffic: its route, and the signals that it preempts."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf

import numpy as np

from trials.navigation import PlanningError
from trials.navigation.dstar_lite import DStarLite
from trials.routing.city import LANES, SPEED_MPS, City
from trials.routing.drive import Strategy
from trials.routing.phases import Phase, select_phase
from trials.routing.preemption import Discharge, Green, preemption_start_s
from trials.routing.signal_controller import TRANSITION_S
from trials.routing.traffic import FREE_S, Traffic
from vo.contract.arrays import Array

NAME = "urgent"
MARGIN_S = 5.0
CONGESTED_VEHICLES = 4.0
"""Queue in a lane from which the congestion before a signal is high."""
DISCHARGE = Discharge()


class Router:
    """The fastest roads to a goal by the latest travel times, repaired by D* Lite.

    Raises:
        PlanningError: If there is no path from the start to the goal.
    """

    def __init__(self, city: City, times_s: Array, start: str, goal: str) -> None:
        self.city, self.start, self.goal = city, *city.ends(start, goal)
        self._graph = city.graph(times_s)
        first, last = city.index[self.start], city.index[self.goal]
        self._planner = DStarLite(self._graph, len(city.roads), first, last)
        if self._planner.cost == inf:
            raise PlanningError(f"no path from {start} to {goal}")

    @property
    def cost_s(self) -> float:
        """Travel time until the last road."""
        return self._planner.cost

    def path(self) -> list[str]:
        """List the roads from the vehicle to the goal, its own road first."""
        roads = tuple(self.city.roads)
        return [roads[k] for k in self._planner.path()]

    def replan(self, road: str, times_s: Array) -> list[str]:
        """Repair the path of a vehicle that is on a road; return it."""
        changed = np.unique(self._graph.tails[times_s != self._graph.costs])
        self._graph.costs[:] = times_s
        self._planner.move(self.city.index[road])
        self._planner.replan(changed)
        return self.path()


@dataclass(frozen=True)
class Preempted:
    """A signal that was preempted, from when to when, s."""

    signal: str
    start_s: float
    end_s: float


class UrgentVehicle:
    """The vehicle from its departure to its arrival.

    Attributes:
        preempted: The preemptions that have ended.
    """

    def __init__(
        self, traffic: Traffic, router: Router, strategy: Strategy, phases: Sequence[Phase]
    ) -> None:
        self.traffic, self.router, self.strategy, self.phases = traffic, router, strategy, phases
        self.preempted: list[Preempted] = []
        self._since_s: dict[str, float] = {}
        self._path = router.path()
        self._vehicle = traffic.sumo.vehicle
        types = traffic.sumo.vehicletype
        types.copy("DEFAULT_VEHTYPE", NAME)
        types.setVehicleClass(NAME, "emergency")
        types.setSpeedFactor(NAME, 1.0)
        types.setSpeedDeviation(NAME, 0.0)
        traffic.sumo.route.add(NAME, self._path)
        self._vehicle.add(NAME, NAME, NAME, "now", "best", "base", "max")

    @property
    def has_arrived(self) -> bool:
        """Whether the last step has taken it to its goal."""
        return NAME in self.traffic.sumo.simulation.getArrivedIDList()

    def step(self) -> None:
        """Replan on every new road, and preempt the signals ahead."""
        if self.has_arrived:
            self.release()
        if NAME not in self._vehicle.getIDList():
            return
        road = self._vehicle.getRoadID(NAME)
        if road in self.traffic.city.roads:  # not inside an intersection
            if road != self._path[0]:
                self._path = self._path[self._path.index(road) :]
                if self.strategy.dynamic:
                    times_s = self.traffic.travel_times_s(self.strategy.clearing)
                    self._path = self.router.replan(road, times_s)
                    self._vehicle.setRoute(NAME, self._path)
            if self.strategy.clearing:
                self._preempt()

    def release(self) -> None:
        """Release all signals."""
        self._release(())

    def _preempt(self) -> None:
        """Preempt every signal on the path whose time has come; release those behind."""
        traffic, now_s = self.traffic, self.traffic.time_s
        lane = self._vehicle.getLaneID(NAME)
        rest_m = traffic.sumo.lane.getLength(lane) - self._vehicle.getLanePosition(NAME)
        arrival_s = now_s + rest_m / SPEED_MPS
        self._release([traffic.city.roads[road][1] for road in self._path[:-1]])
        for road, following in pairwise(self._path):
            signal = traffic.city.roads[road][1]
            movement = traffic.city.turns[road, following]
            queue = self._queue(road, movement, arrival_s)
            is_congested = queue >= CONGESTED_VEHICLES
            delay_s = DISCHARGE.delay_s(queue) if is_congested else 0.0
            start_s = preemption_start_s(arrival_s, TRANSITION_S, MARGIN_S, delay_s)
            if signal not in self._since_s and now_s >= start_s:
                controller = traffic.controllers[signal]
                origin, target = traffic.city.origin(road), traffic.city.heading(following)
                choice = select_phase(self.phases, controller.phase, origin, target, is_congested)
                controller.request(choice.phase, now_s)
                self._since_s[signal] = now_s
            arrival_s += FREE_S

    def _queue(self, road: str, movement: int, arrival_s: float) -> float:
        """Vehicles in each lane before the urgent one when it arrives."""
        traffic = self.traffic
        controller = traffic.controllers[traffic.city.roads[road][1]]
        green = controller.last_green(movement) or Green(traffic.time_s, 0.0)
        open_lanes = len(controller.green & {*traffic.city.movements(road)})
        flow_per_s = open_lanes / DISCHARGE.headway_s
        return traffic.counts(road).queue(arrival_s, green, flow_per_s) / LANES

    def _release(self, ahead: Sequence[str]) -> None:
        for signal in [x for x in self._since_s if x not in ahead]:
            now_s = self.traffic.time_s
            self.traffic.controllers[signal].release(now_s)
            self.preempted.append(Preempted(signal, self._since_s.pop(signal), now_s))
