"""A constant time shift between estimate and truth, found by correlating rotation rates."""

from dataclasses import dataclass

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.trajectory import NS_PER_S, Trajectory

MAX_SHIFT_S = 2.0
"""Largest shift that is looked for, s; at most a quarter of the sequence."""

STEPS = 8
"""Number of shifts that are tried in the time between two poses of the estimate."""

MIN_WINDOW_S, MAX_POSES = 0.04, 20_000
"""Time between poses that are used, s, and their number: a quarter of an hour."""

MAX_GAP = 5
"""Longest time between poses that has a rotation rate, in multiples of the median."""

MIN_RATES = 16
"""Number of rates below which nothing is correlated."""

MIN_CORRELATION, MAX_REST = 0.8, 0.5
"""A shift is found if it leaves at most this share of the unexplained variance, and this much is
explained."""

MIN_SHIFT_S = 0.004
"""Smallest shift that is found, s: interpolation between poses moves the maximum by up to that."""

MIN_RATE_RAD_S = 0.01
"""Standard deviation of rotation rates, rad/s, below which they show no shift."""


@dataclass(frozen=True)
class TimeShift:
    """Time to add to the estimate's timestamps, s; correlation of rates with and without it."""

    shift_s: float
    correlation: float
    unshifted: float

    def __str__(self) -> str:
        text = f"{1e3 * abs(self.shift_s):.0f} ms too {'late' if self.shift_s < 0 else 'early'}"
        return (
            f"its timestamps are {text}: so corrected, its rotation rates fit the truth "
            f"(correlation {self.correlation:.3f} instead of {self.unshifted:.3f})"
        )


def find_time_shift(truth: Trajectory, estimate: Trajectory) -> TimeShift | None:
    """Find a constant shift of time; None if rotation rates show none, or do not vary.

    Magnitudes of rotation rates are the same in all frames that are fixed to the camera.
    """
    if truth.point_cam is not None or min(len(truth), len(estimate)) < MIN_RATES:
        return None
    start = int(truth.timestamps_ns[0])
    known, times = ((x.timestamps_ns - start) / NS_PER_S for x in (truth, estimate))
    thinned = slice(None, None, max(1, int(MIN_WINDOW_S / np.median(np.diff(times)))))
    times, T_odom_est = times[thinned][:MAX_POSES], estimate.T_ref_frame[thinned][:MAX_POSES]
    if len(times) < MIN_RATES:
        return None
    window = float(np.median(np.diff(times)))
    middles, rates = _rates(times, T_odom_est)
    reach_s = min(MAX_SHIFT_S, (times[-1] - times[0]) / 4)
    first, last = max(0, times[0] - reach_s), min(known[-1], times[-1] + reach_s)
    grid = np.arange(first, last - window, window / STEPS)
    if len(grid) < MIN_RATES * STEPS:
        return None
    ends = (se3.interpolate(known, truth.T_ref_frame, grid + x) for x in (0, window))
    true = se3.rotation_angle(se3.inverse(next(ends)) @ next(ends)) / window
    steps = np.diff(known, append=known[-1])
    gaps = steps > max(MAX_GAP * np.median(steps), window)
    true[gaps[np.searchsorted(known, grid, side="right") - 1]] = np.nan
    reach = int(STEPS * reach_s / window)
    shifts = np.arange(-reach, reach + 1) * window / STEPS
    grid += window / 2
    shifted = (np.interp(middles + x, grid, true, np.nan, np.nan) for x in shifts)
    found = np.array([_correlation(rates, x) for x in shifted])
    best = int(np.argmax(found))
    shift_s, correlation = _vertex(shifts, found, best)
    unshifted = float(found[reach])
    is_better = 1 - correlation**2 < MAX_REST * (1 - max(unshifted, 0) ** 2)
    if abs(shift_s) < MIN_SHIFT_S or correlation < MIN_CORRELATION or not is_better:
        return None
    return TimeShift(shift_s, correlation, unshifted)


def _rates(times: Array, T: Array) -> tuple[Array, Array]:
    """Return middles (K,) of the steps without a gap and their rotation rates, rad/s."""
    steps = np.diff(times)
    rates = se3.rotation_angle(se3.inverse(T[:-1]) @ T[1:]) / steps
    near = steps < MAX_GAP * np.median(steps)
    return ((times[:-1] + times[1:]) / 2)[near], rates[near]


def _correlation(a: Array, b: Array) -> float:
    """Return the correlation of (K,) rates where both are known; -1 if that tells nothing."""
    both = np.isfinite(b)
    if both.sum() < max(MIN_RATES, len(a) / 2):
        return -1.0
    if min(a[both].std(), b[both].std()) < MIN_RATE_RAD_S:
        return -1.0
    return float(np.corrcoef(a[both], b[both])[0, 1])


def _vertex(x: Array, y: Array, k: int) -> tuple[float, float]:
    """Return abscissa and ordinate of the parabola's vertex at the maximum y[k] of even steps."""
    if not 0 < k < len(x) - 1 or min(y[k - 1], y[k + 1]) < 0:
        return float(x[k]), float(y[k])
    down, up = y[k] - y[k - 1], y[k] - y[k + 1]
    offset = (down - up) / (2 * (down + up)) if down + up > 0 else 0.0
    return float(x[k] + offset * (x[1] - x[0])), float(min(y[k] + (down - up) * offset / 4, 1.0))
