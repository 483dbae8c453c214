"""False alarm rate and power of the gate, by simulation of its decision; `driftyard gate power`.

A log ratio of drift is the sum of the true change, an effect of the scene (Gaussian) and an effect
of the sequence: Student's t with four degrees of freedom, which has heavier tails than a Gaussian,
with a scale that differs between scenes by up to a factor of two. With fewer scenes than can be
samples, their effects sum to zero, as the decision is then about these scenes alone. Losses, times
and NEES vary randomly, without a true change; a weakened estimator loses one more sequence. With
--result, effects of scenes and sequences are drawn from a JSON result of the gate instead, with its
mean removed.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from trials.gate.baseline import Measurement, Rules
from trials.gate.decision import Decision, Verdict, decide
from trials.gate.statistics import MIN_SCENES, Effect, design_error, seeds_needed
from vo.contract.arrays import Array
from vo.contract.errors import DatasetError

RULES = Rules()
CHANGE = float(np.log1p(0.1))
"""Log ratio of a true increase of the drift by 10 %."""
WEAKENED = float(np.log1p(0.6))
"""Log ratio of the drift of a weakened estimator, which also loses one sequence, +60 %."""
TOLERANCE = float(np.log1p(RULES.drift_tolerance))
FRAMES, DRIFT_PERCENT = 100, 0.1
LOSS, TIME_COMMON, TIME_EACH, NEES_EACH = 0.02, 0.03, 0.05, 0.1
"""Probability of a loss; std. dev. of log time, common and individual; std. dev. of log NEES."""
TAIL_DEGREES = 4
FLIPS = 999
"""Number of resamples of the sign flips and of the bootstrap."""

Draw = Callable[[np.random.Generator, int, int], Array]
"""Draws (scenes, seeds) log ratios without a true change."""


@dataclass(frozen=True)
class Case:
    """Scenes and the variation of their sequences: standard deviations within and between scenes.

    `draw` draws log ratios; `loss` is the probability that a sequence is lost.
    """

    name: str
    scenes: int
    within: float
    between: float
    draw: Draw
    loss: float = LOSS

    @cached_property
    def seeds(self) -> int:
        """Number of seeds of each scene, as of `gate plan 10%`; DatasetError if none is enough."""
        wish = (CHANGE - TOLERANCE, RULES.level, RULES.power)
        seeds = seeds_needed(self.within, self.between, self.scenes, *wish)
        if seeds is None:
            raise DatasetError(f"{self.name}: no number of seeds finds a change of 10 %")
        return seeds

    @cached_property
    def power(self) -> float:
        """Nominal probability of finding the change."""
        error, degrees = design_error(self.within, self.between, self.scenes, self.seeds)
        critical = stats.t.ppf(1 - RULES.level, degrees)
        return float(stats.nct.sf(critical, degrees, (CHANGE - TOLERANCE) / error))


def modelled(scenes: int, within: float, between: float, loss: float = LOSS) -> Case:
    """Return a case of the model in the docstring of this module."""

    def draw(rng: np.random.Generator, scenes: int, seeds: int) -> Array:
        of_scene = between * rng.standard_normal((scenes, 1))
        if scenes < MIN_SCENES:
            of_scene -= of_scene.mean()
        width = rng.uniform(2 / 3, 4 / 3, (scenes, 1))
        width /= np.sqrt(np.mean(width**2))
        scale = within * np.sqrt((TAIL_DEGREES - 2) / TAIL_DEGREES)
        return of_scene + scale * width * rng.standard_t(TAIL_DEGREES, (scenes, seeds))

    name = f"{scenes} scenes, {100 * within:.0f} % within, {100 * between:.0f} % between"
    name += "" if loss == LOSS else f", {100 * loss:.0f} % lost"
    return Case(name, scenes, within, between if scenes >= MIN_SCENES else 0.0, draw, loss)


def resampled(path: Path) -> Case:
    """Return a case of the pairs in a JSON result of the gate; DatasetError if it is unusable."""
    try:
        drift = json.loads(path.read_text(encoding="utf-8"))["findings"][0]["change"]
        effect = Effect(np.array(drift["log_ratios"], dtype=float), tuple(drift["scenes"]))
    except (ValueError, KeyError, IndexError, TypeError, RecursionError):
        raise DatasetError(f"{path}: not a gate result") from None
    if len(set(effect.scenes)) < MIN_SCENES or not effect.within > 0:
        raise DatasetError(
            f"{path}: several different sequences of at least {MIN_SCENES} scenes are needed"
        )
    means, names = effect.scene_means - effect.mean, tuple(dict.fromkeys(effect.scenes))
    means *= effect.between / means.std(ddof=1)
    of_scene = np.array(effect.scenes)
    inflation = np.sqrt(len(effect.values) / (len(effect.values) - len(names)))
    residuals = [inflation * effect.residuals[of_scene == name] for name in names]

    def draw(rng: np.random.Generator, scenes: int, seeds: int) -> Array:
        chosen = rng.integers(len(names), size=scenes)
        return np.array([means[k] + rng.choice(residuals[k], seeds) for k in chosen])

    return Case(path.stem, len(names), effect.within, effect.between, draw)


CASES = (
    modelled(14, 0.12, 0.06),
    modelled(10, 0.08, 0.06),
    modelled(6, 0.08, 0.03),
    modelled(3, 0.10, 0.06),
    modelled(1, 0.10, 0.0),
    modelled(5, 0.05, 0.03),
    modelled(5, 0.05, 0.03, loss=0.1),
)


def _p(result: Any) -> bool:
    return bool(result.pvalue <= RULES.level)


def _t(values: Array) -> bool:
    return len(values) > 1 and _p(stats.ttest_1samp(values, 0.0, alternative="greater"))


def _wilcoxon(log_ratios: Array) -> bool:
    return _p(stats.wilcoxon(log_ratios.ravel(), alternative="greater"))


def _sign_flips(log_ratios: Array) -> bool:
    """Test by permutation: signs of scene means flipped at random."""
    means = log_ratios.mean(axis=1)
    signs = np.random.default_rng(0).choice((-1.0, 1.0), (FLIPS, len(means)))
    above = np.sum((signs * means).sum(axis=1) >= means.sum())
    return bool((1 + above) / (1 + FLIPS) <= RULES.level)


def _bootstrap(log_ratios: Array) -> bool:
    """Test by the BCa bootstrap of scene means."""
    means = log_ratios.mean(axis=1)
    if len(means) < 2:
        return False
    found = stats.bootstrap(
        (means,), np.mean, n_resamples=FLIPS, confidence_level=1 - 2 * RULES.level,
        method="BCa", rng=np.random.default_rng(0),
    )  # fmt: skip
    return bool(found.confidence_interval.low > 0)


TESTS: dict[str, Callable[[Array], bool]] = {
    "t, scenes": lambda log_ratios: _t(log_ratios.mean(axis=1)),
    "t, sequences": lambda log_ratios: _t(log_ratios.ravel()),
    "Wilcoxon, sequences": _wilcoxon,
    "sign flips, scenes": _sign_flips,
    "BCa, scenes": _bootstrap,
}
"""Other statistical tests, which docs/decisions/0015 compares with that of the gate."""


@dataclass(frozen=True)
class Rates:
    """False alarms, increases and weakened estimators found, %, as text with 95 % intervals.

    Of each other test, `others` has the first two.
    """

    case: Case
    alarms: str
    found: str
    weakened: str
    others: tuple[str, ...]


def simulate(
    cases: Sequence[Case],
    repetitions: int,
    seed: int,
    tests: Mapping[str, Callable[[Array], bool]],
    progress: Callable[[object], None],
) -> list[Rates]:
    """Repeat the gate's decision for drifts that increase by the tolerance, 10 % and 60 %.

    The last estimator also loses a sequence. Other tests have the same draws. Progress is called
    for each decision.
    """
    rates: list[Rates] = []
    for number, case in enumerate(cases):
        found: list[str] = []
        others: list[list[float]] = []
        for k, change in enumerate((TOLERANCE, CHANGE, WEAKENED)):
            rng = np.random.default_rng((seed, number, k))
            draws = [case.draw(rng, case.scenes, case.seeds) for _ in range(repetitions)]
            logs = [change + x for x in draws]
            alarms = 0
            for values in logs:
                decision = repeat(rng, values, case.loss, newly_lost=change == WEAKENED)
                alarms += decision.verdict is Verdict.REGRESS
                progress(values)
            interval = stats.binomtest(alarms, repetitions).proportion_ci()
            low, high = 100 * interval.low, 100 * interval.high
            found.append(f"{100 * alarms / repetitions:.1f} ({low:.1f}–{high:.1f})")
            above = [x - TOLERANCE for x in logs]
            others.append(
                [100 * float(np.mean([test(x) for x in above])) for test in tests.values()]
            )
        pairs = (f"{false:.1f} / {true:.0f}" for false, true in zip(*others[:2], strict=True))
        rates.append(Rates(case, *found, others=tuple(pairs)))
    return rates


def repeat(
    rng: np.random.Generator, log_ratios: Array, loss: float = LOSS, newly_lost: bool = False
) -> Decision:
    """Return the gate's decision for a candidate with given (scenes, seeds) log ratios of drift.

    `loss` is the probability that a sequence is lost; one can be lost by the candidate alone.
    """
    scenes, seeds = log_ratios.shape
    names = [f"scene {k}" for k in range(scenes) for _ in range(seeds)]
    drift = DRIFT_PERCENT * np.exp(0.5 * rng.standard_normal(scenes * seeds))
    before = [_measurement(rng, x, 0.0, loss) for x in drift]
    common = TIME_COMMON * rng.standard_normal()
    after = [_measurement(rng, x, common, loss) for x in drift * np.exp(log_ratios.ravel())]
    if newly_lost:
        k = int(rng.integers(len(names)))
        before[k] = before[k].model_copy(update={"lost_frames": 0})
        after[k] = after[k].model_copy(update={"lost_frames": FRAMES})
    return decide(RULES, names, before, after)


def _measurement(
    rng: np.random.Generator, drift_percent: float, log_time: float, loss: float
) -> Measurement:
    time = np.exp(log_time + TIME_EACH * rng.standard_normal())
    return Measurement(
        frames=FRAMES,
        lost_frames=FRAMES if rng.random() < loss else 0,
        drift_percent=float(drift_percent),
        frame_ms=float(10 * time),
        reference_ms=10.0,
        nees=float(np.exp(NEES_EACH * rng.standard_normal())),
    )
