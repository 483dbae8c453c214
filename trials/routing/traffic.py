"""A city's traffic in SUMO: signals by their controllers, detectors and measured travel times."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from trials.routing.city import (
    BLOCK_M,
    DETECTOR_M,
    LANES,
    SAMPLE_S,
    SPEED_MPS,
    City,
    detectors_of,
    lane_of,
)
from trials.routing.demand import Trip
from trials.routing.phases import Phase
from trials.routing.preemption import Counts
from trials.routing.signal_controller import SignalController, mean_waits_s
from trials.routing.sumo import TrafficError, require_sumo
from vo.contract.arrays import Array

STEP_S = 1.0
MEMORY_S = 150.0
"""Time constant with which measured travel times forget."""
USUAL_VEHICLES = 2.0
"""Weight of the usual travel time beside the measured vehicles, which may be few."""
BLOCKED_AT_M = 0.6 * BLOCK_M
"""Place of a vehicle that has broken down on its road."""
BLOCKED_S = 240.0
"""Time for which it blocks its lane."""
FREE_S = BLOCK_M / SPEED_MPS
TURN_S = 4.0
"""Time that a turn takes longer than the way straight on, for braking."""


class Traffic:
    """A running simulation.

    Only one can run in a process; `close` ends it.

    Attributes:
        time_s: Time since the begin.
        controllers: Controller of each signal.
        queues: Vehicles that stand before each signal, one row of all signals a sample.

    Raises:
        SettingsError: If SUMO is missing.
        TrafficError: If SUMO refuses an input.
    """

    def __init__(
        self,
        city: City,
        trips: Sequence[Trip],
        plan: Mapping[Phase, float],
        seed: int,
        folder: Path,
    ) -> None:
        self.sumo, _ = require_sumo()
        self.city, self.folder, self.time_s = city, folder, 0.0
        rng = np.random.default_rng(seed)
        self.controllers = {signal: _controller(plan, rng) for signal in city.signals}
        self._waits_s = mean_waits_s(plan)
        self.queues: list[list[int]] = []
        self._spent_s, self._passes, self._blocked_until_s = np.zeros((3, len(city.roads), LANES))
        self._sampled_s: list[float] = []
        self._crossed: list[Array] = []
        network, detectors = city.write(folder)
        routes = _write(trips, folder / "trips.xml")
        words: list[Any] = ["sumo", "-n", network, "-r", routes, "-a", detectors, "--seed", seed]
        words += ["--tripinfo-output", folder / "trips.out.xml"]
        words += [f"--tripinfo-output.write-{x}" for x in ("unfinished", "undeparted")]
        words += ["--no-step-log", "--no-warnings"]
        self._call(self.sumo.start, [*map(str, words)])
        signals = self.sumo.trafficlight.getIDList()  # without those where all turns are closed
        self._links = {signal: self._movements(signal) for signal in signals}
        self._shown: dict[str, str] = {}
        self._jams = 0

    def _call(self, function: Any, *values: Any) -> Any:
        try:
            return function(*values)
        except self.sumo.TraCIException as error:
            raise TrafficError(f"SUMO: {error}") from None

    def _movements(self, signal: str) -> list[int]:
        links = self.sumo.trafficlight.getControlledLinks(signal)
        ends = [tuple(x.rpartition("_")[0] for x in link[0][:2]) for link in links]
        return [self.city.turns[a, b] for a, b in ends]

    def step(self) -> None:
        """Advance by a step: signals, vehicles, and every few steps the measurements."""
        for signal, links in self._links.items():
            controller = self.controllers[signal]
            controller.step(self.time_s)
            lights = "".join(controller.light(x, self.time_s) for x in links)
            if lights != self._shown.get(signal):
                self._shown[signal] = lights
                self.sumo.trafficlight.setRedYellowGreenState(signal, lights)
        self._call(self.sumo.simulationStep)
        self._jams += self.sumo.simulation.getStartingTeleportNumber()
        self.time_s += STEP_S
        if self.time_s % SAMPLE_S == 0:
            self._sample()

    def run(self, end_s: float) -> None:
        """Advance to a time."""
        while self.time_s < end_s:
            self.step()

    def _sample(self) -> None:
        edge, lane, loop = self.sumo.edge, self.sumo.lane, self.sumo.inductionloop
        lanes = [[f"{road}_{k}" for k in range(LANES)] for road in self.city.roads]
        counts = np.array([[*map(lane.getLastStepVehicleNumber, x)] for x in lanes])
        speeds_mps = np.array([[*map(lane.getLastStepMeanSpeed, x)] for x in lanes])
        kept = np.exp(-SAMPLE_S / MEMORY_S)
        moving = (counts - (self._blocked_until_s > self.time_s)).clip(0)
        self._spent_s = kept * self._spent_s + SAMPLE_S * moving
        self._passes = kept * self._passes + SAMPLE_S / BLOCK_M * counts * speeds_mps.clip(0)
        self._sampled_s.append(self.time_s)
        halting = dict.fromkeys(self.city.signals, 0)
        for road, (_, signal) in self.city.roads.items():
            if signal in halting:
                halting[signal] += edge.getLastStepHaltingNumber(road)
        self.queues.append([*halting.values()])
        new = [
            [sum(map(loop.getLastIntervalVehicleNumber, names)) for names in detectors_of(road)]
            for road in self.city.roads
        ]
        self._crossed.append(np.array(new) + (self._crossed[-1] if self._crossed else 0))

    def travel_times_s(self, is_cleared: bool = False) -> Array:
        """(turns,) travel times of the road before each turn, at least those at top speed.

        They are the time that vehicles have spent in the lanes of the turn over the lengths that
        they have driven there, in lengths of the road; some vehicles with the usual time, the one
        at top speed and the mean wait for green, are added. If the signals will be cleared, that
        wait is taken off. A road of which all lanes are blocked is reported, with the time that
        remains.
        """
        rows = [self.city.index[road] for road, _ in self.city.turns]
        movements = self.city.turns.values()
        free_s = free_times_s(self.city)
        waits_s = np.array([self._waits_s[x] for x in movements])
        spent_s, passed = (
            x[rows, [*map(lane_of, movements)]] for x in (self._spent_s, self._passes)
        )
        usual_s = USUAL_VEHICLES * (free_s + waits_s)
        times_s = (spent_s + usual_s) / (passed + USUAL_VEHICLES)
        times_s += np.maximum(self._blocked_until_s.min(axis=1)[rows] - self.time_s, 0.0)
        return np.maximum(times_s - (waits_s if is_cleared else 0.0), free_s)

    def counts(self, road: str) -> Counts:
        """Return what the detectors of a road have counted."""
        passed = np.array([x[self.city.index[road]] for x in self._crossed]).reshape(-1, 2)
        times_s = np.array(self._sampled_s)
        undelayed_s = (self.sumo.lane.getLength(f"{road}_0") - DETECTOR_M) / SPEED_MPS
        arrivals = (
            np.interp(times_s - undelayed_s, times_s, passed[:, 0]) if len(passed) else times_s
        )
        return Counts(road, times_s, arrivals, passed[:, 1])

    def block(self, road: str, lanes: Sequence[int]) -> None:
        """Let a vehicle break down on lanes; they are not in the measured travel times."""
        self.sumo.route.add(f"blocked {road}", [road])
        for lane in lanes:
            self._blocked_until_s[self.city.index[road], lane] = self.time_s + BLOCKED_S
            name, place = f"blocked {road} {lane}", (str(BLOCKED_AT_M - 5), "0")
            kind, now = "DEFAULT_VEHTYPE", "now"
            self._call(self.sumo.vehicle.add, name, f"blocked {road}", kind, now, str(lane), *place)
            self._call(self.sumo.vehicle.setStop, name, road, BLOCKED_AT_M, lane, BLOCKED_S)

    def close(self) -> tuple[float, int]:
        """End the simulation.

        Returns:
            Mean delay of the other vehicles (lost time, and wait for a place to enter), s, and the
            number of vehicles that SUMO has moved out of a jam.
        """
        self.sumo.close()
        tree = ElementTree.parse(self.folder / "trips.out.xml")
        delays_s = [
            float(x.get("timeLoss", 0)) + float(x.get("departDelay", 0))
            for x in tree.iter("tripinfo")
            if x.get("id", "").isdecimal()
        ]
        return float(np.mean(delays_s)) if delays_s else 0.0, self._jams


def free_times_s(city: City) -> Array:
    """(turns,) travel times of the road before each turn at top speed, without signals."""
    turns = [city.heading(a) != city.heading(b) for a, b in city.turns]
    return FREE_S + TURN_S * np.array(turns, dtype=float)


def _controller(plan: Mapping[Phase, float], rng: np.random.Generator) -> SignalController:
    """Make a controller that begins anywhere in the plan."""
    steps = [*plan.items()]
    first = int(rng.integers(len(steps)))
    steps = steps[first:] + steps[:first]
    return SignalController(steps, -float(rng.uniform(0, steps[0][1])))


def _write(trips: Sequence[Trip], out: Path) -> Path:
    """Write trips as routes of SUMO; return the file."""
    lines = [
        f'<vehicle id="{k}" depart="{depart_s:.2f}" departLane="best" departSpeed="max">'
        f'<route edges="{" ".join(roads)}"/></vehicle>'
        for k, (depart_s, roads) in enumerate(trips)
    ]
    out.write_text("\n".join(["<routes>", *lines, "</routes>"]), "utf-8")
    return out
