"""An estimator that may fail: a frame on which it raises is lost, and the sequence goes on."""

from typing import Any

import numpy as np

from trials.estimators.plugins import PluginError
from vo.contract.arrays import Array
from vo.contract.estimator import Estimate, Estimator, Finalizing, FinalResult, Status
from vo.contract.sequence import StereoFrame

MOST_CRASHES = 20
"""Frames in a row on which an estimator may fail; after that it is broken, not unlucky."""

RIGID = 1e-3
"""Most that R R^T of a pose may differ from the identity."""


class Guarded:
    """Passes frames to an estimator, and turns exceptions and unusable answers into lost frames.

    Attributes:
        crashes: Frames that were lost this way.
        complaint: What `finalize` raised; empty if nothing.
    """

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._in_a_row = 0
        self.crashes = 0
        self.complaint = ""

    def track(self, frame: StereoFrame) -> Estimate:
        """Track, or say what went wrong.

        Raises:
            PluginError: After more than MOST_CRASHES frames in a row.
        """
        try:
            estimate = _checked(self._estimator.track(frame), frame)
        except Exception as error:
            self.crashes += 1
            self._in_a_row += 1
            reason = _told(error)
            if self._in_a_row > MOST_CRASHES:
                raise PluginError(
                    f"the estimator failed on {self._in_a_row} frames in a row, the last at "
                    f"{frame.timestamp_ns} ns: {reason}"
                ) from error
            return Estimate(frame.timestamp_ns, Status.LOST, None, reason)
        self._in_a_row = 0
        return estimate

    def finalize(self) -> FinalResult:
        """FinalResult of the estimator; nothing if it has none or fails."""
        if not isinstance(self._estimator, Finalizing):
            return FinalResult()
        try:
            return self._estimator.finalize()
        except Exception as error:
            self.complaint = _told(error)
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


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
