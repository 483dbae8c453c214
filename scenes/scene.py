"""What a scene is: a world to drive through, before any physics runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco

from vo.contract.arrays import Array


@dataclass(frozen=True)
class Scene:
    """A buildable world with routes.

    Attributes:
        name: As in the registry.
        tests: One sentence: what the scene tests.
        spec: The world without a rover; units metres, z up, ground near z = 0.
        routes: Name to (N, 2) waypoints in world x, y metres; the rover drives them in order and
            stops at the last. The first is the start; `default` is always there.
        extent_m: (4,) x_min, y_min, x_max, y_max of the part worth showing on a map.
        tags: Free words, for example `outdoor`.
    """

    name: str
    tests: str
    spec: mujoco.MjSpec
    routes: Mapping[str, Array]
    extent_m: tuple[float, float, float, float]
    tags: frozenset[str] = field(default_factory=frozenset[str])
