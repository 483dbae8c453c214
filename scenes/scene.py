"""A scene: a world to drive through, its routes and its labelled objects."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

import mujoco
import numpy as np

from scenes.lighting.baked_light import Light
from scenes.lighting.lamps import Lamplight
from vo.contract.arrays import Array

HOME = "home"
"""Name of the keyframe of a world from which it starts."""
COLLISION_GROUP = 3
"""Group of the geoms that only collide."""
LABEL_GROUP = 4
"""Group of the geoms that only labels show: one mesh for each object, as in the images."""
IMAGE_GROUP = 5
"""Group of the geoms that only images show: one mesh for each material and part of the world."""


class Kind(IntEnum):
    """Class of an object; the value is the pixel of a class label."""

    SKY = 0
    GROUND = 1
    STATIC = 2
    MOVING = 3


Motion = Callable[[float], Array]
"""Time in seconds to the (4, 4) pose T_world_body of a body that moves by itself."""


@dataclass(frozen=True)
class Thing:
    """One object of the world in the segmentation labels; its name is unique in its scene."""

    name: str
    kind: Kind


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
        tags: Keywords, for example `outdoor`.
        things: Name of a drawn geom to the object it shows; a geom that is missing here is an
            object of its own: ground if it is a plane, moving if its body can move, else static.
        movers: Name of a mocap body to its motion; it collides with the rover and is not pushed.
        brightness: Illuminance at (...) times in seconds, relative to the nominal one.
        elevation: Height in metres of the drivable ground at (..., 2) x, y.
        source: Name that builds the scene again if it is not `name`: a file or `module:function`.
        assets: SHA-256 of each file that a custom scene is made from, by its path.
        light: The lamps that are baked into a built-in scene; none: the spec's lamps are all.
        lamps: Lamps inside a built-in scene, which replace the key lamp of `light`.
        defaults: Recording settings of a registered scene, `key.path` to value, where none are set;
            the registry sets them.
    """

    name: str
    tests: str
    spec: mujoco.MjSpec
    routes: Mapping[str, Array]
    extent_m: tuple[float, float, float, float]
    tags: frozenset[str] = field(default_factory=frozenset[str])
    things: Mapping[str, Thing] = field(default_factory=dict[str, Thing])
    movers: Mapping[str, Motion] = field(default_factory=dict[str, Motion])
    brightness: Callable[[Array], Array] = lambda time_s: np.ones(np.shape(time_s))
    elevation: Callable[[Array], Array] = lambda xy: np.zeros(np.shape(xy)[:-1])
    source: str = ""
    assets: Mapping[str, str] = field(default_factory=dict[str, str])
    light: Light | None = None
    lamps: Lamplight | None = None
    defaults: Mapping[str, float | str] = field(default_factory=dict[str, float | str])
