"""What experiments measure on a run, beside its score."""

import numpy as np

from trials.evaluation.alignment import Alignment, fit
from trials.evaluation.metrics import errors_over_time
from trials.execution.jobs import Result
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import TrajectoryError
from vo.contract.estimator import Status

BROKEN_M = 0.05
"""Error of a step, metres, that is no drift any more: some three times the step itself."""


def step_errors_m(result: Result) -> Array:
    """Error (N,) of the motion from the last pose to each frame's; NaN for frames without."""
    errors = np.full(len(result.frames), np.nan)
    try:
        found = errors_over_time(result.pair)
    except TrajectoryError:
        return errors
    ends = result.pair.timestamps_ns[1:]
    errors[np.searchsorted(result.frames.timestamps_ns, ends)] = found.translation_m
    return errors


def breaks_at(result: Result) -> int | None:
    """First frame that is lost or whose step is wrong beyond drift; None if there is none."""
    lost = np.array([status is Status.LOST for status in result.frames.status])
    with np.errstate(invalid="ignore"):
        broken = lost | (step_errors_m(result) > BROKEN_M)
    return int(np.argmax(broken)) if broken.any() else None


def survived(result: Result) -> float:
    """Share of the drive before it breaks."""
    end = breaks_at(result)
    return 1.0 if end is None else end / len(result.frames)


def paths_m(result: Result) -> tuple[Array, Array]:
    """True and estimated positions (N, 3) in the world, first poses aligned."""
    pair = result.pair
    aligned = fit(pair, Alignment.FIRST_POSE).map(pair.T_odom_cam)
    return pair.T_world_cam[:, :3, 3], aligned[:, :3, 3]


def pitch_deg(T_world_cam: Array) -> Array:
    """Angle (N,) of optical axes above the horizon, degrees, for poses (N, 4, 4)."""
    return np.degrees(np.arcsin(np.clip(T_world_cam[:, 2, 2], -1, 1)))


def aligned_poses(result: Result) -> tuple[Array, Array]:
    """True and estimated T_world_cam (N, 4, 4), first poses aligned."""
    pair = result.pair
    return pair.T_world_cam, fit(pair, Alignment.FIRST_POSE).map(pair.T_odom_cam)


def turn_rate_deg_s(result: Result) -> Array:
    """How fast (N,) the camera truly turned up to each frame; 0 at the first."""
    T = result.truth.at(result.frames.timestamps_ns).T_ref_frame
    turn = se3.rotation_angle(se3.inverse(T[:-1]) @ T[1:])
    return np.concatenate([[0.0], np.degrees(turn) / np.diff(result.time_s)])


def track_lengths(landmark: Indices) -> Indices:
    """Number of frames that saw each landmark, for observations' landmarks (K,)."""
    return np.unique(landmark, return_counts=True)[1]
