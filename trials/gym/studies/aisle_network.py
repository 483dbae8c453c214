"""The aisles of a warehouse as a network, and what may close them: doors, and loads in the way."""

from dataclasses import dataclass

import numpy as np

from scenes.objects.storage import BAY_M, RACK_DEPTH_M
from scenes.warehouse import Options as WarehouseOptions
from trials.gym.world.barriers import Gate, Slot
from trials.gym.world.crossings import slot_at
from trials.gym.world.obstacle_bodies import DOOR_M, LOAD_M
from trials.gym.world.scene_instance import Site
from trials.routing.drive import Delays
from trials.routing.network import Network, Road
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.settings import validated

BESIDE_M = 1.0
"""From the racks to the ways that join the aisles at their ends."""


@dataclass(frozen=True)
class Aisles:
    """A warehouse to route through: every aisle has a node at each end, and a door in the middle.

    Attributes:
        network: Ends, doors and the ways between them.
        lefts: Nodes of the left ends, by aisle.
        rights: Nodes of the right ends.
        doors: Slot of the door at a node.
        halves: Slot of a load that congests a road, for the roads on which there is room for it;
            the same for both ways.
    """

    network: Network
    lefts: tuple[int, ...]
    rights: tuple[int, ...]
    doors: dict[int, Slot]
    halves: dict[Road, Slot]


def survey_aisles(site: Site, speed_mps: float) -> Aisles:
    """Lay the network of a warehouse; ways without room for the rover are left out.

    Args:
        site: A layout of it.
        speed_mps: Of the rover, at most.

    Raises:
        SettingsError: If it is no warehouse.
    """
    if site.scene.name != "warehouse":
        raise SettingsError(f"scene {site.scene.name}: has no aisles; valid: warehouse")
    built = validated(WarehouseOptions, dict(site.settings.scene))
    pitch_m, length_m = built.aisle_m + RACK_DEPTH_M, built.bays * BAY_M
    aisles_y = (np.arange(built.aisles) - (built.aisles - 1) / 2) * pitch_m
    end_x = length_m / 2 + BESIDE_M
    names = [f"{side}{k + 1}" for k in range(built.aisles) for side in ("left ", "door ", "right ")]
    xy_m = np.array([(x, y) for y in aisles_y for x in (-end_x, 0.0, end_x)])
    lanes = [(k, k + 1) for k in range(len(names)) if k % 3 < 2]
    joins = [(k, k + 3) for k in range(len(names) - 3) if k % 3 != 1]
    lengths_m: dict[Road, float] = {}
    halves: dict[Road, Slot] = {}
    for a, b in lanes + joins:
        if site.passages.sees(xy_m[a], xy_m[b]):
            apart_m = float(np.linalg.norm(xy_m[a] - xy_m[b]))
            lengths_m |= {(a, b): apart_m, (b, a): apart_m}
            slot = _slot(site, (xy_m[a] + xy_m[b]) / 2, LOAD_M[0]) if (a, b) in lanes else None
            halves |= {} if slot is None else {(a, b): slot, (b, a): slot}
    middles = [k for k in range(len(names)) if k % 3 == 1]
    slots = {k: _slot(site, xy_m[k], DOOR_M[0]) for k in middles}
    doors = {k: slot for k, slot in slots.items() if slot is not None}
    network = Network(tuple(names), xy_m, lengths_m, speed_mps)
    lefts, rights = (tuple(range(k, len(names), 3)) for k in (0, 2))
    return Aisles(network, lefts, rights, doors, halves)


def make_gates(aisles: Aisles, delays: Delays, start_s: float) -> dict[Road, Gate]:
    """What closes the aisles as a drive's delays say: by road, that of a door's node to itself.

    Args:
        aisles: Where.
        delays: Waits at doors and queues on roads, from departure on.
        start_s: Time of departure.
    """
    gates: dict[Road, Gate] = {}
    for node, slot in aisles.doors.items():
        wait_s = float(delays.waits_s[node])
        if wait_s > 0:
            gates[node, node] = Gate(slot, -np.inf, wait_s, delays.lead_s)
    for (a, b), (since_s, queue_s) in delays.queues.items():
        if a < b:
            gates[a, b] = gates[b, a] = Gate(
                aisles.halves[a, b], start_s + since_s, queue_s, np.inf
            )
    return gates


def gate_name(road: Road) -> str:
    """Of a gate in the world: `door_3`, `load_3_4`."""
    return f"door_{road[0]}" if road[0] == road[1] else f"load_{road[0]}_{road[1]}"


def _slot(site: Site, point: Array, depth_m: float) -> Slot | None:
    return slot_at(site.scene, site.passages.free, point, depth_m)
