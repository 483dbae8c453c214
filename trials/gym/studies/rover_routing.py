"""The rover on routes of `trials.routing`: doors that open on request, aisles that get congested.

The rover drives in MuJoCo by pure pursuit from node to node, and stops before closed gates. Doors
and loads are reported to it, as queues are in the model.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pydantic import PlainSerializer, PlainValidator

from sim.world.world import START_S
from trials.gym.env.environments import RoverNav
from trials.gym.env.rover_env import Assignment
from trials.gym.studies.aisle_network import AisleNetwork, build_aisle_network, make_gates
from trials.gym.studies.route_follower import RouteFollower
from trials.gym.world.dynamic_agents import Gate
from trials.gym.world.free_space import NO_GEOM, FreeSpace
from trials.gym.world.scene_instance import SceneInstance, rebuilt_along
from trials.report.figure import BLUE, GREEN, GREY, INK, OCHRE, PALE, RED, shared_legend, tidy
from trials.routing.drive import STRATEGIES, Delays, Route, Strategy, drive, undelayed_s
from trials.routing.network import Network, Road
from vo.contract.arrays import Array

StoredArray = Annotated[
    Array, PlainSerializer(lambda x: x.tolist()), PlainValidator(lambda x: np.asarray(x))
]
Case = tuple[int, int, Delays]
"""Start, goal and delays of a drive."""
MAX_WAIT_S, MAX_QUEUE_S, LEAD_S, CONGESTED = 30.0, 60.0, 8.0, 0.6
"""Longest wait at a door and behind a load, lead of an opening, ratio of congested aisles."""
SIZE_IN = (9.6, 4.2)
COLOURS = (INK, RED, BLUE, OCHRE)
"""Colours of the strategies, in their order."""
WIDTHS = (7.0, 4.8, 2.8, 1.2)
"""Widths of their paths, points: drawn on top of each other, all stay visible."""


@dataclass(frozen=True)
class RoverDrive:
    """Result of a drive with one strategy: travel times and nodes, by the model and of the rover.

    `free_s` is the time by the model without delays, `trace` (N, 2) the true x, y of the rover.
    """

    layout: int
    strategy: str
    outcome: str
    predicted_s: float
    measured_s: float
    free_s: float
    predicted: tuple[str, ...]
    passed: tuple[str, ...]
    trace: StoredArray


class AisleRover(RoverNav):
    """Reach a goal through `gates`, by name, in a world that is built once for all drives."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.gates: Mapping[str, Gate] = {}
        self._gated: SceneInstance | None = None

    def _assign(self, base: SceneInstance, options: Mapping[str, Any]) -> Assignment:
        instance, task = super()._assign(base, options)
        if self.gates:
            self._gated = instance = self._gated or rebuilt_along(base, task.path, self.gates)
        return instance, task


def drive_layout(options: Mapping[str, Any], layout: int) -> list[RoverDrive]:
    """Sample a drive through the layout of a seed, and make it with every strategy.

    Options are those of RoverNav; `observe` must hold `pose`.

    Raises:
        DriftyardError: If the scene is no warehouse, or has no path.
    """
    env = AisleRover(**options)
    try:
        env.reset(seed=layout, options={"layout": layout})
        aisles = build_aisle_network(env.instance, env.trial.speed_max_mps)
        case = _sample_case(aisles, np.random.default_rng([layout, 1]))
        gates = make_gates(aisles, case[2], START_S)
        env.gates = {
            f"door_{a}" if a == b else f"load_{a}_{b}": gate
            for (a, b), gate in gates.items()
            if a <= b
        }
        return [_drive(env, aisles.network, case, gates, strategy) for strategy in STRATEGIES]
    finally:
        env.close()


def _sample_case(aisles: AisleNetwork, rng: np.random.Generator) -> Case:
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
    env: AisleRover, network: Network, case: Case, gates: Mapping[Road, Gate], strategy: Strategy
) -> RoverDrive:
    start, goal, delays = case
    layout, xy_m = env.instance.layout, network.xy_m
    route = Route(network, delays, start, goal, strategy)
    ahead = xy_m[route.ahead(start, 0.0)[0]] - xy_m[start]
    pose = (*xy_m[start], math.atan2(ahead[1], ahead[0]))
    options = {"layout": layout, "start": pose, "goal": tuple(xy_m[goal])}
    observation, info = env.reset(seed=layout, options=options)
    follower = RouteFollower(env.trial, route, gates)
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


def most_varied_layout(drives: Sequence[RoverDrive]) -> int:
    """Return the layout with the most different routes, then with the largest range of times."""

    def variety(layout: int) -> tuple[int, float]:
        here = [d for d in drives if d.layout == layout]
        return len({d.passed for d in here}), float(np.ptp([d.measured_s for d in here]))

    return max({d.layout for d in drives}, key=variety)


def draw_drives(
    figure: Figure,
    drives: Sequence[RoverDrive],
    layout: int,
    aisles: AisleNetwork,
    space: FreeSpace,
) -> None:
    """Draw the paths in the world of `layout`, and the times in all worlds."""
    above, times = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    _draw_world(above, [d for d in drives if d.layout == layout], aisles, space)
    above.set_title(f"layout {layout}")
    _draw_times(times, drives)
    shared_legend(figure, [above, times])


def _draw_world(
    panel: Axes, drives: Sequence[RoverDrive], aisles: AisleNetwork, space: FreeSpace
) -> None:
    height, width = space.obstacles.shape
    corners = space.points(np.array([[-0.5, -0.5], [height - 0.5, width - 0.5]]))
    (left, right), (bottom, top) = corners.T.tolist()
    panel.imshow(
        np.where(space.obstacles != NO_GEOM, 1.0, np.nan), cmap="Greys", vmin=0, vmax=3,
        extent=(left, right, bottom, top), origin="lower",
    )  # fmt: skip
    for slots, colour, label in (
        (aisles.doors.values(), GREEN, "door"),
        (list(aisles.loads.values())[::2], PALE, "room for a load"),
    ):
        for k, slot in enumerate(slots):
            panel.fill(*slot.corners.T, color=colour, lw=2, label=label if k == 0 else None)
    by_name = {d.strategy: d for d in drives}
    for strategy, colour, width_pt in zip(STRATEGIES, COLOURS, WIDTHS, strict=True):
        path = by_name[strategy.name].trace
        panel.plot(*path.T, color=colour, lw=width_pt, label=strategy.name, solid_capstyle="round")
    panel.plot(*drives[0].trace[0], "o", color=INK, mfc="white", ms=7, zorder=5)
    panel.set_aspect("equal")
    tidy(panel, "x, m", "y, m")
    panel.grid(visible=False)


def _draw_times(panel: Axes, drives: Sequence[RoverDrive]) -> None:
    for layout in sorted({d.layout for d in drives}):
        here = {d.strategy: d.measured_s for d in drives if d.layout == layout}
        panel.plot([here[s.name] for s in STRATEGIES], color=GREY, lw=0.8, marker=".", zorder=1)
    for k, (strategy, colour) in enumerate(zip(STRATEGIES, COLOURS, strict=True)):
        mine = [d for d in drives if d.strategy == strategy.name]
        predicted_s, measured_s = np.mean([(d.predicted_s, d.measured_s) for d in mine], axis=0)
        panel.plot(k - 0.1, predicted_s, "D", color=colour, mfc="white", ms=8, mew=1.6)
        panel.plot(k + 0.1, measured_s, "D", color=colour, ms=8)
        panel.annotate(
            f"{measured_s:.0f} s", (k + 0.1, measured_s), (7, 0), textcoords="offset points",
            va="center", fontsize=8.5, color=colour,
        )  # fmt: skip
    panel.set_xticks(range(len(STRATEGIES)), [s.name.replace(" + ", " +\n") for s in STRATEGIES])
    panel.set_ylim(0, 1.08 * max(d.measured_s for d in drives))
    panel.set_xlim(-0.4, len(STRATEGIES) - 0.4)
    tidy(panel, "", "travel time, s", "mean of the model (hollow) and of the rover")
