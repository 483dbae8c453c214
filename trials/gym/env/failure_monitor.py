"""Failure monitor: collision, tipping over and wheels that turn without effect, from the truth."""

import math

from sim.world.drive import TIPPED_RAD
from sim.world.world import thing_of
from trials.gym.world.simulation import Simulation

STUCK_AFTER_S = 10.0
MIN_MOTION_M, MIN_MOTION_RAD = 0.05, math.radians(10)
"""Displacement and turn that end a period without motion."""
MIN_COMMAND_MPS = 0.02
"""Speed of a wheel's rim below which the rover is meant to stand."""


class FailureMonitor:
    """Detects collision, tipping over and being stuck."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._from = simulation.pose2
        self._since_s = simulation.time_s

    def failure(self, command_mps: float) -> str:
        """Return the failure of the last step: collision, tipped, stuck, or an empty string.

        Args:
            command_mps: Commanded speed of the faster wheel's rim.
        """
        simulation = self._simulation
        if (simulation.touched & simulation.rigid).any():
            return "collision"
        if simulation.upright < math.cos(TIPPED_RAD):
            return "tipped"
        x, y, yaw = simulation.pose2
        moved_m = math.hypot(x - self._from[0], y - self._from[1])
        turned_rad = abs(math.remainder(yaw - self._from[2], 2 * math.pi))
        moved = moved_m > MIN_MOTION_M or turned_rad > MIN_MOTION_RAD
        if abs(command_mps) < MIN_COMMAND_MPS or moved:
            self._from, self._since_s = (x, y, yaw), simulation.time_s
        return "stuck" if simulation.time_s - self._since_s > STUCK_AFTER_S else ""

    @property
    def contacts(self) -> tuple[str, ...]:
        """Names of what was touched in the last step, sorted; the ground is left out."""
        simulation = self._simulation
        geoms = (simulation.touched & simulation.obstacles).nonzero()[0]
        if len(geoms) == 0:
            return ()
        return tuple(sorted({thing_of(simulation.world, int(k)).name for k in geoms}))
