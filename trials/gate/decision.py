"""The decision: pass, regress or undecided, figure by figure and of all."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from trials.gate.measurement import Measurement
from trials.gate.rules import Rules
from trials.gate.statistics import (
    MIN_DEGREES,
    Effect,
    degrees_of_freedom,
    detectable,
    newly_lost,
)
from vo.contract.arrays import Array


class Verdict(StrEnum):
    """What the gate says; errors are exceptions."""

    PASS = "pass"
    REGRESS = "regress"
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class Change:
    """A log ratio with its bounds.

    Attributes:
        effect: What it is found from.
        rules: With the level of the bounds.
        null: Certainly above this it regresses.
        low: The truth is above it; NaN where there are too few pairs.
        high: The truth is below it.
    """

    effect: Effect
    rules: Rules
    null: float
    low: float
    high: float

    @staticmethod
    def of(effect: Effect, rules: Rules, null: float) -> "Change":
        """Sum up an effect."""
        if effect.degrees < MIN_DEGREES:
            return Change(effect, rules, null, np.nan, np.nan)
        return Change(effect, rules, null, *effect.bounds(rules.level))

    @property
    def bootstrap(self) -> tuple[float, float]:
        """The bounds by the bootstrap, to compare with."""
        if np.isnan(self.low):
            return np.nan, np.nan
        return self.effect.bootstrap(self.rules.level)

    @property
    def detectable(self) -> float:
        """Smallest true increase that this design finds with the power of the rules.

        By the spread of these pairs; NaN if they do not spread.
        """
        if np.isnan(self.low) or self.effect.error == 0:
            return np.nan
        return self.null + detectable(
            self.effect.error, self.effect.degrees, self.rules.level, self.rules.power
        )


@dataclass(frozen=True)
class Finding:
    """What the gate says of one figure.

    Attributes:
        figure: drift, losses, time or nees.
        verdict: Of this figure.
        why: One sentence.
        before: The baseline's figure, typical over sequences; NaN if there is none.
        after: The candidate's.
        change: None for losses.
    """

    figure: str
    verdict: Verdict
    why: str
    before: float
    after: float
    change: Change | None = None


@dataclass(frozen=True)
class Decision:
    """The verdict of all, the findings behind it, and a remark where one is due."""

    verdict: Verdict
    findings: tuple[Finding, ...]
    remark: str = ""


def decide(
    rules: Rules,
    scenes: Sequence[str],
    before: Sequence[Measurement],
    after: Sequence[Measurement],
) -> Decision:
    """Compare a candidate with its baseline over the same N sequences.

    Drift regresses once it is certain that it grew by more than the tolerance, time and NEES,
    which noise moves as a whole, once they grew by more than their margins. All pass once it is
    certain that they grew by less than their margins. Drift is compared where neither is lost.

    Args:
        rules: Level, power and margins.
        scenes: N names.
        before: N, the baseline's.
        after: N, the candidate's.
    """
    findings = [_drift(rules, scenes, before, after), _losses(rules, before, after)]
    findings += _time(rules, scenes, before, after)
    findings += _nees(rules, scenes, before, after)
    if degrees_of_freedom(scenes) < MIN_DEGREES:
        few = (
            f"too few sequences for a decision: {len(scenes)} of {len(set(scenes))} scenes; "
            f"five scenes are enough, or five seeds of one"
        )
        return Decision(Verdict.UNDECIDED, tuple(findings), few)
    said = {x.verdict for x in findings}
    worst = (Verdict.REGRESS, Verdict.UNDECIDED, Verdict.PASS)
    return Decision(next(x for x in worst if x in said), tuple(findings))


def decide_change(change: Change, margin: float) -> tuple[Verdict, str]:
    """Decide on a log ratio.

    Args:
        change: With its bounds.
        margin: Certainly below this it passes.
    """
    if np.isnan(change.low):
        few = f"cannot be judged, for only {len(change.effect.values)} sequences can be compared"
        return Verdict.UNDECIDED, few
    if not change.effect.values.any():
        return Verdict.PASS, "is the same on every sequence"
    if change.low > change.null:
        return Verdict.REGRESS, f"increased by more than {percent(change.null)}"
    if change.high < margin:
        return Verdict.PASS, f"increased by less than {percent(margin)}"
    return Verdict.UNDECIDED, f"may or may not have increased by {percent(margin)}"


def percent(log_ratio: float, signed: bool = False) -> str:
    """A log ratio as a change in percent."""
    change = 100 * np.expm1(log_ratio)
    return f"{change:{'+' if signed else ''}.1f} %"


def _drift(
    rules: Rules, scenes: Sequence[str], before: Sequence[Measurement], after: Sequence[Measurement]
) -> Finding:
    was, now = (np.array([x.log_drift for x in side]) for side in (before, after))
    null, margin = np.log1p(rules.drift_tolerance), np.log1p(rules.drift_margin)
    change = Change.of(Effect.of(now - was, scenes), rules, null)
    verdict, why = decide_change(change, margin)
    return Finding("drift", verdict, why, _typical(was), _typical(now), change)


def _losses(rules: Rules, before: Sequence[Measurement], after: Sequence[Measurement]) -> Finding:
    lost = [[x.is_lost for x in side] for side in (before, after)]
    gone, back, p = newly_lost(*lost)
    chance = f"{gone} newly lost, {back} no longer; p = {p:.3f}"
    if gone <= back:
        verdict, why = Verdict.PASS, f"are no more ({chance})"
    elif p <= rules.level:
        verdict, why = Verdict.REGRESS, f"are more ({chance})"
    else:
        verdict, why = Verdict.UNDECIDED, f"are more, which may be chance ({chance})"
    shares = [float(np.mean(x)) for x in lost]
    return Finding("losses", verdict, why, shares[0], shares[1])


def _time(
    rules: Rules, scenes: Sequence[str], before: Sequence[Measurement], after: Sequence[Measurement]
) -> list[Finding]:
    was, now = (np.array([x.log_time for x in side]) for side in (before, after))
    effect = Effect.of(now - was, scenes)
    if not rules.time_margin or not len(effect.values):
        return []
    margin = np.log1p(rules.time_margin)
    change = Change.of(effect, rules, margin)
    verdict, why = decide_change(change, margin)
    return [Finding("time", verdict, why, _typical(was), _typical(now), change)]


def _nees(
    rules: Rules, scenes: Sequence[str], before: Sequence[Measurement], after: Sequence[Measurement]
) -> list[Finding]:
    """Judge how much further the covariances are from the errors, on either side."""
    was, now = (np.array([x.log_nees for x in side]) for side in (before, after))
    effect = Effect.of(np.abs(now) - np.abs(was), scenes)
    if not rules.nees_margin or not len(effect.values):
        return []
    margin = np.log1p(rules.nees_margin)
    change = Change.of(effect, rules, margin)
    verdict, why = decide_change(change, margin)
    return [Finding("nees", verdict, why, _typical(was), _typical(now), change)]


def _typical(logs: Array) -> float:
    """Geometric mean over the sequences that have the figure; NaN if none has."""
    known = logs[np.isfinite(logs)]
    return float(np.exp(known.mean())) if len(known) else np.nan
