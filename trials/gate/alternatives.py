"""Other statistical tests, which docs/decisions/0015 compares with that of the gate."""

from collections.abc import Callable

import numpy as np
from scipy import stats

from trials.gate.rules import Rules
from vo.contract.arrays import Array

LEVEL = Rules().level
FLIPS = 999


def t_of_scenes(log_ratios: Array) -> bool:
    """Student's t-test of scene means, as in the gate with five scenes or more."""
    return _t(log_ratios.mean(axis=1))


def t_of_sequences(log_ratios: Array) -> bool:
    """Student's t-test of all sequences, as if they were independent."""
    return _t(log_ratios.ravel())


def wilcoxon(log_ratios: Array) -> bool:
    """Wilcoxon signed-rank test of all sequences."""
    return _p(stats.wilcoxon(log_ratios.ravel(), alternative="greater")) <= LEVEL


def sign_flips(log_ratios: Array) -> bool:
    """Permutation test: signs of scene means flipped at random."""
    means = log_ratios.mean(axis=1)
    signs = np.random.default_rng(0).choice((-1.0, 1.0), (FLIPS, len(means)))
    return bool((1 + np.sum((signs * means).sum(axis=1) >= means.sum())) / (1 + FLIPS) <= LEVEL)


def bootstrap(log_ratios: Array) -> bool:
    """BCa bootstrap of scene means."""
    means = log_ratios.mean(axis=1)
    if len(means) < 2:
        return False
    found = stats.bootstrap(
        (means,), np.mean, n_resamples=FLIPS, confidence_level=1 - 2 * LEVEL,
        method="BCa", rng=np.random.default_rng(0),
    )  # fmt: skip
    return bool(found.confidence_interval.low > 0)


TESTS: dict[str, Callable[[Array], bool]] = {
    "t, scenes": t_of_scenes,
    "t, sequences": t_of_sequences,
    "Wilcoxon, sequences": wilcoxon,
    "sign flips, scenes": sign_flips,
    "BCa, scenes": bootstrap,
}


def _t(values: Array) -> bool:
    if len(values) < 2:
        return False
    return _p(stats.ttest_1samp(values, 0.0, alternative="greater")) <= LEVEL


def _p(result: object) -> float:
    return float(np.asarray(result)[1])
