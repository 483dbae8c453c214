"""Guard around a plug-in: a frame on which it raises is lost, and the sequence continues."""

from typing import Any

import numpy as np

from trials.estimators.plugins import PluginError
from vo.contract.arrays import Array
from vo.contract.estimator import Estimate, Estimator, Finalizing, FinalResult, Status
from vo.contract.sequence import StereoFrame

MAX_FAILURES = 20
"""Largest number of consecutive frames on which an estimator may fail."""

RIGID = 1e-3
"""Largest difference of R R^T of a pose from the identity."""


class Guarded:
    """Estimator that turns exceptions and invalid estimates of another one into lost frames.

    Attributes:
        failures: Number of frames lost in this way.
        complaint: Exception of `finalize`, as text; empty if there was none.
    """

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._consecutive = 0
        self.failures = 0
        self.complaint = ""

    def track(self, frame: StereoFrame) -> Estimate:
        """Track a frame; an exception becomes the reason of a lost frame.

        Raises:
            PluginError: After more than MAX_FAILURES consecutive failures.
        """
        try:
            estimate = _checked(self._estimator.track(frame), frame)
        except Exception as error:
            self.failures += 1
            self._consecutive += 1
            reason = _described(error)
            if self._consecutive > MAX_FAILURES:
                raise PluginError(
                    f"the estimator failed on {self._consecutive} frames in a row, the last at "
                    f"{frame.timestamp_ns} ns: {reason}"
                ) from error
            return Estimate(frame.timestamp_ns, Status.LOST, None, reason)
        self._consecutive = 0
        return estimate

    def finalize(self) -> FinalResult:
        """Finalize the estimator; an empty result if it cannot or fails."""
        if not isinstance(self._estimator, Finalizing):
            return FinalResult()
        try:
            return self._estimator.finalize()
        except Exception as error:
            self.complaint = _described(error)
            return FinalResult()


def _checked(estimate: Any, frame: StereoFrame) -> Estimate:
    if not isinstance(estimate, Estimate):
        raise TypeError(f"track returned {type(estimate).__name__} instead of an Estimate")
    if estimate.timestamp_ns != frame.timestamp_ns:
        raise ValueError(f"the estimate is of {estimate.timestamp_ns} ns")
    if estimate.T_odom_cam is not None and not _is_rigid(estimate.T_odom_cam):
        raise ValueError("T_odom_cam is not a rigid 4x4 transform")
    return estimate


def _is_rigid(T: Array) -> bool:
    if np.shape(T) != (4, 4) or not np.isfinite(T).all():
        return False
    R = T[:3, :3]
    straight = np.allclose(R @ R.T, np.eye(3), atol=RIGID) and np.linalg.det(R) > 0
    return bool(straight and np.allclose(T[3], [0, 0, 0, 1]))


def _described(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
