"""A driver that follows a route from node to node, and stops before closed gates."""

import math
from collections.abc import Mapping

import numpy as np

from sim.world.world import START_S
from trials.gym.env.settings import TrialSettings
from trials.gym.world.dynamic_agents import Gate
from trials.navigation.steering import Pose2, SteeringSettings, Twist, pure_pursuit
from trials.routing.drive import Route
from trials.routing.network import Road
from vo.contract.arrays import Array

REACHED_M = 0.35
"""Distance from a node at which the rover has reached it."""
STOP_M, BRAKING_M = 0.9, 2.5
"""Distances from a closed gate at which the rover stands, and from which on it brakes."""


class RouteFollower:
    """Follows a route that may change at every node, and stops before closed gates.

    Its nodes so far are `passed`.
    """

    def __init__(self, trial: TrialSettings, route: Route, gates: Mapping[Road, Gate]) -> None:
        """Leave the start of a route; the road of a door leads from its node to itself."""
        self._steering = SteeringSettings(
            forward_max_mps=trial.speed_max_mps,
            turn_max_radps=trial.turn_max_radps,
            lookahead_m=REACHED_M + 0.1,
            period_s=1 / trial.rate_hz,
        )
        self._route, self._xy_m, self._gates = route, route.network.xy_m, gates
        self.passed = [route.start]
        self._leave_node(0.0)

    def act(self, pose: Array, time_s: float) -> Array:
        """Choose the next action (2,) at an estimated x, y, yaw (3,) and a time since departure."""
        here, xy_m = pose[:2], self._xy_m
        while len(self._ahead) > 1 and np.linalg.norm(xy_m[self._ahead[0]] - here) < REACHED_M:
            self.passed.append(self._ahead[0])
            self._leave_node(time_s)
        path_m = xy_m[[self.passed[-1], *self._ahead]]
        x, y, yaw = (float(value) for value in pose)
        twist = pure_pursuit(Pose2(x, y, yaw), path_m, self._steering)
        limits = np.array([self._steering.forward_max_mps, self._steering.turn_max_radps])
        return np.clip(np.array(self._braked(twist, here)) / limits, -1, 1).astype(np.float32)

    def _leave_node(self, time_s: float) -> None:
        """Choose the nodes ahead of the last one; with clearing, request the doors to open."""
        node, gates = self.passed[-1], self._gates
        self._ahead = self._route.ahead(node, time_s)
        for door in self._ahead if self._route.strategy.clearing else ():
            if (door, door) in gates:
                gates[door, door].request(START_S + time_s)
        if (node, self._ahead[0]) in gates:
            gates[node, self._ahead[0]].enter(START_S + time_s)

    def _braked(self, twist: Twist, here: Array) -> Twist:
        """Brake for a closed gate between here and the next node, or at it."""
        node, following = self.passed[-1], self._ahead[0]
        direction = self._xy_m[following] - self._xy_m[node]
        for road in ((node, following), (following, following)):
            gate = self._gates.get(road)
            if gate is None or gate.is_up or (gate.slot.centre[:2] - here) @ direction <= 0:
                continue
            distance_m = gate.slot.distance_m(here)
            if distance_m < BRAKING_M:
                room_m = max(0.0, distance_m - STOP_M)
                max_mps = math.sqrt(2 * self._steering.forward_accel_mps2 * room_m)
                factor = min(1.0, max_mps / max(twist.forward_mps, 1e-6))
                return Twist(factor * twist.forward_mps, factor * twist.turn_radps)
        return twist
