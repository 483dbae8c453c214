"""Stress test: drift of an estimator over a growing disturbance, and where it fails."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from trials.execution.jobs import Job, Recording, Result, Results, Variant
from trials.studies.stress_axes import Axis


@dataclass(frozen=True)
class Limits:
    """Limits above which a drive has failed.

    Attributes:
        drift_percent: Drift over 1 m, %.
        lost_share: Ratio of frames without a pose to all frames.
    """

    drift_percent: float = 2.0
    lost_share: float = 0.05


@dataclass(frozen=True)
class Response:
    """Errors of N drives at one strength.

    Attributes:
        strength: In the unit of the axis.
        seeds: (N,) of the drives.
        drift_percent: (N,) drift over 1 m, %; NaN if undefined.
        lost_share: (N,) ratio of frames without a pose to all frames.
    """

    strength: float
    seeds: tuple[int, ...]
    drift_percent: tuple[float, ...]
    lost_share: tuple[float, ...]

    def failed(self, limits: Limits) -> tuple[bool, ...]:
        """Return which drives have failed."""
        return tuple(
            not drift <= limits.drift_percent or lost > limits.lost_share
            for drift, lost in zip(self.drift_percent, self.lost_share, strict=True)
        )

    def fails(self, limits: Limits) -> bool:
        """Whether more than half of the drives have failed."""
        return sum(self.failed(limits)) > len(self.seeds) / 2


@dataclass(frozen=True)
class Curve:
    """Responses along one axis.

    Attributes:
        axis: What is varied.
        scene: Scene of all drives.
        responses: In the order of their strengths.
        limits: Limits of a failure.
    """

    axis: Axis
    scene: str
    responses: tuple[Response, ...]
    limits: Limits

    @property
    def bracket(self) -> tuple[float, float] | None:
        """Largest strength without failure below the smallest with one, and that; None without."""
        passed = self.axis.minimum
        for response in self.responses:
            if response.fails(self.limits):
                return passed, response.strength
            passed = response.strength
        return None


def stress(
    axis: Axis,
    scene: str,
    respond: Callable[[Sequence[float]], Sequence[Response]],
    points: int = 5,
    rounds: int = 4,
    limits: Limits = Limits(),
) -> Curve:
    """Test evenly spaced strengths, then bisect the interval in which the estimator fails.

    Args:
        axis: What is varied.
        scene: Scene of all drives.
        respond: Returns the responses at several strengths.
        points: Strengths to begin with, from the minimum to the maximum of the axis; 2 or more.
        rounds: Number of bisections.
        limits: Limits of a failure.
    """
    known = list(respond(np.linspace(axis.minimum, axis.maximum, points).tolist()))
    for _ in range(rounds):
        bracket = Curve(axis, scene, tuple(known), limits).bracket
        if bracket is None or bracket[1] == axis.minimum:
            break
        known = sorted([*known, *respond([sum(bracket) / 2])], key=lambda x: x.strength)
    return Curve(axis, scene, tuple(known), limits)


def respond(
    axis: Axis,
    scene: str,
    variant: Variant,
    seeds: Sequence[int],
    shared: tuple[str, ...],
    run: Callable[[Sequence[Job]], Results],
    strengths: Sequence[float],
) -> list[Response]:
    """Measure the responses of an estimator at several strengths.

    Args:
        axis: What is varied.
        scene: Scene of all drives.
        variant: The estimator.
        seeds: Of the drives at every strength.
        shared: Overrides of every recording.
        run: Records and runs jobs.
        strengths: In the unit of the axis.
    """
    jobs: dict[float, list[Job]] = {}
    for x in strengths:
        overrides, disturb = (*shared, *axis.overrides(x)), axis.disturb(x)
        jobs[x] = [Job(Recording(scene, seed, overrides, disturb), variant) for seed in seeds]
    results = run([job for some in jobs.values() for job in some]).by_job
    return [response_of(x, [results[job] for job in some]) for x, some in jobs.items()]


def response_of(strength: float, results: Sequence[Result]) -> Response:
    """Summarise the results of the drives at one strength."""
    return Response(
        strength,
        tuple(x.job.recording.seed for x in results),
        tuple(x.drift_percent for x in results),
        tuple(x.lost_share for x in results),
    )


def describe(curve: Curve) -> str:
    """Describe in a sentence where the estimator fails."""
    bracket, label = curve.bracket, curve.axis.label
    if bracket is None:
        return f"Tolerates all strengths up to {curve.responses[-1].strength:g} ({label})."
    if bracket[1] == curve.axis.minimum:
        return f"Fails on {curve.scene} without any disturbance."
    low, high = bracket
    return f"Fails between {low:.3g} and {high:.3g} ({label})."
