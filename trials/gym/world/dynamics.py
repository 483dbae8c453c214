"""Dynamic worlds: aisles that get blocked, doors that open and close, carts that cross the way.

They are laid along the way of an errand, each kind from its own stream, in a scene that was
surveyed without them. Loads are set down for good, so a place is taken only if a way remains that
is not much longer; doors open again by themselves.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from scenes.scene import Scene
from sim.world.world import START_S
from trials.gym.world.barriers import Barrier, Door, Load, Slot
from trials.gym.world.carts import Cart
from trials.gym.world.crossings import (
    length_m,
    reach_m,
    slots_along,
    stations,
    way_between,
    with_closed,
)
from trials.gym.world.distance_field import Passages
from trials.gym.world.dynamic_agents import Reacting
from trials.gym.world.obstacle_bodies import DOOR_M, LOAD_M
from trials.gym.world.start_goal_sampling import Errand
from vo.contract.errors import SettingsError

PREFIX = "dynamics/"
DEFAULTS: Mapping[str, int] = {"blocked_aisles": 1, "doors": 1, "traffic": 2}
"""Kinds, and how many there are of each unless a number is given."""
MOST = 10
DETOUR, DETOUR_M = 2.5, 4.0
"""A way that remains may be so many times as long, and so much more."""
CART_ROOM_M, CART_REACH_M, CART_ASIDE_M = 0.42, 4.0, 1.1
"""Room about its middle, longest way to either side, and how far off the way both ends are: a cart
that waits there for the rover leaves it room to pass."""
CLEAR_OF_START_M, CLEAR_OF_GOAL_M = 1.3, 0.9


def parse_dynamics(text: str) -> dict[str, int]:
    """Read `blocked_aisles=2,doors` as kinds and numbers.

    Raises:
        SettingsError: If a kind is unknown, or a number is none from 0 to MOST.
    """
    wanted: dict[str, int] = {}
    for word in filter(None, (w.strip() for w in text.split(","))):
        name, equals, number = word.partition("=")
        if name not in DEFAULTS:
            raise SettingsError(f"unknown dynamics {name}; valid: {', '.join(DEFAULTS)}")
        if equals and not (number.isdecimal() and int(number) <= MOST):
            raise SettingsError(f"dynamics {name}: {number} is no number from 0 to {MOST}")
        wanted[name] = int(number) if equals else DEFAULTS[name]
    return wanted


@dataclass(frozen=True)
class _Plot:
    """What places are drawn from.

    Attributes:
        scene: Without anything that reacts.
        passages: Of it.
        errand: Where the rover goes.
        speed_mps: At most.
    """

    scene: Scene
    passages: Passages
    errand: Errand
    speed_mps: float


def draw_dynamics(
    scene: Scene, passages: Passages, errand: Errand, speed_mps: float, text: str, seed: int
) -> dict[str, Reacting]:
    """Choose what moves in a trial, by name; fewer than asked for where there is no place.

    Args:
        scene: Without it.
        passages: Of that scene.
        errand: Where the rover goes.
        speed_mps: Of the rover, at most.
        text: As `parse_dynamics` reads it.
        seed: Of everything drawn.
    """
    plot = _Plot(scene, passages, errand, speed_mps)
    chosen: dict[str, Reacting] = {}
    for k, (kind, draw) in enumerate(KINDS.items()):
        rng = np.random.default_rng([seed, k])
        taken = [m.slot for m in chosen.values() if isinstance(m, Barrier)]
        drawn = draw(plot, taken, parse_dynamics(text).get(kind, 0), rng)
        chosen |= {f"{kind}_{i}": mover for i, mover in enumerate(drawn)}
    return chosen


def _draw_loads(
    plot: _Plot, taken: list[Slot], count: int, rng: np.random.Generator
) -> list[Reacting]:
    """Loads on the way; the next ones on the way that remains."""
    start, goal = plot.errand.start[:2], plot.errand.goal
    way = plot.errand.waypoints
    most_m = DETOUR * length_m(way) + DETOUR_M
    loads: list[Reacting] = []
    slots: list[Slot] = []
    for _ in range(count):
        candidates = slots_along(plot.scene, plot.passages.free, way, LOAD_M[0])
        for k in rng.permutation(len(candidates)).tolist():
            if not _apart(candidates[k], slots):
                continue
            around = way_between(with_closed(plot.passages, [*slots, candidates[k]]), start, goal)
            if around is not None and length_m(around) <= most_m:
                slots.append(candidates[k])
                latest_s = START_S + length_m(way) / plot.speed_mps
                at_s, near_m = rng.uniform(START_S + 2, latest_s), rng.uniform(1.2, 3.5)
                loads.append(Load(candidates[k], float(at_s), float(near_m)))
                way = around
                break
    return loads


def _draw_doors(
    plot: _Plot, taken: list[Slot], count: int, rng: np.random.Generator
) -> list[Reacting]:
    doors: list[Reacting] = []
    slots = list(taken)
    way = plot.errand.waypoints
    candidates = slots_along(plot.scene, plot.passages.free, way, DOOR_M[0])
    for k in rng.permutation(len(candidates)).tolist():
        if len(doors) < count and _apart(candidates[k], slots):
            slots.append(candidates[k])
            period_s, share, phase = rng.uniform((16, 0.4, 0), (32, 0.6, 1)).tolist()
            doors.append(Door(candidates[k], period_s, share, phase))
    return doors


def _draw_carts(
    plot: _Plot, taken: list[Slot], count: int, rng: np.random.Generator
) -> list[Reacting]:
    """Carts that cross the way, where there is room for them on both sides of it."""
    free = with_closed(plot.passages, taken).free
    places = stations(plot.errand.waypoints, CLEAR_OF_START_M, CLEAR_OF_GOAL_M)
    line = stations(plot.errand.waypoints, 0.0, 0.0)
    carts: list[Reacting] = []
    for k in rng.permutation(len(places)).tolist():
        angle, speed, phase = rng.uniform((0, 0.15, 0), (np.pi, 0.4, 1)).tolist()
        if len(carts) == count:
            break
        along = np.array([np.cos(angle), np.sin(angle)])
        ends = np.array(
            [
                places[k]
                + side * along * reach_m(free, places[k], side * along, CART_REACH_M, CART_ROOM_M)
                for side in (-1, 1)
            ]
        )
        aside_m = np.linalg.norm(ends[:, None] - line, axis=2).min(axis=1)
        lane = ends[0] + np.linspace(0, 1, 50)[:, None] * (ends[1] - ends[0])
        from_start_m = np.linalg.norm(lane - plot.errand.start[:2], axis=1).min()
        from_goal_m = np.linalg.norm(lane - plot.errand.goal, axis=1).min()
        clear = from_start_m > CLEAR_OF_START_M and from_goal_m > CLEAR_OF_GOAL_M
        if clear and aside_m.min() > CART_ASIDE_M:
            height_m = float(plot.scene.elevation(places[k]))
            carts.append(Cart(ends, height_m, float(speed), float(phase)))
    return carts


def _apart(slot: Slot, others: list[Slot]) -> bool:
    """Whether the rover has room to stand between two barriers."""
    return all(np.linalg.norm(slot.centre - other.centre) > 1.8 for other in others)


KINDS: Mapping[
    str, Callable[[_Plot, list[Slot], int, np.random.Generator], list[Reacting]]
] = {"blocked_aisles": _draw_loads, "doors": _draw_doors, "traffic": _draw_carts}  # fmt: skip
