"""Mismatches of estimate and truth: other frames, conventions and clocks."""

import numpy as np
import pytest

from trials.evaluation.alignment import Pair
from trials.evaluation.mismatch import Frame, frame_mismatch
from trials.evaluation.time_shift import find_time_shift
from vo.contract import se3
from vo.contract.trajectory import Trajectory

TIMES_NS = 5 * 10**9 + 50_000_000 * np.arange(200)
T_BODY_CAM = se3.pose(np.array([[0, 0, 1.0], [-1, 0, 0], [0, -1, 0]]), np.array([0.1, 0.2, 0.3]))


def motion(times_ns, noise=0.0):
    """A drive with turns of varying rate about two axes; poses of a camera that looks ahead."""
    s = (times_ns - TIMES_NS[0]) / 1e9
    turns = np.stack([0.1 * np.sin(1.7 * s), 0.6 * np.sin(0.9 * s) + 0.2 * np.sin(3 * s), 0 * s], 1)
    T = se3.exp(np.concatenate([0 * turns, turns], axis=1))
    T[:, :3, 3] = np.stack([0.3 * np.sin(0.9 * s), 0 * s, 0.3 * s], axis=1)
    rng = np.random.default_rng(1)
    return T @ se3.exp(
        rng.normal(scale=noise * np.array([1, 1, 1, 0.3, 0.3, 0.3]), size=(len(s), 6))
    )


def found(T_odom_est):
    pair = Pair(TIMES_NS, motion(TIMES_NS), T_odom_est)
    return frame_mismatch(pair, T_BODY_CAM, Frame.BODY)


@pytest.mark.parametrize(
    ("convert", "message"),
    [
        (lambda T: T @ se3.inverse(T_BODY_CAM), "those of the body; use --frame body"),
        (lambda T: T_BODY_CAM @ T @ se3.inverse(T_BODY_CAM), "those of the body"),
        (lambda T: reordered(T, [3, 0, 1, 2]), "in the order w, x, y, z"),
        (lambda T: reordered(T, [1, 2, 3, 0]), "in the order x, y, z, w"),
        (se3.inverse, "fit when inverted"),
        (
            lambda T: se3.pose(T[:, :3, :3], 1000 * T[:, :3, 3]),
            "multiplied by 0.00.*; are they",
        ),
        (lambda T: se3.pose(T[:, :3, :3], T[:, :3, 3] / 3.28), r"multiplied by 3\.\d*; are"),
        (
            lambda T: T @ se3.pose(np.eye(3), np.array([0.3, 0, 0])),
            r"turned by 0.\d° .* 0.30 m away",
        ),
        (
            lambda T: T @ se3.exp(np.array([0, 0, 0, 0, 0, 1.0])),
            r"turned by 57.\d° .* 0.0\d m away",
        ),
    ],
)
@pytest.mark.parametrize("noise", [0, 0.005])
def test_constant_mismatch_is_described(convert, message, noise):
    import re

    assert re.search(message, found(convert(motion(TIMES_NS, noise))))


def reordered(T, order):
    return se3.from_quat_wxyz(se3.to_quat_wxyz(T)[:, order], T[:, :3, 3])


def test_errors_of_an_estimator_are_no_mismatch():
    T = motion(TIMES_NS)
    assert found(T) == ""
    assert found(motion(TIMES_NS, noise=0.05)) == ""
    T_drifted, T_scaled = T.copy(), T.copy()
    T_drifted[:, :3, 3] += np.outer(np.linspace(0, 1, len(T)), [0.3, 0.1, 0.5])
    T_scaled[:, :3, 3] *= 1.3
    assert found(T_drifted) == found(T_scaled) == ""


@pytest.mark.parametrize("shift_ms", [-700, -30, 20, 50, 333])
def test_time_shift_is_found_within_a_few_milliseconds(shift_ms):
    truth = Trajectory(TIMES_NS, motion(TIMES_NS))
    T_odom_body = motion(TIMES_NS, noise=0.0005) @ T_BODY_CAM
    shift = find_time_shift(truth, Trajectory(TIMES_NS - shift_ms * 1_000_000, T_odom_body))
    assert shift.shift_s == pytest.approx(shift_ms / 1e3, abs=0.004)
    assert f"{shift_ms}"[1:2] in str(shift)
    assert ("early" if shift_ms > 0 else "late") in str(shift)


def test_time_shift_of_an_aligned_or_straight_estimate_is_none():
    truth = Trajectory(TIMES_NS, motion(TIMES_NS))
    assert find_time_shift(truth, Trajectory(TIMES_NS, motion(TIMES_NS, 0.002))) is None
    T = np.tile(np.eye(4), (len(TIMES_NS), 1, 1))
    T[:, 2, 3] = 0.01 * np.arange(len(T))
    straight = Trajectory(TIMES_NS, T)
    assert find_time_shift(straight, Trajectory(TIMES_NS - 100_000_000, T)) is None
