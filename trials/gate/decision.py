"""Decision of the gate: pass, regress or undecided, for each figure and for all."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial

import numpy as np

from trials.gate.baseline import Measurement, Rules
from trials.gate.statistics import (
    MIN_DEGREES,
    MIN_REMAINING_DEGREES,
    Effect,
    degrees_of_freedom,
    detectable,
    newly_lost,
)
from vo.contract.arrays import Array


class Verdict(StrEnum):
    """Verdict of the gate, the worst first; errors are exceptions."""

    REGRESS = "regress"
    UNDECIDED = "undecided"
    PASS = "pass"


@dataclass(frozen=True)
class Change:
    """A log ratio with its confidence bounds, which are NaN with too few pairs.

    Attributes:
        effect: Log ratios of the pairs.
        tested: The same, and losses that count as changes; bounds are of this.
        null: Log ratio that the lower bound of a regression exceeds.
    """

    effect: Effect
    tested: Effect
    rules: Rules
    null: float
    low: float
    high: float

    @staticmethod
    def of(effect: Effect, tested: Effect, rules: Rules, null: float) -> "Change":
        """Compute the bounds of the tested effect."""
        change = Change(effect, tested, rules, null, np.nan, np.nan)
        if tested.degrees < MIN_REMAINING_DEGREES:
            return change
        low, high = tested.bounds(change.level)
        return replace(change, low=low, high=high)

    @property
    def counted(self) -> int:
        """Number of losses that count as changes."""
        return len(self.tested.values) - len(self.effect.values)

    @property
    def level(self) -> float:
        """Error probability of a bound: that of the rules, halved for each counted loss.

        Only losses of the candidate count, which are half of the changed ones if nothing has
        changed; the reasons are in docs/decisions/0026.
        """
        return self.rules.level / 2**self.counted

    @property
    def increased_everywhere(self) -> bool:
        """Whether losses count and every sample exceeds `null`, which chance makes too rarely.

        Source:
            The sign test: Arbuthnott, Philosophical Transactions 27, 1710.
        """
        samples = self.tested.scene_means if self.tested.by_scene else self.tested.values
        by_chance = 0.5 ** len(samples)
        return bool(self.counted and by_chance <= self.rules.level and samples.min() > self.null)

    @property
    def bootstrap(self) -> tuple[float, float]:
        """Confidence bounds by the bootstrap, for comparison."""
        if np.isnan(self.low):
            return np.nan, np.nan
        return self.tested.bootstrap(self.level)

    @property
    def detectable(self) -> float:
        """Smallest true log ratio that is found with the power of the rules; NaN if unknown."""
        if np.isnan(self.low) or self.tested.error == 0:
            return np.nan
        return self.null + detectable(
            self.tested.error, self.tested.degrees, self.level, self.rules.power
        )


@dataclass(frozen=True)
class Finding:
    """Verdict on one figure, with its reason.

    Attributes:
        figure: drift, losses, time or nees.
        before: Mean of the baseline over the compared sequences, with equal weight for every
            scene as in the change; NaN if there is none.
        after: Mean of the candidate over the same sequences.
        change: Comparison of both; None for losses.
    """

    figure: str
    verdict: Verdict
    why: str
    before: float
    after: float
    change: Change | None = None


@dataclass(frozen=True)
class Decision:
    """Verdict on all figures, the findings, and a remark if there is one."""

    verdict: Verdict
    findings: tuple[Finding, ...]
    remark: str = ""


def decide(
    rules: Rules,
    scenes: Sequence[str],
    before: Sequence[Measurement],
    after: Sequence[Measurement],
) -> Decision:
    """Compare a candidate with its baseline over the same N sequences, given their scenes.

    Drift regresses if the lower bound of its increase exceeds the tolerance. Time and NEES change
    with the machine and by chance on all sequences alike, so they regress only if it exceeds
    their margins. Each of the three passes if the upper bound is below its margin; lost sequences
    are counted. The worst verdict of a figure is that of the gate, except that too few sequences
    always leave it undecided. Drift is compared on sequences that neither estimator loses; if few
    of them remain, new losses count as increases of the drift (`Effect.with_losses`).
    """
    (was, now), (time_was, time_now), (nees_was, nees_now) = (
        [np.array([getattr(x, name) for x in side]) for side in (before, after)]
        for name in ("log_drift", "log_time", "log_nees")
    )
    compared = partial(_compare, rules, scenes)
    lost = _newly_lost_scenes(scenes, before, after)
    limits = (rules.drift_tolerance, rules.drift_margin)
    findings = [
        compared("drift", was, now, now - was, limits, lost),
        _losses(rules, before, after),
    ]
    time, nees = rules.time_margin, rules.nees_margin
    slower = time_now - time_was
    distance = np.abs(nees_now) - np.abs(nees_was)  # of the NEES from 1, on either side
    if time and np.isfinite(slower).any():
        findings.append(compared("time", time_was, time_now, slower, (time, time)))
    if nees and np.isfinite(distance).any():
        findings.append(compared("nees", nees_was, nees_now, distance, (nees, nees)))
    if degrees_of_freedom(scenes) < MIN_DEGREES:
        few = (
            f"too few sequences for a decision: {len(scenes)} of {len(set(scenes))} scenes; "
            f"five scenes are enough, or five seeds of one"
        )
        return Decision(Verdict.UNDECIDED, tuple(findings), few)
    verdicts = {x.verdict for x in findings}
    return Decision(next(x for x in Verdict if x in verdicts), tuple(findings))


def decide_change(change: Change, margin: float) -> tuple[Verdict, str]:
    """Decide on a log ratio, which passes if its upper bound is below `margin`, a log ratio too."""
    if np.isnan(change.low):
        few = f"is undecided, because only {len(change.effect.values)} sequences can be compared"
        return Verdict.UNDECIDED, few
    if not change.tested.values.any():
        return Verdict.PASS, "is the same on every sequence"
    if change.low > change.null or change.increased_everywhere:
        return Verdict.REGRESS, f"increased by more than {percent(change.null)}"
    if change.high < margin:
        return Verdict.PASS, f"increased by less than {percent(margin)}"
    return Verdict.UNDECIDED, f"may or may not have increased by {percent(margin)}"


def percent(log_ratio: float, signed: bool = False) -> str:
    """Format a log ratio as a change in percent."""
    change = 100 * np.expm1(log_ratio)
    return f"{change:{'+' if signed else ''}.1f} %"


def _compare(
    rules: Rules,
    scenes: Sequence[str],
    figure: str,
    was: Array,
    now: Array,
    values: Array,
    limits: tuple[float, float],
    lost: Sequence[str] = (),
) -> Finding:
    """Decide on a figure, from (N,) its logarithms and the differences that should not grow.

    The limits are tolerance and margin; `lost` has the scenes of newly lost sequences.
    """
    tolerance, margin = limits
    effect = Effect.of(values, scenes)
    change = Change.of(effect, effect.with_losses(lost), rules, np.log1p(tolerance))
    verdict, why = decide_change(change, np.log1p(margin))
    if change.counted:
        why += f", with newly lost sequences ({change.counted}) counted as the largest change"
    known = np.isfinite(values)
    before, after = (
        float(np.exp(Effect.of(np.where(known, x, np.nan), scenes).mean)) for x in (was, now)
    )
    return Finding(figure, verdict, why, before, after, change)


def _newly_lost_scenes(
    scenes: Sequence[str], before: Sequence[Measurement], after: Sequence[Measurement]
) -> Sequence[str]:
    """Return the scenes of newly lost sequences, less as many as are no longer lost."""
    lost = [(x, a.is_lost, b.is_lost) for x, a, b in zip(scenes, before, after, strict=True)]
    no_longer = sum(was and not now for _, was, now in lost)
    return [x for x, was, now in lost if now and not was][no_longer:]


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
