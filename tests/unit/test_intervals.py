"""Intervals against SciPy's own and by hand."""

import numpy as np
import pytest
from scipy import stats

from trials.evaluation.intervals import mean_interval, median_interval, ratio_interval


def test_mean_interval_is_students():
    values = np.random.default_rng(3).normal(2.0, 0.5, 9)
    found = mean_interval(values)
    expected = stats.ttest_1samp(values, 0).confidence_interval(0.95)
    assert found.value == pytest.approx(values.mean())
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))


def test_mean_interval_ignores_nan():
    assert mean_interval(np.array([1.0, np.nan, 3.0])).value == 2.0
    lone = mean_interval(np.array([np.nan, 5.0]))
    assert lone.value == 5.0
    assert np.isnan(lone.low)
    assert lone.text(1) == "5.0"
    assert mean_interval(np.full(2, np.nan)).text() == "–"


def test_mean_interval_is_clipped_to_the_possible_range():
    free = mean_interval(np.array([1.0, 3.0]))
    assert free.low < 0 < 5 < free.high
    held = mean_interval(np.array([1.0, 3.0]), minimum=0, maximum=5)
    assert (held.value, held.low, held.high) == (2.0, 0, 5)


def test_ratio_interval_is_paired_and_geometric():
    found = ratio_interval(np.array([2.0, 8.0]), np.array([1.0, 1.0]))
    assert found.value == pytest.approx(4.0)
    # log ratios ln 2 and ln 8: mean ln 4, standard error ln 2, Student's factor for one degree
    reach = np.exp(stats.t.ppf(0.975, 1) * np.log(2))
    assert (found.low, found.high) == pytest.approx((4 / reach, 4 * reach))


def test_ratio_interval_ignores_pairs_with_nan():
    found = ratio_interval(np.array([2.0, np.nan, 3.0]), np.array([1.0, 1.0, 0.0]))
    assert found.value == pytest.approx(2.0)
    assert np.isnan(found.high)


def test_mean_interval_has_its_nominal_coverage():
    rng = np.random.default_rng(5)
    hits = 0
    for _ in range(400):
        found = mean_interval(rng.normal(1.0, 2.0, 4))
        hits += found.low <= 1.0 <= found.high
    assert 0.92 < hits / 400 < 0.98


def test_median_interval_is_over_drives_and_runs():
    drives = [np.array([1.0, 2.0, 9.0]), np.array([4.0]), np.array([5.0, 7.0])]
    found = median_interval(drives)
    assert found.value == 4.0  # of the medians 2, 4 and 6
    assert 1.0 <= found.low < 4.0 < found.high <= 9.0
    runs_of_one = median_interval(drives[:1])
    assert (runs_of_one.value, runs_of_one.low, runs_of_one.high) == (2.0, 1.0, 9.0)
    assert median_interval([np.array([3.0])]).text(1) == "3.0"
    assert median_interval([]).text() == "–"
