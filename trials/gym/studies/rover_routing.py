"""The rover on routes of `trials.routing`: doors that open on request, aisles that get congested.

The rover drives in MuJoCo by pure pursuit from node to node, and stops before closed gates. Doors
and loads are reported to it, as queues are in the model.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.world.world import START_S
from trials.gym.env.environments import RoverNav
from trials.gym.env.tasks import Task
from trials.gym.studies.aisle_network import (
    AisleNetwork,
    build_aisle_network,
    gate_name,
    make_gates,
)
from trials.gym.studies.route_follower import RouteFollower
from trials.gym.world.dynamic_agents import Gate
from trials.gym.world.scene_instance import SceneInstance, rebuilt_along
from trials.routing.drive import STRATEGIES, Delays, Route, Strategy, drive, undelayed_s
from trials.routing.network import Network, Road
from vo.contract.arrays import Array

MAX_WAIT_S, MAX_QUEUE_S, LEAD_S, CONGESTED = 30.0, 60.0, 8.0, 0.6
"""Longest wait at a door and behind a load, lead of an opening, ratio of congested aisles."""


@dataclass(frozen=True)
class RoverDrive:
    """Result of a drive with one strategy.

    Attributes:
        layout: Seed of the world.
        strategy: Name.
        outcome: Outcome of the trial.
        predicted_s: Travel time by the routing model.
        measured_s: Travel time of the rover.
        free_s: Travel time by the model without delays.
        predicted: Names of the nodes that the model passes.
        passed: Names of the nodes that the rover passed.
        trace: (N, 2) true x, y of the rover.
    """

    layout: int
    strategy: str
    outcome: str
    predicted_s: float
    measured_s: float
    free_s: float
    predicted: tuple[str, ...]
    passed: tuple[str, ...]
    trace: Array


class AisleRover(RoverNav):
    """Reach a goal through given gates, in a world that is built once for all drives.

    Attributes:
        gates: By name; without any, it is a RoverNav.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.gates: Mapping[str, Gate] = {}
        self._gated: SceneInstance | None = None

    def _assign(
        self, base: SceneInstance, options: Mapping[str, Any]
    ) -> tuple[SceneInstance, Task]:
        instance, task = super()._assign(base, options)
        if self.gates:
            self._gated = instance = self._gated or rebuilt_along(base, task.path, self.gates)
        return instance, task


def drive_layout(options: Mapping[str, Any], layout: int) -> list[RoverDrive]:
    """Sample a drive through one layout, and make it with every strategy.

    Args:
        options: Of RoverNav; `observe` must hold `pose`.
        layout: Seed of the world and of the drive.

    Raises:
        DriftyardError: If the scene is no warehouse, or has no path.
    """
    env = AisleRover(**options)
    try:
        env.reset(seed=layout, options={"layout": layout})
        aisles = build_aisle_network(env.instance, env.trial.speed_max_mps)
        start, goal, delays = _sample_case(aisles, np.random.default_rng([layout, 1]))
        gates = make_gates(aisles, delays, START_S)
        env.gates = {gate_name(road): gate for road, gate in gates.items() if road[0] <= road[1]}
        return [_drive(env, aisles.network, delays, start, goal, gates, s) for s in STRATEGIES]
    finally:
        env.close()


def _sample_case(aisles: AisleNetwork, rng: np.random.Generator) -> tuple[int, int, Delays]:
    """Sample start and goal on opposite sides, waits at doors and loads in aisles."""
    network = aisles.network
    near, far = (aisles.lefts, aisles.rights)[:: 1 if rng.random() < 0.5 else -1]
    i = int(rng.integers(len(near)))
    j = int(rng.choice([k for k in range(len(far)) if k != i]))
    waits_s = np.zeros(len(network.names))
    for node in aisles.doors:
        waits_s[node] = rng.uniform(0, MAX_WAIT_S)
    free_s = undelayed_s(network, near[i], far[j])
    queues: dict[Road, tuple[float, float]] = {}
    for a, b in aisles.loads:
        if a < b:
            congested = rng.random() < CONGESTED
            queue = float(rng.uniform(0, free_s / 3)), float(rng.uniform(0, MAX_QUEUE_S))
            if congested:
                queues |= {(a, b): queue, (b, a): queue}
    return near[i], far[j], Delays(waits_s, queues, LEAD_S)


def _drive(
    env: AisleRover,
    network: Network,
    delays: Delays,
    start: int,
    goal: int,
    gates: Mapping[Road, Gate],
    strategy: Strategy,
) -> RoverDrive:
    layout, xy_m = env.instance.layout, network.xy_m
    route = Route(network, delays, start, goal, strategy)
    ahead = xy_m[route.ahead(start, 0.0)[0]] - xy_m[start]
    pose = (*xy_m[start], math.atan2(ahead[1], ahead[0]))
    options = {"layout": layout, "start": pose, "goal": tuple(xy_m[goal])}
    observation, info = env.reset(seed=layout, options=options)
    follower = RouteFollower(env.trial, route, start, xy_m, gates, strategy.clearing)
    while not info["outcome"]:
        observation, _, _, _, info = env.step(follower.act(observation["pose"], info["time_s"]))
    model = drive(network, delays, start, goal, strategy)
    passed = [*follower.passed, goal] if info["success"] else follower.passed
    return RoverDrive(
        layout=layout,
        strategy=strategy.name,
        outcome=info["outcome"],
        predicted_s=model.time_s,
        measured_s=info["time_s"],
        free_s=undelayed_s(network, start, goal),
        predicted=tuple(network.names[k] for k in model.nodes),
        passed=tuple(network.names[k] for k in dict.fromkeys(passed)),
        trace=env.episode.trace[:, 0],
    )
