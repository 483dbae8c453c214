"""Steps from frame to frame that are wrong: by length or angle, in silence, beyond their sigmas."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, norm

from trials.evaluation.alignment import associate
from trials.evaluation.consistency import DEGREES, nees
from trials.evaluation.runs import SavedRun
from vo.contract import se3
from vo.contract.errors import TrajectoryError
from vo.contract.estimator import Status
from vo.contract.trajectory import Trajectory

WRONG_M, WRONG_DEG = 0.002, 0.2
"""Errors of a step above which it is wrong."""

SIGMAS = 5
"""Number of standard deviations beyond which no error should be."""

NEES_LIMIT = float(chi2.isf(2 * norm.sf(SIGMAS), DEGREES))
"""NEES that a step of right covariance exceeds as rarely as one number its five sigmas: 39.6."""


@dataclass(frozen=True)
class WrongSteps:
    """Numbers of steps between successive poses of a run, or of several.

    Attributes:
        steps: All whose two poses have a truth.
        wrong: Those with an error above `WRONG_M` or `WRONG_DEG`.
        silent: Wrong ones to a frame of status `tracked`.
        flagged: Steps to a frame of status `weak` that are not wrong.
        beyond: Those with an error beyond `SIGMAS` by their covariance.
        sized: Those that have a covariance.
    """

    steps: int = 0
    wrong: int = 0
    silent: int = 0
    flagged: int = 0
    beyond: int = 0
    sized: int = 0

    def __add__(self, other: "WrongSteps") -> "WrongSteps":
        """Add the numbers of other runs."""
        both = zip(vars(self).values(), vars(other).values(), strict=True)
        return WrongSteps(*(a + b for a, b in both))


def count_wrong_steps(truth: Trajectory, run: SavedRun) -> WrongSteps:
    """Count the wrong steps of a run; none with fewer than two poses that have a truth.

    A step to the first pose after lost frames counts too; its status is `start`.
    """
    try:
        pair = associate(truth, run.trajectory)
    except TrajectoryError:
        return WrongSteps()
    at = np.searchsorted(run.trajectory.timestamps_ns, pair.timestamps_ns)
    ends = np.flatnonzero(np.diff(at) == 1) + 1
    errors = se3.log(pair.motion_errors(ends - 1, ends))
    wrong = np.linalg.norm(errors[:, :3], axis=1) > WRONG_M
    if pair.has_attitude:
        wrong |= np.degrees(np.linalg.norm(errors[:, 3:], axis=1)) > WRONG_DEG
    status = np.full(len(pair.timestamps_ns), Status.TRACKED.value)
    if run.frames is not None:
        rows = np.searchsorted(run.frames.timestamps_ns, pair.timestamps_ns)
        status = np.array([x.value for x in run.frames.status])[rows]
    try:
        size = nees(truth, run).step[ends]
    except TrajectoryError:  # the estimator gives no covariances
        size = np.full(len(ends), np.nan)
    return WrongSteps(
        steps=len(ends),
        wrong=int(wrong.sum()),
        silent=int((wrong & (status[ends] == Status.TRACKED.value)).sum()),
        flagged=int((~wrong & (status[ends] == Status.WEAK.value)).sum()),
        beyond=int((size > NEES_LIMIT).sum()),
        sized=int(np.isfinite(size).sum()),
    )
