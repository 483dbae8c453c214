"""A Manhattan grid with signals: its roads, the turns between them, and its description for SUMO.

Intersections are A1, A2, ... by column and row, from the south-west; roads enter the city at west1,
north1 and so on. A road has two lanes: the inner one turns left, the outer one leads straight on or
to the right.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path

import numpy as np

from trials.navigation.adjacency import Adjacency, adjacency
from trials.routing.phases import LEFT, SIDES, STRAIGHT, movement_of
from trials.routing.sumo import convert_network
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError

BLOCK_M, SPEED_MPS = 200.0, 50 / 3.6
LANES = 2
DETECTOR_M, SAMPLE_S = 10.0, 5
"""Distance of detectors from the begin of a road and from its stop line, and their period."""
STEPS: Mapping[str, tuple[int, int]] = {
    "north": (0, 1), "east": (1, 0), "south": (0, -1), "west": (-1, 0),
}  # fmt: skip


@dataclass(frozen=True)
class City:
    """A grid of side x side intersections.

    Attributes:
        side: Intersections in a row.
        closed: Roads that do not exist, as A1-A2; each stands for one direction.
    """

    side: int
    closed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the names of the closed roads."""
        unknown = [x for x in self.closed if x not in self._all_roads]
        if unknown:
            raise SettingsError(f"no road {unknown[0]}; roads are named as A1-A2 or west1-A1")

    @cached_property
    def nodes(self) -> dict[str, tuple[int, int]]:
        """Position of each intersection and entry, in blocks."""
        places = range(1, self.side + 1)
        inner = {f"{chr(64 + x)}{y}": (x, y) for x in places for y in places}
        far = self.side + 1
        for k in places:
            inner |= {f"west{k}": (0, k), f"east{k}": (far, k)}
            inner |= {f"south{k}": (k, 0), f"north{k}": (k, far)}
        return inner

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """Names of the intersections."""
        return tuple(x for x in self.nodes if x not in self.entries)

    @cached_property
    def entries(self) -> tuple[str, ...]:
        """Names of the places where roads enter and leave the city."""
        return tuple(x for x in self.nodes if x.startswith(SIDES))

    @cached_property
    def _all_roads(self) -> dict[str, tuple[str, str]]:
        names = {place: name for name, place in self.nodes.items()}
        roads: dict[str, tuple[str, str]] = {}
        for name, (x, y) in self.nodes.items():
            for dx, dy in STEPS.values():
                other = names.get((x + dx, y + dy))
                if other and not (name in self.entries and other in self.entries):
                    roads[f"{name}-{other}"] = name, other
        return roads

    @cached_property
    def roads(self) -> dict[str, tuple[str, str]]:
        """Nodes that each road leaves and enters."""
        return {x: ends for x, ends in self._all_roads.items() if x not in self.closed}

    @cached_property
    def index(self) -> dict[str, int]:
        """Number of each road, in the order of `roads`."""
        return {road: k for k, road in enumerate(self.roads)}

    def heading(self, road: str) -> str:
        """Side of the city to which a road leads."""
        (x, y), (to_x, to_y) = (self.nodes[x] for x in self.roads[road])
        return next(side for side, step in STEPS.items() if step == (to_x - x, to_y - y))

    def origin(self, road: str) -> str:
        """Side of its intersection from which a road comes."""
        return SIDES[(SIDES.index(self.heading(road)) + 2) % 4]

    @cached_property
    def turns(self) -> dict[tuple[str, str], int]:
        """By two roads that follow each other, the movement; vehicles do not turn round."""
        leaving: dict[str, list[str]] = {}
        for road, (a, _) in self.roads.items():
            leaving.setdefault(a, []).append(road)
        return {
            (road, other): movement_of(self.origin(road), self.heading(other))
            for road, (_, b) in self.roads.items()
            for other in leaving.get(b, ())
            if self.heading(other) != self.origin(road)
        }

    def movements(self, road: str) -> tuple[int, ...]:
        """Return the movements from a road: to the left, and straight on or to the right."""
        return LEFT[self.origin(road)], STRAIGHT[self.origin(road)]

    def ends(self, start: str, goal: str) -> tuple[str, str]:
        """Return the road in from one entry and the road out to another; SettingsError if none."""
        for name in (start, goal):
            if name not in self.entries:
                raise SettingsError(f"no entry {name}; entries are {', '.join(self.entries)}")
        first = [road for road, (a, _) in self.roads.items() if a == start]
        last = [road for road, (_, b) in self.roads.items() if b == goal]
        if start == goal or not first or not last:
            raise SettingsError(f"no path from {start} to {goal}")
        return first[0], last[0]

    def graph(self, times_s: Array) -> Adjacency:
        """Build the graph of the turns: a road follows a road, at the travel time of the first.

        Args:
            times_s: (turns,) travel times, at least those at top speed.
        """
        begins = np.array([self.nodes[a] for a, _ in self.roads.values()], dtype=float)
        bounds_s = np.abs(begins[:, None] - begins[None]).sum(axis=2) * BLOCK_M / SPEED_MPS
        arcs = [(self.index[a], self.index[b]) for a, b in self.turns]
        return adjacency(arcs, times_s, bounds_s)

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Write network and detectors for SUMO; return their files."""
        nodes = [
            f'<node id="{name}" x="{x * BLOCK_M}" y="{y * BLOCK_M}" '
            f'type="{"traffic_light" if name in self.signals else "priority"}"/>'
            for name, (x, y) in self.nodes.items()
        ]
        edges = [
            f'<edge id="{road}" from="{a}" to="{b}" numLanes="{LANES}" speed="{SPEED_MPS}"/>'
            for road, (a, b) in self.roads.items()
        ]
        connections = [
            f'<connection from="{a}" to="{b}" fromLane="{lane_of(x)}" toLane="{lane_of(x)}"/>'
            for (a, b), x in self.turns.items()
        ]
        convert_network(
            _write(folder / "nodes.xml", "nodes", nodes),
            _write(folder / "edges.xml", "edges", edges),
            _write(folder / "turns.xml", "connections", connections),
            folder / "city.net.xml",
        )
        detectors = chain.from_iterable(map(_detectors, self.roads))
        return folder / "city.net.xml", _write(folder / "det.xml", "additional", [*detectors])


def lane_of(movement: int) -> int:
    """Lane of a movement: the inner one to the left, otherwise the outer one."""
    return movement % 2


def detectors_of(road: str) -> tuple[list[str], list[str]]:
    """Names of the detectors at the begin of a road, and at its stop line."""
    begin, end = ([f"{road}_{lane}_{x}" for lane in range(LANES)] for x in ("begin", "end"))
    return begin, end


def _detectors(road: str) -> list[str]:
    return [
        f'<inductionLoop id="{name}" lane="{road}_{lane}" pos="{position_m}" '
        f'period="{SAMPLE_S}" file="NUL"/>'
        for names, position_m in zip(detectors_of(road), (DETECTOR_M, -DETECTOR_M), strict=True)
        for lane, name in enumerate(names)
    ]


def _write(file: Path, root: str, lines: Sequence[str]) -> Path:
    file.write_text("\n".join([f"<{root}>", *lines, f"</{root}>"]), "utf-8")
    return file
