"""Falls: the rover drops below the ground that its driven wheels last stood on."""

import math

import mujoco
import numpy as np

from sim.world.drive import TIPPED_RAD
from sim.world.rover import BODY, WHEELS

FALL_M = 0.12
"""Drop of the axle from which the rover has fallen; a sill is lower."""
TIPPED_FALL_M = 0.04
"""The same of a rover that lies on its side: over level ground, the axle does not drop."""
STANDING = 0.5
"""Vertical part of the normal of a contact that carries; beyond an edge, wheels scrape its side."""


class FallMonitor:
    """Compares the height of the axle with that when both driven wheels last stood on something."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Begin with the rover as it is."""
        self._model = model
        self._body = model.body(BODY).id
        self._height_m = float(data.xpos[self._body, 2])

    def has_fallen(self, data: mujoco.MjData) -> bool:
        """Whether the rover has fallen by now; call it after every few physics steps."""
        height_m, upright = float(data.xpos[self._body, 2]), float(data.xmat[self._body, 8])
        carries = np.abs(data.contact.frame[:, 2]) > STANDING
        touching = self._model.geom_bodyid[data.contact.geom[carries]]
        if all((touching == self._model.body(name).id).any() for name in WHEELS):
            self._height_m = height_m
        limit_m = FALL_M if upright > math.cos(TIPPED_RAD) else TIPPED_FALL_M
        return height_m < self._height_m - limit_m
