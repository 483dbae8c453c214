"""How much of one thing an estimator bears: its drift over the strength, and where it breaks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sim.disturbances import DISTURBANCES
from trials.outcomes import Outcome, Outcomes, Recording, Trial, Variant
from trials.report.figure import INK, RED, tidy

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Perform = Callable[[Sequence[Trial]], Outcomes]


@dataclass(frozen=True)
class Axis:
    """One thing that can be more or less.

    Attributes:
        label: With the unit.
        reach: Strongest that is tried.
        overrides: Strength to settings of the generator, `key=value` each.
        disturb: Strength to disturbances.
        scene: Where it is tried, unless the user says otherwise.
    """

    label: str
    reach: float
    overrides: Callable[[float], tuple[str, ...]] = lambda _: ()
    disturb: Callable[[float], str] = lambda _: ""
    scene: str = "office"


def _setting(key: str) -> Callable[[float], tuple[str, ...]]:
    return lambda strength: (f"{key}={strength:.6g}",)


def _disturbance(name: str) -> Callable[[float], str]:
    return lambda strength: f"{name}={strength:.6g}" if strength > 0 else ""


AXES: dict[str, Axis] = {
    "exposure": Axis("open shutter, ms", 60.0, _setting("exposure.time_ms"), scene="turntable"),
    "brick_height": Axis("height of the bricks, mm", 30.0, _setting("terrain.brick_mm")),
    "speed": Axis(
        "speed, m/s", 1.5, lambda s: (f"drive.speed_mps={max(s, 0.1):.6g}",
                                      f"drive.acceleration_mps2={max(s, 0.3):.6g}")
    ),
    "texture": Axis(
        "share of the doors that are missing", 1.0,
        lambda s: (f"scene.doors={0.8 * (1 - s):.6g}",), scene="corridor",
    ),
    **{
        name: Axis(f"{name}: strength ({x.about})", 2.0, disturb=_disturbance(name))
        for name, x in DISTURBANCES.items()
    },
}  # fmt: skip
"""What `driftyard stress` can turn up; a disturbance's strength is that of `--disturb`."""


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
        borne = 0.0
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
        points: Strengths to begin with, 0 and the axis' reach among them; 2 or more.
        rounds: Halvings.
        limits: What counts as broken.
    """
    known = list(respond(np.linspace(0, axis.reach, points).tolist()))
    for _ in range(rounds):
        bracket = Curve(axis, scene, tuple(known), limits).bracket
        if bracket is None or bracket[1] == 0:
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

    def drives(strength: float) -> list[Trial]:
        overrides = (*shared, *axis.overrides(strength))
        disturb = axis.disturb(strength)
        return [Trial(Recording(scene, x, overrides, disturb), variant) for x in seeds]

    def respond(strengths: Sequence[float]) -> list[Response]:
        trials = {x: drives(x) for x in strengths}
        outcomes = perform([trial for of in trials.values() for trial in of]).by_trial
        return [_response(x, [outcomes[t] for t in of]) for x, of in trials.items()]

    return respond


def _response(strength: float, outcomes: Sequence[Outcome]) -> Response:
    return Response(
        strength,
        tuple(x.trial.recording.seed for x in outcomes),
        tuple(x.drift_percent for x in outcomes),
        tuple(x.lost_share for x in outcomes),
    )


def verdict(curve: Curve) -> str:
    """Say in a sentence where the estimator breaks."""
    limits, bracket = curve.limits, curve.bracket
    broken = (
        f"broken: drift over {limits.drift_percent:g} % or more than "
        f"{100 * limits.lost_share:g} % of the frames lost, on most drives"
    )
    if bracket is None:
        return f"Bears all up to {curve.responses[-1].strength:g}, {curve.axis.label} ({broken})."
    if bracket[1] == 0:
        return f"Is broken on {curve.scene} as it is ({broken})."
    low, high = bracket
    return f"Breaks between {low:.3g} and {high:.3g}, {curve.axis.label} ({broken})."


def columns(curve: Curve) -> Mapping[str, list[float]]:
    """A row for each drive."""
    rows = [
        (response.strength, seed, drift, 100 * lost)
        for response in curve.responses
        for seed, drift, lost in zip(
            response.seeds, response.drift_percent, response.lost_share, strict=True
        )
    ]
    names = (curve.axis.label, "seed", "drift over 1 m, %", "frames lost, %")
    return {name: [row[k] for row in rows] for k, name in enumerate(names)}


def draw(figure: "Figure", curve: Curve, title: str) -> None:
    """Drift over strength, drives as dots, broken ones as crosses; below, lost frames."""
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
    limits = curve.limits
    for response in curve.responses:
        for drift, lost, broken in zip(
            response.drift_percent, response.lost_share, response.broken(limits), strict=True
        ):
            mark, colour = ("x", RED) if broken else ("o", INK)
            top.plot(response.strength, drift, mark, color=colour, ms=4.5)
            bottom.plot(response.strength, 100 * lost, mark, color=colour, ms=4.5)
    strengths = [x.strength for x in curve.responses]
    medians = [_median(x.drift_percent) for x in curve.responses]
    top.plot(strengths, medians, color=INK, lw=1.2)
    for panel, limit in ((top, limits.drift_percent), (bottom, 100 * limits.lost_share)):
        panel.axhline(limit, color=RED, ls="--", lw=0.8)
        if curve.bracket and curve.bracket[1] > 0:
            panel.axvspan(*curve.bracket, color=RED, alpha=0.12, lw=0)
    top.set_yscale("log")
    top.yaxis.set_major_formatter("{x:g}")
    tidy(top, "", "drift over 1 m, %", title)
    tidy(bottom, curve.axis.label, "lost, %")


def _median(values: Sequence[float]) -> float:
    known = [x for x in values if np.isfinite(x)]
    return float(np.median(known)) if known else np.nan
