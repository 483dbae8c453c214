"""What a scene is: a world to drive through, before any physics runs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

import mujoco
import numpy as np

from vo.contract.arrays import Array

COLLISION_GROUP = 3
"""Geom group of what only collides."""
LABEL_GROUP = 4
"""Geom group of what only labels show: one mesh for each object, equal to what is painted."""
IMAGE_GROUP = 5
"""Geom group of what only pictures show: one mesh for each material and part of the world."""


class Kind(IntEnum):
    """Class of a thing; the value is the pixel in a class label."""

    SKY = 0
    GROUND = 1
    STATIC = 2
    MOVING = 3


Motion = Callable[[float], Array]
"""Time in seconds to the (4, 4) pose T_world_body of something that moves by itself."""


@dataclass(frozen=True)
class Thing:
    """One object of the world, as segmentation knows it.

    Attributes:
        name: Unique in its scene.
        kind: Its class.
    """

    name: str
    kind: Kind


def steady(time_s: Array) -> Array:
    """Shine with nominal strength at any (...) times."""
    return np.ones(np.shape(time_s))


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
        things: Name of a drawn geom to what it shows; a geom that is missing here is an object
            of its own: ground if it is a plane, moving if its body can move, else static.
        movers: Name of a mocap body to its motion; the rover feels it and does not push it.
        brightness: Illuminance at (...) times in seconds, 1 where the pictures are as painted.
        elevation: Height in metres of the drivable ground at (..., 2) x, y.
        source: How to ask for it again, where that is not its name: a file or `module:function`.
    """

    name: str
    tests: str
    spec: mujoco.MjSpec
    routes: Mapping[str, Array]
    extent_m: tuple[float, float, float, float]
    tags: frozenset[str] = field(default_factory=frozenset[str])
    things: Mapping[str, Thing] = field(default_factory=dict[str, Thing])
    movers: Mapping[str, Motion] = field(default_factory=dict[str, Motion])
    brightness: Callable[[Array], Array] = steady
    elevation: Callable[[Array], Array] = lambda xy: np.zeros(np.shape(xy)[:-1])
    source: str = ""
