"""Drawing in the frame of a piece."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from scenes.geometry.mesh import Mesh
from scenes.geometry.place import Place
from scenes.surfaces.atlas import Atlas


@dataclass(frozen=True)
class Pen:
    """Draws meshes, given in a piece's own frame, at the place of the piece.

    Attributes:
        draw: Shows a mesh in the world in a material.
        atlases: Atlases by material.
        place: Where the piece stands.
    """

    draw: Callable[[str, Mesh], None]
    atlases: Mapping[str, Atlas]
    place: Place

    def __call__(self, material: str, mesh: Mesh) -> None:
        """Draw a mesh."""
        x, y, yaw = self.place
        self.draw(material, mesh.moved((x, y, 0.0), yaw))

    def cell(self, material: str, rng: np.random.Generator, mesh: Mesh) -> None:
        """Draw a mesh that shows a random cell of the material's atlas."""
        self(material, mesh.textured(self.atlases[material].pick(rng)))
