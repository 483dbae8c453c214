"""Networks from JSON files; see docs/routing.md."""

import json
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from trials.navigation import PlanningError
from trials.routing.network import Network, Road
from vo.contract.errors import DriftyardError
from vo.contract.settings import Settings, validated

KMH = 1 / 3.6
ROUNDING = 1 - 1e-6
"""Smallest ratio of a given length to the straight distance."""


class MapNode(Settings):
    """A node of the network."""

    name: Annotated[str, Field(min_length=1)]
    x_m: float
    y_m: float


class MapRoad(Settings):
    """A road between two nodes; without a length it is straight."""

    ends: tuple[str, str]
    length_m: Annotated[float, Field(gt=0)] | None = None
    one_way: bool = False


class MapFile(Settings):
    """Content of the file."""

    top_speed_kmh: Annotated[float, Field(gt=0)] = 120.0
    nodes: Annotated[list[MapNode], Field(min_length=2)]
    roads: Annotated[list[MapRoad], Field(min_length=1)]
    start: str | None = None
    goal: str | None = None


def read_map(path: Path) -> Network:
    """Read a network.

    Raises:
        PlanningError: If the file is unreadable or not valid; names the file and the key, node or
            road.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise PlanningError(f"{path}: cannot be read ({error.strerror})") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise PlanningError(f"{path}: not valid JSON ({error})") from None
    if not isinstance(content, dict):
        raise PlanningError(f"{path}: expected an object with the keys nodes and roads")
    try:
        return _network(validated(MapFile, content))
    except DriftyardError as error:
        raise PlanningError(f"{path}: {error}") from None


def _network(content: MapFile) -> Network:
    index = {node.name: k for k, node in enumerate(content.nodes)}
    if len(index) < len(content.nodes):
        names = [node.name for node in content.nodes]
        raise PlanningError(f"two nodes named {next(x for x in names if names.count(x) > 1)}")
    xy_m = np.array([(node.x_m, node.y_m) for node in content.nodes])
    lengths_m: dict[Road, float] = {}
    for road in content.roads:
        a, b = (_index(index, name) for name in road.ends)
        label, length_m = f"road {' to '.join(road.ends)}", road.length_m
        straight_m = float(np.linalg.norm(xy_m[a] - xy_m[b]))
        if straight_m == 0:
            raise PlanningError(f"{label}: its ends are at the same place")
        if length_m is not None and length_m < straight_m * ROUNDING:
            raise PlanningError(
                f"{label}: length_m {length_m:g} is less than the straight {straight_m:.1f}"
            )
        for ends in ((a, b),) if road.one_way else ((a, b), (b, a)):
            if ends in lengths_m:
                raise PlanningError(f"{label}: is listed twice")
            lengths_m[ends] = max(length_m or 0.0, straight_m)
    start, goal = (None if x is None else _index(index, x) for x in (content.start, content.goal))
    if start is not None and start == goal:
        raise PlanningError(f"start and goal are both {content.start}")
    return Network(tuple(index), xy_m, lengths_m, content.top_speed_kmh * KMH, start, goal)


def _index(index: dict[str, int], name: str) -> int:
    if name not in index:
        raise PlanningError(f"no node named {name}; valid: {', '.join(index)}")
    return index[name]
