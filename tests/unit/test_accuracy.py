"""The statistics behind `make accuracy`."""

import numpy as np
import pytest

from trials.accuracy import bootstrap_interval
from trials.drives import fingerprint


def test_interval_of_equal_drives_is_a_point():
    assert bootstrap_interval(np.full(5, 0.07)) == (0.07, 0.07)


def test_interval_lies_within_the_drives_and_holds_their_median():
    values = np.array([0.05, 0.09, 0.06, 0.11, 0.07])
    low, high = bootstrap_interval(values)
    assert values.min() <= low <= np.median(values) <= high <= values.max()


@pytest.mark.parametrize("drives", [25, 100])
def test_interval_covers_the_true_median_as_often_as_it_says(drives):
    rng = np.random.default_rng(drives)
    covered = 0
    for _ in range(60):
        low, high = bootstrap_interval(rng.exponential(size=drives))
        covered += low <= np.log(2) <= high  # the median of an exponential distribution
    assert 50 <= covered < 60


def test_fingerprint_is_of_the_sources_alone():
    assert fingerprint() == fingerprint()
    assert len(fingerprint()) == 12
