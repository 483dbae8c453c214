"""Covariances that an estimator gives with its poses, and those of motions that follow from them.

A pose errs by what the map has drifted, which all later poses share, and by an error of its own in
the map, which no other pose has. So neither is the sum of the covariances of steps that of a long
motion, in which own errors count twice a step, nor the difference of those of two poses, in which
the own error of the first counts as negative.
"""

from dataclasses import dataclass

import numpy as np

from trials.evaluation.runs import SavedRun
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import TrajectoryError
from vo.runner import companion


@dataclass(frozen=True)
class Covariances:
    """Covariances of the N poses of a run; tangents (v m, w rad) in the camera's frame.

    Attributes:
        T_odom_cam: (N, 4, 4).
        poses: (N, 6, 6).
        steps: (N, 6, 6) of the motion since the pose before.
        drift: (N, 6, 6) of the part of its error that later poses keep.
    """

    T_odom_cam: Array
    poses: Array
    steps: Array
    drift: Array

    def of_motions(self, starts: Indices, ends: Indices) -> Array:
        """Covariances (K, 6, 6) of motions from poses to later ones, in the last camera's frame.

        Own errors of the first and of the last pose are in it: half those of the first step, which
        contain two, half those of the last, and the drift between. Of one step, it is the step's.
        """
        firsts, lasts = starts + 1, ends - 1
        steps, drift = (_transform(self.T_odom_cam, x) for x in (self.steps, self.drift))
        drift[0] = 0.0  # no motion needs it, and it may be unknown
        sums = np.cumsum(drift, axis=0)
        own = (steps[firsts] + drift[firsts] + steps[ends] + drift[ends]) / 2
        motions = own + sums[lasts] - sums[np.minimum(firsts, lasts)]
        motions[firsts == ends] = steps[ends[firsts == ends]]
        return _transform(se3.inverse(self.T_odom_cam[ends]), motions)


def _transform(T_b_a: Array, covariances_a: Array) -> Array:
    """Express covariances (N, 6, 6) of tangents in other frames, by transforms (N, 4, 4)."""
    pairs = zip(T_b_a, covariances_a, strict=True)
    found = [se3.transform_covariance(T, x) for T, x in pairs]
    return np.array(found).reshape(-1, 6, 6)


def read_covariances(run: SavedRun) -> Covariances:
    """Read `<stem>.covariance.npz` beside a trajectory.

    Raises:
        TrajectoryError: If there is none, or it lacks a pose.
    """
    path = companion(run.path, "covariance.npz")
    if not path.is_file():
        raise TrajectoryError(f"{run.path}: the estimator gave no covariances ({path.name})")
    with np.load(path) as file:
        names = "timestamp_ns", "pose", "step", "drift" if "drift" in file else "step"
        times, *values = (file[x] for x in names)
    posed = run.trajectory.timestamps_ns
    known = np.isin(posed, times)
    if not known.all():
        raise TrajectoryError(f"{path}: lacks frame {posed[~known][0]} ns")
    rows = np.searchsorted(times, posed)
    poses, steps, drift = (x[rows] for x in values)
    return Covariances(run.trajectory.T_ref_frame, poses, steps, drift)
