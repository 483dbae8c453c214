"""Dynamic worlds: loads that block aisles, doors that open and close, carts that cross the path.

They are placed along the path of a trial, each kind from its own random stream, in a scene that
was mapped without them. Loads are set down for good, so a slot is used only if a path remains that
is not much longer; doors open again by themselves.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from scenes.geometry.mesh import Mesh, box, merged
from scenes.scene import Scene
from scenes.stage import Stage
from scenes.surfaces import prints, signs, timber
from scenes.surfaces.atlas import pack
from sim.world.world import START_S
from trials.gym.world.barrier_slots import (
    free_distance_m,
    sample_path,
    slots_along,
    with_slots_closed,
)
from trials.gym.world.dynamic_agents import Barrier, Cart, Door, DynamicAgent, Load, Slot
from trials.gym.world.free_space import path_length_m
from trials.gym.world.start_goal_sampling import StartGoal
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError

DEFAULT_COUNTS: Mapping[str, int] = {"blocked_aisles": 1, "doors": 1, "traffic": 2}
"""Number of agents of each kind that is named without a number."""
MAX_COUNT = 10
DETOUR_FACTOR, DETOUR_M = 2.5, 4.0
"""A remaining path may be this factor times as long, plus this length."""
CART_CLEARANCE_M, CART_REACH_M, CART_END_M = 0.42, 4.0, 1.1
"""Clearance around the middle of a cart, its longest way to either side, and distance of both ends
from the path: a cart that waits there leaves the rover room to pass."""
CART_FROM_START_M, CART_FROM_GOAL_M = 1.3, 0.9
MIN_SLOT_DISTANCE_M = 1.8
"""Distance between the centres of two barriers: the rover has room between them."""
PREFIX = "dynamics/"
LOAD_M, DOOR_M = (0.8, 0.9), (0.1, 1.0)
"""Depth along the passage and height of a load and of a door, metres."""
CART_M = (0.6, 0.5, 0.7)
"""Length, width and height, metres."""
FACES = 6
"""Number of different sides of cartons."""


def parse_dynamics(text: str) -> dict[str, int]:
    """Parse `blocked_aisles=2,doors` to kinds and numbers, from 0 to MAX_COUNT.

    Raises a SettingsError if a kind is unknown, or a number is another.
    """
    counts: dict[str, int] = {}
    for word in filter(None, (w.strip() for w in text.split(","))):
        name, equals, number = word.partition("=")
        if name not in DEFAULT_COUNTS:
            raise SettingsError(f"unknown dynamics {name}; valid: {', '.join(DEFAULT_COUNTS)}")
        if equals and not (number.isdecimal() and int(number) <= MAX_COUNT):
            raise SettingsError(f"dynamics {name}: {number} is not a number from 0 to {MAX_COUNT}")
        counts[name] = int(number) if equals else DEFAULT_COUNTS[name]
    return counts


def sample_dynamics(
    scene: Scene, ends: StartGoal, speed_mps: float, text: str, seed: int
) -> dict[str, DynamicAgent]:
    """Sample the agents of a trial by name; fewer than `text` asks for where there is no place.

    The scene has no dynamic agents; `speed_mps` is the highest speed of the rover.
    """
    parsed = parse_dynamics(text)
    counts = [parsed.get(kind, 0) for kind in DEFAULT_COUNTS]
    rngs = [np.random.default_rng([seed, k]) for k in range(len(counts))]
    loads = _sample_loads(scene, ends, speed_mps, counts[0], rngs[0])
    slots = [load.slot for load in loads]
    doors = _sample_doors(scene, ends, slots, counts[1], rngs[1])
    slots += [door.slot for door in doors]
    carts = _sample_carts(scene, ends, slots, counts[2], rngs[2])
    kinds = zip(DEFAULT_COUNTS, (loads, doors, carts), strict=True)
    return {f"{kind}_{i}": agent for kind, agents in kinds for i, agent in enumerate(agents)}


def _sample_loads(
    scene: Scene, ends: StartGoal, speed_mps: float, count: int, rng: np.random.Generator
) -> list[Load]:
    """Loads on the path; each next one on the path that remains."""
    path, traversable = ends.path, ends.field.traversable
    max_m = DETOUR_FACTOR * path_length_m(path) + DETOUR_M
    loads: list[Load] = []
    for _ in range(count):
        slots = [load.slot for load in loads]
        candidates = slots_along(scene, traversable.space, path, LOAD_M[0])
        for k in rng.permutation(len(candidates)).tolist():
            if not _is_apart(candidates[k], slots):
                continue
            remaining = with_slots_closed(traversable, [*slots, candidates[k]])
            detour = remaining.shortest_path(ends.start[:2], ends.field.goal)
            if detour is not None and path_length_m(detour) <= max_m:
                latest_s = START_S + path_length_m(path) / speed_mps
                at_s, near_m = rng.uniform(START_S + 2, latest_s), rng.uniform(1.2, 3.5)
                loads.append(Load(candidates[k], float(at_s), float(near_m)))
                path = detour
                break
    return loads


def _sample_doors(
    scene: Scene, ends: StartGoal, taken: list[Slot], count: int, rng: np.random.Generator
) -> list[Door]:
    doors: list[Door] = []
    candidates = slots_along(scene, ends.field.traversable.space, ends.path, DOOR_M[0])
    for k in rng.permutation(len(candidates)).tolist():
        if len(doors) < count and _is_apart(candidates[k], [*taken, *(x.slot for x in doors)]):
            period_s, fraction, phase = rng.uniform((16, 0.4, 0), (32, 0.6, 1)).tolist()
            doors.append(Door(candidates[k], period_s, fraction, phase))
    return doors


def _sample_carts(
    scene: Scene, ends: StartGoal, taken: list[Slot], count: int, rng: np.random.Generator
) -> list[Cart]:
    """Carts that cross the path where there is room for them on both sides of it."""
    space = with_slots_closed(ends.field.traversable, taken).space
    places = sample_path(ends.path, CART_FROM_START_M, CART_FROM_GOAL_M)
    path = sample_path(ends.path, 0.0, 0.0)
    carts: list[Cart] = []
    for k in rng.permutation(len(places)).tolist():
        angle, speed, phase = rng.uniform((0, 0.15, 0), (np.pi, 0.4, 1)).tolist()
        if len(carts) == count:
            break
        along = np.array([np.cos(angle), np.sin(angle)])
        lane_ends = np.array([
            places[k] + side * along
            * free_distance_m(space, places[k], side * along, CART_REACH_M, CART_CLEARANCE_M)
            for side in (-1, 1)
        ])  # fmt: skip
        end_m = np.linalg.norm(lane_ends[:, None] - path, axis=2).min(axis=1)
        lane = lane_ends[0] + np.linspace(0, 1, 50)[:, None] * (lane_ends[1] - lane_ends[0])
        from_start_m = np.linalg.norm(lane - ends.start[:2], axis=1).min()
        from_goal_m = np.linalg.norm(lane - ends.field.goal, axis=1).min()
        clear = from_start_m > CART_FROM_START_M and from_goal_m > CART_FROM_GOAL_M
        if clear and end_m.min() > CART_END_M:
            height_m = float(scene.elevation(places[k]))
            carts.append(Cart(lane_ends, height_m, float(speed), float(phase)))
    return carts


def _is_apart(slot: Slot, others: list[Slot]) -> bool:
    return all(np.linalg.norm(slot.centre - x.centre) > MIN_SLOT_DISTANCE_M for x in others)


def with_agents(scene: Scene, agents: Mapping[str, DynamicAgent], seed: int) -> Scene:
    """Add dynamic agents by name to a copy of a scene; the seed decides their textures."""
    if not agents:
        return scene
    stage, rng = Stage("dynamics"), np.random.default_rng(seed)
    faces = pack(prints.cartons(rng, FACES, 256))
    stage.material("hoisted_cartons", faces.image)
    stage.material("lifting_door", signs.shutter(rng, (512, 512), (150, 120, 70)))
    stage.material("cart_frame", timber.painted(rng, (128, 256), (54, 92, 140)))
    for name, agent in agents.items():
        with stage.mover(name, agent):
            if isinstance(agent, Cart):
                size = CART_M
                stage.draw("cart_frame", box((0, 0, 0.1), (*CART_M[:2], 0.2), (0.5, 0.5)))
                load = box((0, 0, 0.45), (0.54, 0.44, 0.5), bottom=True)
                stage.draw("hoisted_cartons", load.textured(faces.rects[rng.integers(FACES)]))
            else:
                assert isinstance(agent, Barrier)
                depth_m, width_m = 2 * agent.slot.half
                height_m = LOAD_M[1] if isinstance(agent, Load) else DOOR_M[1]
                size = (float(depth_m), float(width_m), height_m)
                if isinstance(agent, Load):
                    stage.draw("hoisted_cartons", _stack(size, faces.rects, rng))
                else:
                    leaf = box((0, 0, size[2] / 2), size, (1.0, 1.0), rng.random(2), bottom=True)
                    stage.draw("lifting_door", leaf)
            stage.obstacle(f"{name}/hull", (0, 0, size[2] / 2), size)
    stage.finish(None, None)
    spec = scene.spec.copy()
    spec.attach(stage.spec, prefix=PREFIX, frame=spec.worldbody.add_frame())
    things = {PREFIX + name: thing for name, thing in stage.things.items()}
    named = {PREFIX + name: agent for name, agent in agents.items()}
    return replace(
        scene, spec=spec, things={**scene.things, **things}, movers={**scene.movers, **named}
    )


def _stack(size: tuple[float, float, float], rects: Array, rng: np.random.Generator) -> Mesh:
    """Cartons side by side, two high, that fill a box of full size (3,) on z = 0."""
    depth_m, width_m, height_m = size
    count = max(1, round(width_m / 0.6))
    part = np.array([depth_m, width_m / count, height_m / 2])
    return merged(
        [
            box((0, (k + 0.5) * part[1] - width_m / 2, (z + 0.5) * part[2]), part, bottom=True)
            .textured(rects[rng.integers(len(rects))])
            for k in range(count)
            for z in (0, 1)
        ]
    )  # fmt: skip
