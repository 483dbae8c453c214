"""The rover on a routed drive: doors that open early where it is expected, aisles that fill up.

The route is that of `trials.routing`; the rover drives it in MuJoCo, by pure pursuit from node to
node, and stands before whatever is closed. Doors and loads report to it, as queues do in the model.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.world.world import START_S
from trials.gym.env.environments import RoverNav
from trials.gym.env.follower import Follower, RoadBook
from trials.gym.env.tasks import ReachGoal, Task
from trials.gym.world.aisles import Aisles, gate_name, make_gates, survey_aisles
from trials.gym.world.barriers import Gate
from trials.gym.world.scene_instance import Site, relaid
from trials.gym.world.start_goal_sampling import draw_errand
from trials.routing.drive import STRATEGIES, Delays, Strategy, drive, plan_route, undelayed_s
from trials.routing.network import Road

WAIT_MAX_S, QUEUE_MAX_S, LEAD_S, SHARE = 30.0, 60.0, 8.0, 0.6
"""Longest wait at a door and behind a load, lead of an opening, and share of congested aisles."""


@dataclass(frozen=True)
class RoutedCase:
    """One drive, to be made by every strategy.

    Attributes:
        start: Node.
        goal: Node.
        delays: Waits at doors, and loads in the aisles.
        free_s: Travel time without any, by the model.
    """

    start: int
    goal: int
    delays: Delays
    free_s: float


@dataclass(frozen=True)
class RoutedDrive:
    """What came of it.

    Attributes:
        layout: Seed of the world.
        strategy: Name.
        outcome: Of the trial.
        predicted_s: Travel time by the routing model.
        measured_s: By the rover.
        free_s: By the model, without delays.
        predicted: Names of the nodes, as the model passes them.
        passed: As the rover did.
        trace: (N, 2) the rover's way.
    """

    layout: int
    strategy: str
    outcome: str
    predicted_s: float
    measured_s: float
    free_s: float
    predicted: tuple[str, ...]
    passed: tuple[str, ...]
    trace: tuple[tuple[float, float], ...]


class AisleRover(RoverNav):
    """Reach a goal through gates of one's own, in a world that is laid once for all drives.

    Attributes:
        gates: By name.
    """

    def __init__(self, **options: Any) -> None:
        """See RoverNav; without gates, it is one."""
        super().__init__(**options)
        self.gates: Mapping[str, Gate] = {}
        self._laid: Site | None = None

    def _assign(self, site: Site, options: Mapping[str, Any]) -> tuple[Site, Task]:
        if not self.gates:
            return super()._assign(site, options)
        start, goal = np.array(options["start"]), np.array(options["goal"])
        passages, trial = site.passages, self.trial
        errand = draw_errand(passages, site.part, trial.distance_m, self.np_random, start, goal)
        self._laid = self._laid or relaid(site, trial, errand, self.gates)
        return self._laid, ReachGoal(errand, trial.goal_radius_m)


def draw_case(aisles: Aisles, rng: np.random.Generator) -> RoutedCase:
    """Choose ends on opposite sides, waits and loads.

    Raises:
        PlanningError: If the network does not join the ends.
    """
    network = aisles.network
    near, far = (aisles.lefts, aisles.rights)[:: 1 if rng.random() < 0.5 else -1]
    i = int(rng.integers(len(near)))
    j = int(rng.choice([k for k in range(len(far)) if k != i]))
    start, goal = near[i], far[j]
    waits_s = np.zeros(len(network.names))
    for node in aisles.doors:
        waits_s[node] = rng.uniform(0, WAIT_MAX_S)
    free_s = undelayed_s(network, start, goal)
    queues: dict[Road, tuple[float, float]] = {}
    for a, b in aisles.halves:
        if a < b:
            congested = rng.random() < SHARE
            queue = float(rng.uniform(0, free_s / 3)), float(rng.uniform(0, QUEUE_MAX_S))
            if congested:
                queues |= {(a, b): queue, (b, a): queue}
    return RoutedCase(start, goal, Delays(waits_s, queues, LEAD_S), free_s)


def drive_layout(options: Mapping[str, Any], layout: int) -> list[RoutedDrive]:
    """Draw a drive through one layout, and make it by every strategy.

    Args:
        options: Of RoverNav; `observe` must hold `pose`.
        layout: Seed of the world and of the drive.

    Raises:
        DriftyardError: If it is no warehouse, or has no way.
    """
    env = AisleRover(**options)
    try:
        env.reset(seed=layout, options={"layout": layout})
        aisles = survey_aisles(env.site, env.trial.speed_max_mps)
        case = draw_case(aisles, np.random.default_rng([layout, 1]))
        gates = make_gates(aisles, case.delays, START_S)
        env.gates = {gate_name(road): gate for road, gate in gates.items() if road[0] <= road[1]}
        return [drive_rover(env, layout, aisles, case, gates, s) for s in STRATEGIES]
    finally:
        env.close()


def drive_rover(
    env: AisleRover,
    layout: int,
    aisles: Aisles,
    case: RoutedCase,
    gates: Mapping[Road, Gate],
    strategy: Strategy,
) -> RoutedDrive:
    """Make a drive by one strategy."""
    network = aisles.network
    route = plan_route(network, case.delays, case.start, case.goal, strategy)
    first = route.ahead(case.start, 0.0)[0]
    ahead = network.xy_m[first] - network.xy_m[case.start]
    place = (*network.xy_m[case.start], math.atan2(ahead[1], ahead[0]))
    options = {"layout": layout, "start": place, "goal": tuple(network.xy_m[case.goal])}
    observation, info = env.reset(seed=layout, options=options)
    road_book = RoadBook(network, gates, case.delays.queues, strategy.clearing)
    follower = Follower(env.trial, road_book, route, case.start)
    while not info["outcome"]:
        observation, _, _, _, info = env.step(follower.act(observation["pose"], info["time_s"]))
    model = drive(network, case.delays, case.start, case.goal, strategy)
    names = network.names
    passed = [*follower.passed, case.goal] if info["success"] else follower.passed
    return RoutedDrive(
        layout,
        strategy.name,
        info["outcome"],
        model.time_s,
        info["time_s"],
        case.free_s,
        tuple(names[k] for k in model.nodes),
        tuple(names[k] for k in dict.fromkeys(passed)),
        tuple((float(x), float(y)) for x, y in env.trace[:, 0]),
    )
