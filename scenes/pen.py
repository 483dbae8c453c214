"""Pieces of a scene: objects that are drawn in a frame of their own, at a place."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Concatenate, ParamSpec

import numpy as np

from scenes.geometry.mesh import Mesh, Vector
from scenes.stage import Stage

P = ParamSpec("P")
Place = tuple[float, float, float]
"""x, y in metres and yaw in radians, of a piece whose front is towards -y before the turn."""


def local(place: Place, dx: float, dy: float, turn_rad: float = 0.0) -> Place:
    """Return the place of something at (dx, dy) in a piece's own frame, turned further."""
    x, y, yaw = place
    c, s = np.cos(yaw), np.sin(yaw)
    return (float(x + c * dx - s * dy), float(y + s * dx + c * dy), yaw + turn_rad)


@dataclass(frozen=True)
class Pen:
    """Draws a piece, given in its own frame, at its place on a stage.

    The name is that of the object; "" where the caller has named it.
    """

    stage: Stage
    place: Place
    name: str = ""

    def __call__(self, material: str, mesh: Mesh) -> None:
        """Draw a mesh."""
        x, y, yaw = self.place
        self.stage.draw(material, mesh.moved((x, y, 0.0), yaw))

    def cell(self, material: str, rng: np.random.Generator, mesh: Mesh) -> None:
        """Draw a mesh that shows a random cell of the material's atlas."""
        self(material, mesh.textured(self.stage.pick(material, rng)))

    def solid(self, size: Vector, offset: Vector = (0.0, 0.0), shadow: bool = True) -> None:
        """Add the obstacle of (3,) full size that stands at a (2,) offset from the place."""
        x, y, yaw = local(self.place, offset[0], offset[1])
        self.stage.obstacle(self.name, (x, y, size[2] / 2), size, yaw, shadow)

    def shade(
        self, height_m: float, size: Vector, opacity: float = 1.0, offset: Vector = (0.0, 0.0)
    ) -> None:
        """Let a box of (3,) full size cast shadow, its middle at a height above an offset."""
        x, y, yaw = local(self.place, offset[0], offset[1])
        self.stage.occluder((x, y, height_m), size, yaw, opacity)


def one_object(
    build: Callable[Concatenate[Stage, str, P], None],
) -> Callable[Concatenate[Stage, str, P], None]:
    """Make what a function `build(stage, name, ...)` draws the object `name` of segmentation."""

    @wraps(build)
    def inside(stage: Stage, name: str, *args: P.args, **kwargs: P.kwargs) -> None:
        with stage.object(name):
            build(stage, name, *args, **kwargs)

    return inside


def piece(
    build: Callable[Concatenate[Pen, P], None],
) -> Callable[Concatenate[Stage, str, Place, P], None]:
    """Make a function `build(put, ...)` one that draws the object `name` at a place on a stage."""

    @wraps(build)
    def inside(stage: Stage, name: str, place: Place, *args: P.args, **kwargs: P.kwargs) -> None:
        with stage.object(name):
            build(Pen(stage, place, name), *args, **kwargs)

    return inside
