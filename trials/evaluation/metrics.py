"""Errors of an estimated trajectory against the truth, as arrays."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from trials.evaluation.alignment import Alignment, Pair, fit
from vo.contract import se3
from vo.contract.arrays import Array

KITTI_LENGTHS_M = (100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0)
ROBOT_LENGTHS_M = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)


@dataclass(frozen=True)
class RelativeErrors:
    """Errors inverse(true motion) @ estimated motion between K pairs of times.

    Attributes:
        start: (K,) index of the first time of each.
        length_m: (K,) true path between the two.
        translation_m: (K,) |t| of the error.
        rotation_rad: (K,) its angle.
    """

    start: Array
    length_m: Array
    translation_m: Array
    rotation_rad: Array

    def __len__(self) -> int:
        return len(self.start)

    @property
    def percent(self) -> Array:
        """(K,) translation error in % of the path."""
        return 100 * self.translation_m / self.length_m

    @property
    def deg_per_m(self) -> Array:
        """(K,) rotation error by the length of the path."""
        return np.degrees(self.rotation_rad) / self.length_m


def position_errors(pair: Pair, alignment: Alignment) -> Array:
    """Return the absolute trajectory error (N,): distance of aligned positions, metres.

    Raises:
        TrajectoryError: If a scale is requested and the estimate does not move.

    Source:
        Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012, sec. V.B.
    """
    T_world_est = fit(pair, alignment).map(pair.T_odom_cam)
    return np.linalg.norm(T_world_est[:, :3, 3] - pair.T_world_cam[:, :3, 3], axis=1)


def errors_over_time(pair: Pair, step: int = 1) -> RelativeErrors:
    """Return the relative pose error over `step` frames, from every frame.

    Source:
        Sturm et al., IROS 2012, eq. 1.
    """
    starts = np.arange(max(len(pair.timestamps_ns) - step, 0))
    return errors_between(pair, starts, starts + step)


def errors_between(pair: Pair, starts: Array, ends: Array) -> RelativeErrors:
    """Return the errors of the motions between K pairs of frames, given by (K,) indices."""
    length_m = pair.travelled_m[ends] - pair.travelled_m[starts]
    return _relative(starts, length_m, pair.motion_errors(starts, ends))


def errors_over_distance(pair: Pair, length_m: float) -> RelativeErrors:
    """Return the errors of motions over exactly `length_m` of true path, one per frame.

    A segment starts at frame i and ends where the true path, as a polyline through the true
    positions at the estimate's times, has grown by `length_m`. That point lies between two
    frames; truth and estimate are both interpolated there at the same fraction of the interval
    (linear in position, spherical in rotation). Frames closer to the end of the path than
    `length_m` start no segment. Each segment is compared from its own start, so no alignment is
    applied. **Drift over 1 m**, the headline of every table, is the mean of
    `translation_m / length_m` over all segments with `length_m` 1, in per cent.

    Source:
        Geiger et al., Are we ready for autonomous driving?, CVPR 2012; the benchmark's development
        kit ends a segment at the next frame and starts one every 10 frames.
    """
    travelled_m = pair.travelled_m
    starts = np.flatnonzero(travelled_m + length_m <= travelled_m[-1])
    target_m = travelled_m[starts] + length_m
    after = np.searchsorted(travelled_m, target_m, side="left")  # so travelled[after - 1] < target
    before_m = travelled_m[after - 1]
    position = after - 1 + (target_m - before_m) / (travelled_m[after] - before_m)
    true, estimated = (
        se3.inverse(T[starts]) @ se3.interpolate(np.arange(len(T)), T, position)
        for T in (pair.T_world_cam, pair.T_odom_cam)
    )
    return _relative(starts, np.full(len(starts), length_m), se3.inverse(true) @ estimated)


def joined(errors: Sequence[RelativeErrors]) -> RelativeErrors:
    """Concatenate the errors in one or more parts of a sequence."""
    return RelativeErrors(
        *(np.concatenate([getattr(x, field.name) for x in errors]) for field in fields(errors[0]))
    )


def segment_lengths_m(path_m: float) -> tuple[float, ...]:
    """Return segment lengths for a path: those of KITTI from 100 m on, below that 1 to 8 m."""
    lengths = KITTI_LENGTHS_M if path_m >= KITTI_LENGTHS_M[0] else ROBOT_LENGTHS_M
    return tuple(x for x in lengths if x <= path_m)


def _relative(starts: Array, length_m: Array, T_true_estimated: Array) -> RelativeErrors:
    translation_m = np.linalg.norm(T_true_estimated[:, :3, 3], axis=1)
    return RelativeErrors(starts, length_m, translation_m, se3.rotation_angle(T_true_estimated))
