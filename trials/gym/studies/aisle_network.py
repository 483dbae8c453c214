"""The aisles of a warehouse as a road network, with the doors and loads that may close them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scenes.objects.storage import BAY_M, RACK_DEPTH_M
from scenes.warehouse import Options as WarehouseOptions
from trials.gym.world.barrier_slots import slot_at
from trials.gym.world.dynamic_agents import Gate, Slot
from trials.gym.world.dynamics import DOOR_M, LOAD_M
from trials.gym.world.scene_instance import SceneInstance
from trials.routing.drive import Delays
from trials.routing.network import Network, Road
from vo.contract.errors import SettingsError
from vo.contract.settings import validated

END_M = 1.0
"""Distance from the racks to the roads that join the aisles at their ends."""


@dataclass(frozen=True)
class AisleNetwork:
    """A warehouse to route through: every aisle has a node at each end, and a door in the middle.

    `lefts` and `rights` are the end nodes by aisle, `doors` the slots of doors by node, and
    `loads` those of loads that congest a road, where there is room, in either direction.
    """

    network: Network
    lefts: tuple[int, ...]
    rights: tuple[int, ...]
    doors: Mapping[int, Slot]
    loads: Mapping[Road, Slot]


def build_aisle_network(instance: SceneInstance, speed_mps: float) -> AisleNetwork:
    """Build the network of a warehouse without the roads that the rover has no room on.

    Raises a SettingsError if the scene is another.
    """
    scene, traversable = instance.scene, instance.traversable
    if scene.name != "warehouse":
        raise SettingsError(f"scene {scene.name}: has no aisles; valid: warehouse")
    built = validated(WarehouseOptions, dict(instance.settings.scene))
    pitch_m, length_m = built.aisle_m + RACK_DEPTH_M, built.bays * BAY_M
    aisles_y = (np.arange(built.aisles) - (built.aisles - 1) / 2) * pitch_m
    end_x = length_m / 2 + END_M
    names = [f"{side}{k + 1}" for k in range(built.aisles) for side in ("left ", "door ", "right ")]
    xy_m = np.array([(x, y) for y in aisles_y for x in (-end_x, 0.0, end_x)])
    lanes = [(k, k + 1) for k in range(len(names)) if k % 3 < 2]
    joins = [(k, k + 3) for k in range(len(names) - 3) if k % 3 != 1]
    lengths_m: dict[Road, float] = {}
    loads: dict[Road, Slot] = {}
    for a, b in lanes + joins:
        if traversable.has_line(xy_m[a], xy_m[b]):
            distance_m = float(np.linalg.norm(xy_m[a] - xy_m[b]))
            lengths_m |= {(a, b): distance_m, (b, a): distance_m}
            middle = (xy_m[a] + xy_m[b]) / 2
            slot = slot_at(scene, traversable.space, middle, LOAD_M[0]) if (a, b) in lanes else None
            loads |= {} if slot is None else {(a, b): slot, (b, a): slot}
    middles = [k for k in range(len(names)) if k % 3 == 1]
    slots = {k: slot_at(scene, traversable.space, xy_m[k], DOOR_M[0]) for k in middles}
    doors = {k: slot for k, slot in slots.items() if slot is not None}
    network = Network(tuple(names), xy_m, lengths_m, speed_mps)
    lefts, rights = (tuple(range(k, len(names), 3)) for k in (0, 2))
    return AisleNetwork(network, lefts, rights, doors, loads)


def make_gates(aisles: AisleNetwork, delays: Delays, start_s: float) -> dict[Road, Gate]:
    """Make the gates of a drive by road; the road of a door leads from its node to itself.

    The delays count from the time of departure, `start_s`.
    """
    gates: dict[Road, Gate] = {}
    for node, slot in aisles.doors.items():
        wait_s = float(delays.waits_s[node])
        if wait_s > 0:
            gates[node, node] = Gate(slot, -np.inf, wait_s, delays.lead_s)
    for (a, b), (onset_s, queue_s) in delays.queues.items():
        if a < b:
            gate = Gate(aisles.loads[a, b], start_s + onset_s, queue_s, np.inf)
            gates[a, b] = gates[b, a] = gate
    return gates
