"""The follower: drives from node to node of a route, and stands before whatever is closed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim.world.world import START_S
from trials.gym.env.settings import TrialSettings
from trials.gym.world.barriers import Gate
from trials.navigation.steering import Pose2, SteeringSettings, Twist, pure_pursuit
from trials.routing.drive import Route
from trials.routing.network import Network, Road
from vo.contract.arrays import Array

PASSED_M = 0.35
"""So close to a node the rover has reached it."""
STAND_M, SEEN_M = 0.9, 2.5
"""Where the rover stands before what is closed, and from where on it brakes for it."""


@dataclass(frozen=True)
class RoadBook:
    """What is known of the roads.

    Attributes:
        network: Nodes and roads.
        gates: What may be closed, by road; that of a door by its node, twice.
        queues: By road, when it closes after departure, s, and for how long.
        clearing: Doors ahead are asked to open.
    """

    network: Network
    gates: Mapping[Road, Gate]
    queues: Mapping[Road, tuple[float, float]]
    clearing: bool


class Follower:
    """Drives along a route that may change at every node, and stands before closed gates.

    Attributes:
        passed: Nodes so far.
    """

    def __init__(self, trial: TrialSettings, book: RoadBook, route: Route, start: int) -> None:
        """Leave the start.

        Args:
            trial: Limits of the rover.
            book: What is known of the roads.
            route: To the goal.
            start: Node.
        """
        self._steering = SteeringSettings(
            forward_max_mps=trial.speed_max_mps,
            turn_max_radps=trial.turn_max_radps,
            ahead_m=PASSED_M + 0.1,
            period_s=1 / trial.rate_hz,
        )
        self._xy_m, self._queues, self._clearing = book.network.xy_m, book.queues, book.clearing
        self._route, self._gates = route, book.gates
        self.passed = [start]
        self._leave(0.0)

    def act(self, pose: Array, time_s: float) -> Array:
        """(2,) the next action.

        Args:
            pose: (3,) x, y, yaw as believed.
            time_s: Since departure.
        """
        here = pose[:2]
        while len(self._ahead) > 1 and np.linalg.norm(self._xy_m[self._ahead[0]] - here) < PASSED_M:
            self.passed.append(self._ahead[0])
            self._leave(time_s)
        way_m = self._xy_m[[self.passed[-1], *self._ahead]]
        x, y, yaw = (float(value) for value in pose)
        twist = pure_pursuit(Pose2(x, y, yaw), way_m, self._steering)
        limits = np.array([self._steering.forward_max_mps, self._steering.turn_max_radps])
        return np.clip(np.array(self._held(twist, here)) / limits, -1, 1).astype(np.float32)

    def _leave(self, time_s: float) -> None:
        """Choose the way on from the last node, and ask the doors ahead to open."""
        node = self.passed[-1]
        self._ahead = self._route.ahead(node, time_s)
        for door in self._ahead if self._clearing else ():
            if (door, door) in self._gates:
                self._gates[door, door].request(START_S + time_s)
        road = node, self._ahead[0]
        if road in self._gates and time_s < self._queues[road][0]:
            self._gates[road].waive()

    def _held(self, twist: Twist, here: Array) -> Twist:
        """Brake for the next gate, if it is closed."""
        node, following = self.passed[-1], self._ahead[0]
        for road in ((node, following), (following, following)):
            gate = self._gates.get(road)
            if gate is None or gate.is_up or not self._before(gate, here, following):
                continue
            room_m = max(0.0, gate.slot.away_m(here) - STAND_M)
            if gate.slot.away_m(here) < SEEN_M:
                top_mps = math.sqrt(2 * self._steering.forward_accel_mps2 * room_m)
                share = min(1.0, top_mps / max(twist.forward_mps, 1e-6))
                return Twist(share * twist.forward_mps, share * twist.turn_radps)
        return twist

    def _before(self, gate: Gate, here: Array, following: int) -> bool:
        """Whether a gate lies between here and the next node, or at it."""
        on = self._xy_m[following] - self._xy_m[self.passed[-1]]
        return bool((gate.slot.centre[:2] - here) @ on > 0)
