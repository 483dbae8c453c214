"""Stress test: drift of an estimator over a growing disturbance, and where it fails.

An axis is a strength, and the settings or the disturbance that it stands for.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TypeVar

import numpy as np

from sim.disturbances import DISTURBANCES
from trials.execution.jobs import Recording, Result, Variant, jobs_of
from trials.execution.runner import run_jobs
from vo.contract.arrays import Mask

K = TypeVar("K")


@dataclass(frozen=True)
class Axis:
    """Quantity that a stress test varies between two strengths.

    Attributes:
        label: Description with the unit.
        overrides: Strength to settings of the recording, `key=value` each.
        disturb: Strength to disturbances, as for `driftyard generate`.
        scene: Default scene.
    """

    label: str
    maximum: float
    minimum: float = 0.0
    overrides: Callable[[float], tuple[str, ...]] = lambda _: ()
    disturb: Callable[[float], str] = lambda _: ""
    scene: str = "office"


def _settings(*keys: str) -> Callable[[float], tuple[str, ...]]:
    return lambda strength: tuple(f"{key}={strength:.6g}" for key in keys)


def _disturbance(name: str, unit: float = 1.0) -> Callable[[float], str]:
    """Return the function for a disturbance whose strength 1 is `unit` of the axis."""
    return lambda strength: f"{name}={strength / unit:.6g}" if strength > 0 else ""


MAIN: dict[str, Axis] = {
    "exposure": Axis(
        "exposure time, ms", 40.0, overrides=_settings("exposure.time_ms"), scene="turntable"
    ),
    "brick_height": Axis("height of the bricks, mm", 30.0, overrides=_settings("terrain.brick_mm")),
    "noise": Axis(
        "read noise, % of full scale (shot noise rises with it)", 6.0,
        disturb=_disturbance("noise", unit=3.0),
    ),
    "calibration": Axis(
        "unknown pitch and unknown yaw of the right camera, degrees each", 0.4,
        overrides=_settings("calibration.pitch_deg", "calibration.yaw_deg"),
    ),
    "texture": Axis(
        "fraction of the doors that are missing", 1.0,
        overrides=lambda s: (f"scene.doors={0.8 * (1 - s):.6g}",), scene="corridor",
    ),
    "speed": Axis(
        "speed, m/s", 1.0, minimum=0.3, overrides=_settings("drive.speed_mps",
                                                          "drive.acceleration_mps2"),
    ),
}  # fmt: skip
"""Axes of `driftyard stress all`; each has a unit."""

AXES: dict[str, Axis] = MAIN | {
    name: Axis(f"strength of the disturbance {name} ({x.about})", 2.0, disturb=_disturbance(name))
    for name, x in DISTURBANCES.items()
    if name not in MAIN
}
"""All axes; the strength of a disturbance is that of `--disturb`."""


@dataclass(frozen=True)
class Limits:
    """Drift over 1 m, %, and ratio of frames without a pose, above which a drive has failed."""

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

    @staticmethod
    def of(strength: float, results: Sequence[Result]) -> "Response":
        """Summarise the results of the drives at one strength."""
        rows = [(x.job.recording.seed, x.drift_percent, x.lost_share) for x in results]
        return Response(strength, *zip(*rows, strict=True))

    def failed(self, limits: Limits) -> Mask:
        """Return which drives (N,) have failed."""
        few, lost = np.array(self.drift_percent) <= limits.drift_percent, np.array(self.lost_share)
        return ~few | (lost > limits.lost_share)

    def fails(self, limits: Limits) -> bool:
        """Whether more than half of the drives have failed."""
        return bool(self.failed(limits).mean() > 0.5)


@dataclass(frozen=True)
class Curve:
    """Responses along one axis, in the order of their strengths; all drives are of one scene."""

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
    """Test evenly spaced strengths, 2 or more, then bisect where the estimator fails.

    `respond` returns the responses at several strengths; all drives are of one scene.
    """
    known = list(respond(np.linspace(axis.minimum, axis.maximum, points).tolist()))
    for _ in range(rounds):
        bracket = Curve(axis, scene, tuple(known), limits).bracket
        if bracket is None or bracket[1] == axis.minimum:
            break
        known = sorted([*known, *respond([sum(bracket) / 2])], key=lambda x: x.strength)
    return Curve(axis, scene, tuple(known), limits)


def run_drives(
    drives: Mapping[K, Sequence[Recording]], variant: Variant, progress: Callable[[object], None]
) -> dict[K, list[Result]]:
    """Record or reuse the drives of each key, run an estimator over them, and return the results.

    Progress is called for each drive.
    """
    jobs = jobs_of(chain.from_iterable(drives.values()), [variant])
    results = run_jobs(jobs, progress=progress)
    return {key: [results.at(x, variant) for x in some] for key, some in drives.items()}


def describe(curve: Curve) -> str:
    """Describe in a sentence where the estimator fails."""
    bracket, label = curve.bracket, curve.axis.label
    if bracket is None:
        return f"Tolerates all strengths up to {curve.responses[-1].strength:g} ({label})."
    if bracket[1] == curve.axis.minimum:
        return f"Fails on {curve.scene} without any disturbance."
    low, high = bracket
    return f"Fails between {low:.3g} and {high:.3g} ({label})."
