"""A signal that follows a fixed plan of phases and can be preempted at any time."""

from collections.abc import Mapping, Sequence
from math import inf

from trials.routing.phases import APPROACH, Phase, are_compatible
from trials.routing.preemption import Green

YELLOW_S, ALL_RED_S = 3.0, 1.0
TRANSITION_S = YELLOW_S + ALL_RED_S
"""Time from the end of one green until a conflicting one."""
CONFLICTS: Mapping[int, tuple[int, ...]] = {
    a: tuple(b for b in APPROACH if not are_compatible(a, b)) for a in APPROACH
}
"""By movement, those that may not have green with it."""


def mean_waits_s(plan: Mapping[Phase, float]) -> dict[int, float]:
    """Compute the mean wait of each movement for green, by the greens of a plan, s.

    A vehicle that arrives at any time waits r^2 / (2 C) with a red r in a cycle C (Webster 1958,
    uniform delay without other vehicles).
    """
    cycle_s = sum(plan.values()) + TRANSITION_S * len(plan)
    green_s = {x: sum(g for phase, g in plan.items() if x in phase) for x in APPROACH}
    return {x: (cycle_s - g) ** 2 / (2 * cycle_s) for x, g in green_s.items()}


class SignalController:
    """Lights of one intersection.

    A movement turns green when it belongs to the phase, and all movements that conflict with it
    have had their yellow and all-red: also if a preemption begins during a transition. After a
    preemption, the plan goes on with the phase after the preempting one.

    Args:
        plan: Phases in their order, each with the duration of its green in s.
        start_s: Time at which the first green begins.
    """

    def __init__(self, plan: Sequence[tuple[Phase, float]], start_s: float = 0.0) -> None:
        self.plan = plan
        self.phase: Phase = plan[0][0]
        """The phase that is on, or to which a transition leads."""
        self.green: set[int] = set()
        self._clear_s = dict.fromkeys(APPROACH, -inf)
        self._began_s = dict.fromkeys(APPROACH, -inf)
        self._position, self._end_s = 0, start_s + plan[0][1]
        self._preempting: Phase | None = None

    def request(self, phase: Phase, time_s: float) -> None:
        """Begin a preemption, or change its phase, and hold it until `release`."""
        self._preempting = phase
        if phase != self.phase:
            self._switch(phase, time_s)

    def release(self, time_s: float) -> None:
        """End a preemption: the plan goes on behind the present phase, if it is in the plan."""
        if self._preempting is not None:
            self._preempting = None
            phases = [phase for phase, _ in self.plan]
            if self.phase in phases:
                self._position = phases.index(self.phase)
            self._end_s = time_s

    def step(self, time_s: float) -> None:
        """Advance to a time, which never falls."""
        if self._preempting is None and time_s >= self._end_s:
            self._position = (self._position + 1) % len(self.plan)
            phase, green_s = self.plan[self._position]
            self._end_s = time_s + TRANSITION_S + green_s
            self._switch(phase, time_s)
        for movement in {*self.phase} - self.green:
            if all(self._clear_s[x] <= time_s for x in (movement, *CONFLICTS[movement])):
                self.green.add(movement)
                self._began_s[movement] = time_s

    def light(self, movement: int, time_s: float) -> str:
        """Return the light of a movement as SUMO writes it: G, y or r."""
        if movement in self.green:
            return "G"
        return "y" if time_s < self._clear_s[movement] - ALL_RED_S else "r"

    def last_green(self, movement: int) -> Green | None:
        """Return the last or present green of a movement; None if there was none."""
        start_s = self._began_s[movement]
        if start_s == -inf:
            return None
        if movement in self.green:
            return Green(start_s)
        return Green(start_s, self._clear_s[movement] - TRANSITION_S - start_s)

    def _switch(self, phase: Phase, time_s: float) -> None:
        for movement in self.green - {*phase}:
            self.green.remove(movement)
            self._clear_s[movement] = time_s + TRANSITION_S
        self.phase = phase
