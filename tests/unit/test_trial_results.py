"""Metrics of trials against numbers worked out by hand, and intervals against SciPy's."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from trials.gym.studies.trial_results import METRICS, TrialResult, proportion_interval, summarize

GOOD = TrialResult(
    layout=1,
    run=0,
    localization="vo",
    outcome="success",
    time_s=30.0,
    driven_m=5.0,
    way_m=4.0,
    left_m=0.3,
    optimal_s=8.0,
    error_m=0.02,
    drift_percent=0.5,
    lost_share=0.0,
)


def test_metrics_of_success_and_failure_match_hand_computation():
    assert GOOD.spl == pytest.approx(4 / 5)
    assert GOOD.soft_spl == pytest.approx(4 / 5)
    assert GOOD.barn == pytest.approx(8 / 30)
    assert replace(GOOD, time_s=10.0).barn == pytest.approx(1 / 2)  # no more for being faster
    assert replace(GOOD, time_s=100.0).barn == pytest.approx(1 / 8)  # no less for being slower
    assert replace(GOOD, driven_m=3.9).spl == 1.0
    failed = replace(GOOD, outcome="collision", left_m=1.0, driven_m=3.0)
    assert (failed.spl, failed.barn, failed.success, failed.collision) == (0, 0, 0, 1)
    assert failed.soft_spl == pytest.approx(0.75)
    assert replace(failed, left_m=6.0).soft_spl == 0.0  # further away than at the start


@pytest.mark.parametrize(("ones", "n"), [(0, 5), (3, 7), (50, 50), (47, 50)])
def test_proportion_interval_is_wilsons(ones, n):
    values = np.array([1.0] * ones + [0.0] * (n - ones))
    ours = proportion_interval(values)
    theirs = stats.binomtest(ones, n).proportion_ci(method="wilson")
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=1e-12)
    assert ours.value == ones / n


def test_summarize_formats_every_metric():
    table = summarize([GOOD, replace(GOOD, outcome="timeout", time_s=120.0)], METRICS)
    assert table["success"].startswith("0.50 (0.09 to 0.91)")
    assert table["SPL"].startswith("0.40 (")
    assert table["time s"].startswith("75.0 (")
