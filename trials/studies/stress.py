"""How much of one thing an estimator bears: its drift over the strength, and where it breaks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from trials.execution.jobs import Job, Recording, Result, Results, Variant
from trials.studies.strengths import Axis

Perform = Callable[[Sequence[Job]], Results]


@dataclass(frozen=True)
class Limits:
    """When an estimator counts as broken.

    Attributes:
        drift_percent: Drift over 1 m above it.
        lost_share: Share of frames without a pose above it.
    """

    drift_percent: float = 2.0
    lost_share: float = 0.05


@dataclass(frozen=True)
class Response:
    """What one strength did.

    Attributes:
        strength: In the axis' unit.
        seeds: (N,) of the drives.
        drift_percent: (N,) drift over 1 m; NaN if there is none to speak of.
        lost_share: (N,) of the frames.
    """

    strength: float
    seeds: tuple[int, ...]
    drift_percent: tuple[float, ...]
    lost_share: tuple[float, ...]

    def broken(self, limits: Limits) -> tuple[bool, ...]:
        """Which drives the estimator did not survive."""
        return tuple(
            not drift <= limits.drift_percent or lost > limits.lost_share
            for drift, lost in zip(self.drift_percent, self.lost_share, strict=True)
        )

    def breaks(self, limits: Limits) -> bool:
        """Whether it survived fewer than half of the drives."""
        return sum(self.broken(limits)) > len(self.seeds) / 2


@dataclass(frozen=True)
class Curve:
    """Responses to one axis.

    Attributes:
        axis: Which.
        scene: Where.
        responses: In the order of their strengths.
        limits: What counts as broken.
    """

    axis: Axis
    scene: str
    responses: tuple[Response, ...]
    limits: Limits

    @property
    def bracket(self) -> tuple[float, float] | None:
        """Strongest that was borne below the weakest that was not, and that; None if all were."""
        borne = self.axis.least
        for response in self.responses:
            if response.breaks(self.limits):
                return borne, response.strength
            borne = response.strength
        return None


def stress(
    axis: Axis,
    scene: str,
    respond: Callable[[Sequence[float]], Sequence[Response]],
    points: int = 5,
    rounds: int = 4,
    limits: Limits = Limits(),
) -> Curve:
    """Try evenly spaced strengths, then halve the interval in which the estimator breaks.

    Args:
        axis: What to turn up.
        scene: Where.
        respond: Finds what each of some strengths does.
        points: Strengths to begin with, the axis' least and reach among them; 2 or more.
        rounds: Halvings.
        limits: What counts as broken.
    """
    known = list(respond(np.linspace(axis.least, axis.reach, points).tolist()))
    for _ in range(rounds):
        bracket = Curve(axis, scene, tuple(known), limits).bracket
        if bracket is None or bracket[1] == axis.least:
            break
        known = sorted([*known, *respond([sum(bracket) / 2])], key=lambda x: x.strength)
    return Curve(axis, scene, tuple(known), limits)


def responder(
    axis: Axis,
    scene: str,
    variant: Variant,
    seeds: Sequence[int],
    shared: tuple[str, ...],
    perform: Perform,
) -> Callable[[Sequence[float]], list[Response]]:
    """Make the function that drives with given strengths.

    Args:
        axis: What to turn up.
        scene: Where.
        variant: The estimator.
        seeds: Of the drives at every strength.
        shared: Overrides of every recording.
        perform: Records and runs.
    """

    def drives(strength: float) -> list[Job]:
        overrides = (*shared, *axis.overrides(strength))
        disturb = axis.disturb(strength)
        return [Job(Recording(scene, x, overrides, disturb), variant) for x in seeds]

    def respond(strengths: Sequence[float]) -> list[Response]:
        jobs = {x: drives(x) for x in strengths}
        results = perform([job for of in jobs.values() for job in of]).by_job
        return [_response(x, [results[t] for t in of]) for x, of in jobs.items()]

    return respond


def _response(strength: float, results: Sequence[Result]) -> Response:
    return Response(
        strength,
        tuple(x.job.recording.seed for x in results),
        tuple(x.drift_percent for x in results),
        tuple(x.lost_share for x in results),
    )


def verdict(curve: Curve) -> str:
    """Say in a sentence where the estimator breaks."""
    bracket, label = curve.bracket, curve.axis.label
    if bracket is None:
        return f"Bears all up to {curve.responses[-1].strength:g} ({label})."
    if bracket[1] == curve.axis.least:
        return f"Is broken on {curve.scene} as it is."
    low, high = bracket
    return f"Breaks between {low:.3g} and {high:.3g} ({label})."
