"""Metrics of trials against numbers worked out by hand, and Wilson's intervals."""

from dataclasses import replace

import pytest

from trials.gym.studies.trial_results import METRICS, TrialResult, outcome_interval, summarize

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
    assert (failed.spl, failed.barn, failed.success) == (0, 0, False)
    assert failed.soft_spl == pytest.approx(0.75)
    assert replace(failed, left_m=6.0).soft_spl == 0.0  # further away than at the start


@pytest.mark.parametrize(
    ("ones", "n", "low", "high"),
    [
        (0, 5, 0, 0.43448),
        (3, 7, 0.15822, 0.74955),
        (50, 50, 0.92865, 1),
        (47, 50, 0.83782, 0.97939),
    ],
)
def test_outcome_interval_is_wilsons(ones, n, low, high):
    trials = [replace(GOOD, outcome="collision")] * ones + [GOOD] * (n - ones)
    found = outcome_interval(trials, "collision")
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-5)
    assert found.value == ones / n


def test_summarize_formats_every_metric():
    table = summarize([GOOD, replace(GOOD, outcome="timeout", time_s=120.0)], METRICS)
    assert table["success"].startswith("0.50 (0.09 to 0.91)")
    assert table["SPL"].startswith("0.40 (")
    assert table["time s"].startswith("75.0 (")
