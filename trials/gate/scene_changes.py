"""Change of the drift in each scene, and which scenes regressed, at a false discovery rate.

A gate asks whether drift increased on average; over many scenes some increase by chance. Each
scene's mean log ratio is tested with a variance that is moderated by those of the other scenes,
as a few seeds alone do not determine it, and the p-values are adjusted for their number.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import brentq
from scipy.special import digamma, polygamma

from trials.gate.baseline import Measurement, Rules
from vo.contract.arrays import Array

MAX_DEGREES = 10
"""Largest degrees of freedom of a moderated variance, as a multiple of those of a scene.

More would claim Gaussian tails: of 100 scenes with two seeds each, without any change, 17 % of the
gates name one if log ratios have the tails of Student's t with four degrees of freedom.
"""
MIN_VARIANCE_RATIO = 1e-5
"""Smallest variance of a scene over the median of all; pairs may change by exactly the same."""


@dataclass(frozen=True)
class SceneChange:
    """Change of the drift in one scene.

    Attributes:
        pairs: Number of sequences that neither estimator loses.
        newly_lost: Number of sequences that only the candidate loses.
        before: Geometric mean of the drift of the baseline over these pairs, %; NaN without.
        mean: Mean log ratio of the pairs; NaN without.
        p: Probability of such a mean if drift grew by the tolerance; NaN if variances are unknown.
        q: Smallest false discovery rate at which the scene counts as a discovery.
        has_regressed: Whether `q` is within the level of the rules.
    """

    scene: str
    pairs: int
    newly_lost: int
    before: float
    mean: float
    p: float
    q: float
    has_regressed: bool

    @property
    def verdict(self) -> str:
        """`regress`; `lost` if no pair is left since the candidate loses them; else empty."""
        if self.has_regressed:
            return "regress"
        return "lost" if self.newly_lost and not self.pairs else ""


def scene_changes(
    rules: Rules,
    scenes: Sequence[str],
    before: Sequence[Measurement],
    after: Sequence[Measurement],
) -> list[SceneChange]:
    """Compare N sequences by their scenes; the level of the rules is the false discovery rate.

    Source:
        Benjamini and Hochberg, Controlling the false discovery rate, JRSS B 57, 1995.
    """
    was, now = (np.array([x.log_drift for x in side]) for side in (before, after))
    lost = np.array([b.is_lost and not a.is_lost for a, b in zip(before, after, strict=True)])
    rows = {name: np.array([x == name for x in scenes]) for name in dict.fromkeys(scenes)}
    values = [(now - was)[of] for of in rows.values()]
    known = [x[np.isfinite(x)] for x in values]
    p = moderated_p(known, float(np.log1p(rules.drift_tolerance)))
    q = np.full(len(p), np.nan)
    tested = np.isfinite(p)
    if tested.any():
        q[tested] = stats.false_discovery_control(p[tested])
    return [
        SceneChange(
            name, len(x), int(lost[of].sum()),
            float(np.exp(was[of & np.isfinite(now - was)].mean())) if len(x) else np.nan,
            float(x.mean()) if len(x) else np.nan, float(p[k]), float(q[k]),
            bool(q[k] <= rules.level),
        )
        for k, ((name, of), x) in enumerate(zip(rows.items(), known, strict=True))
    ]  # fmt: skip


def moderated_p(values: Sequence[Array], null: float) -> Array:
    """Compute the p-value of each sample's mean against `null` or less, by a moderated t-test.

    A sample without any difference has p = 1. NaN where there is none, or no sample has a variance.

    Args:
        values: S samples (N_s,), N_s >= 0.
        null: At least 0.

    Source:
        Smyth, Linear models and empirical Bayes methods, Stat. Appl. Genet. Mol. Biol. 3, 2004.
    """
    counts = np.array([len(x) for x in values])
    same = np.array([len(x) > 0 and not x.any() for x in values], dtype=bool)
    repeated = (counts > 1) & ~same
    p = np.where(same, 1.0, np.nan)
    if not repeated.any():
        return p
    degrees = np.maximum(counts - 1, 0)
    variances = np.array(
        [x.var(ddof=1) if ok else 0.0 for x, ok in zip(values, repeated, strict=True)]
    )
    floor = MIN_VARIANCE_RATIO * np.median(variances[repeated])
    variances = np.maximum(variances, max(floor, np.finfo(float).tiny))
    prior, prior_degrees = _prior(variances[repeated], degrees[repeated])
    most = MAX_DEGREES * float(np.median(degrees[repeated]))
    for k in np.flatnonzero(~same & (counts > 0)).tolist():
        own = degrees[k]
        total = prior_degrees + own
        if total <= 0:
            continue
        share = own / total if np.isfinite(total) else 0.0
        error = np.sqrt((share * variances[k] + (1 - share) * prior) / counts[k])
        p[k] = stats.t.sf((values[k].mean() - null) / error, min(total, max(most, own)))
    return p


def _prior(variances: Array, degrees: Array) -> tuple[float, float]:
    """Fit (K,) variances by a scaled inverse chi-squared; return scale and degrees of freedom.

    With one variance the degrees are 0; without excess of their differences over chance, infinite.
    """
    logs = np.log(variances) - digamma(degrees / 2) + np.log(degrees / 2)
    if len(logs) < 2:
        return 0.0, 0.0
    excess = float(logs.var(ddof=1) - polygamma(1, degrees / 2).mean())
    if excess <= 0:
        return float(np.exp(logs.mean())), np.inf
    half = np.exp(brentq(lambda x: float(polygamma(1, np.exp(x))) - excess, -20.0, 20.0))
    return float(np.exp(logs.mean() + digamma(half) - np.log(half))), 2 * float(half)
