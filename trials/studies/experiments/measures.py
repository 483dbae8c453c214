"""Measures of runs, in addition to their score."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from trials.evaluation.alignment import Alignment, fit
from trials.evaluation.intervals import mean_interval
from trials.evaluation.metrics import errors_over_time
from trials.execution.jobs import Result, Results, Variant
from trials.report.figure import GREY
from vo.contract import se3
from vo.contract.arrays import Array, Mask
from vo.contract.errors import TrajectoryError
from vo.contract.estimator import Status

FAILURE_M = 0.05
"""Error of a step, metres, above which the frame has failed: about three times the step."""


def mean_text(values: Array, digits: int = 3) -> str:
    """Format the mean of non-negative values (N,) with its interval."""
    return mean_interval(values, minimum=0).text(digits)


def lost_text(results: Results, variant: Variant) -> str:
    """Format the fraction of frames without a pose over all runs of a variant, %."""
    return f"{100 * float(np.mean([x.lost_share for x in results.of(variant)])):.1f}"


def step_errors_m(result: Result) -> Array:
    """Return the error (N,) of the motion from the last pose; NaN for frames without a pose."""
    errors = np.full(len(result.frames), np.nan)
    try:
        found = errors_over_time(result.pair)
    except TrajectoryError:
        return errors
    ends = result.pair.timestamps_ns[1:]
    errors[np.searchsorted(result.frames.timestamps_ns, ends)] = found.translation_m
    return errors


def failures(result: Result) -> Mask:
    """Return which frames (N,) are lost, or have a step error above FAILURE_M."""
    lost = np.array([status is Status.LOST for status in result.frames.status])
    return lost | (step_errors_m(result) > FAILURE_M)


def first_failure(result: Result) -> int | None:
    """Return the first frame that fails; None if there is none."""
    failed = failures(result)
    return int(np.argmax(failed)) if failed.any() else None


def tracked_fraction(result: Result) -> float:
    """Return the fraction of frames before the first failure."""
    end = first_failure(result)
    return 1.0 if end is None else end / len(result.frames)


def aligned_poses(result: Result) -> tuple[Array, Array]:
    """Return true and estimated T_world_cam (N, 4, 4), first poses aligned."""
    pair = result.pair
    return pair.T_world_cam, fit(pair, Alignment.FIRST_POSE).map(pair.T_odom_cam)


def paths_m(result: Result) -> tuple[Array, Array]:
    """Return true and estimated positions (N, 3) in the world, first poses aligned."""
    truth, estimate = (T[:, :3, 3] for T in aligned_poses(result))
    return truth, estimate


def turn_rate_deg_s(result: Result) -> Array:
    """Return the true turn rate (N,) of the camera up to each frame; 0 at the first."""
    T = result.truth.at(result.frames.timestamps_ns).T_ref_frame
    turn = se3.rotation_angle(se3.inverse(T[:-1]) @ T[1:])
    return np.concatenate([[0.0], np.degrees(turn) / np.diff(result.time_s)])


def draw_turn_rate(panel: Axes, x: Array, rate_deg_s: Array, top_deg_s: float) -> None:
    """Shade the turn rate (N,) over x on a second axis up to a value."""
    turning = panel.twinx()
    turning.fill_between(x, rate_deg_s, color=GREY, alpha=0.25)
    turning.set_ylabel("turn rate, °/s", color=GREY)
    turning.tick_params(labelsize=8, colors=GREY)
    turning.set_ylim(0, top_deg_s)


def draw_means(panel: Axes, runs: Mapping[float, Array], colour: str) -> None:
    """Draw the values (N,) of all runs at every x as dots, and their means as a line."""
    means = [mean_interval(values).value for values in runs.values()]
    panel.plot(list(runs), means, color=colour, lw=1.5)
    for x, values in runs.items():
        panel.plot(np.full(len(values), x), values, "o", color=colour, ms=3, alpha=0.5)
