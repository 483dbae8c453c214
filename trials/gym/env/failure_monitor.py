"""The watch: whether a trial has failed, judged on the truth."""

import math

from sim.world.drive import TIPPED_RAD
from sim.world.world import thing_of
from trials.gym.world.simulation import Simulation

STUCK_AFTER_S = 10.0
STUCK_WITHIN_M, STUCK_WITHIN_RAD = 0.05, math.radians(10)
ASKED_MPS = 0.02
"""A wheel that is asked for less is meant to stand."""


class Watch:
    """Collision, tipping over, and wheels that turn to no effect."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._from = simulation.place
        self._since_s = simulation.time_s

    def failure(self, asked_mps: float) -> str:
        """Say what went wrong in the last step: collision, tipped, stuck, or nothing.

        Args:
            asked_mps: Speed of the faster wheel's rim that was asked for.
        """
        simulation = self._simulation
        if (simulation.touched & simulation.hard).any():
            return "collision"
        if simulation.upright < math.cos(TIPPED_RAD):
            return "tipped"
        x, y, yaw = simulation.place
        moved_m = math.hypot(x - self._from[0], y - self._from[1])
        turned_rad = abs(math.remainder(yaw - self._from[2], 2 * math.pi))
        if abs(asked_mps) < ASKED_MPS or moved_m > STUCK_WITHIN_M or turned_rad > STUCK_WITHIN_RAD:
            self._from, self._since_s = (x, y, yaw), simulation.time_s
        return "stuck" if simulation.time_s - self._since_s > STUCK_AFTER_S else ""

    @property
    def contacts(self) -> tuple[str, ...]:
        """Names of what was touched in the last step, ground apart; sorted."""
        simulation = self._simulation
        geoms = (simulation.touched & simulation.solid).nonzero()[0]
        if len(geoms) == 0:
            return ()
        return tuple(sorted({thing_of(simulation.world, int(k)).name for k in geoms}))
