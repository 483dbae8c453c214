"""The estimator protocol: stereo frames in, one estimate per frame out."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol, runtime_checkable

from vo.contract.arrays import Array, Image, Indices
from vo.contract.observations import Observations
from vo.contract.sequence import StereoFrame
from vo.contract.trajectory import Trajectory


class Status(StrEnum):
    """Outcome of a frame.

    Example:
        >>> [status.value for status in dy.Status]
        ['start', 'tracked', 'weak', 'lost']
    """

    START = "start"
    """The first frame, or the first after a loss; it defines or resumes the odometry frame."""
    TRACKED = "tracked"
    """The pose has enough inliers."""
    WEAK = "weak"
    """The pose is unreliable; the reason says why."""
    LOST = "lost"
    """The frame has no pose; the reason says why."""


@dataclass(frozen=True)
class PointMap:
    """The estimated landmarks of a run, with their uint8 brightness and number of views: (N,) each.

    The points (N, 3) are metres in the first left camera's frame.

    Example:
        >>> dy.run(ds, "corner_flow").map is None  # it keeps none
        True
    """

    ids: Indices
    points_odom: Array
    grey: Image
    views: Indices


@dataclass(frozen=True)
class FinalResult:
    """Result of an estimator after the last frame; without points if it keeps no map.

    The trajectory is T_odom_cam of the frames that had a pose, smoothed over the whole run; None if
    the estimates per frame are final.

    Example:
        >>> dy.FinalResult().trajectory is None
        True
    """

    trajectory: Trajectory | None = None
    points: PointMap | None = None


@dataclass(frozen=True)
class Estimate:
    """Estimate for one frame.

    Attributes:
        T_odom_cam: (4, 4) left camera in the first left camera's frame; None only when lost.
        reason: Reason why the status is not `tracked`; may be empty.
        counts: Stage name to number of items that remain after it, in stage order.
        timings_ms: Stage name to milliseconds, in stage order.
        observations: Landmarks observed; None if the estimator does not report them.
        covariance: (6, 6) of T_odom_cam, tangent (v m, w rad) in the camera's frame; None if the
            estimator does not report it.
        step_covariance: (6, 6) of the motion since the last frame that had a pose, likewise.
        drift_covariance: (6, 6) of the part of this step's error that later poses keep, likewise:
            of the map. The rest is each pose's own. None if later poses keep all of it.

    Raises:
        ValueError: If there is a pose of a lost frame, or none of another.

    Example:
        >>> dy.Estimate(0, dy.Status.LOST, None, reason="3 inliers, need 8").T_odom_cam is None
        True
    """

    timestamp_ns: int
    status: Status
    T_odom_cam: Array | None
    reason: str = ""
    counts: Mapping[str, int] = field(default_factory=dict[str, int])
    timings_ms: Mapping[str, float] = field(default_factory=dict[str, float])
    observations: Observations | None = None
    covariance: Array | None = None
    step_covariance: Array | None = None
    drift_covariance: Array | None = None

    def __post_init__(self) -> None:
        if (self.T_odom_cam is None) != (self.status is Status.LOST):
            raise ValueError(f"status {self.status} with T_odom_cam {self.T_odom_cam}")


class Estimator(Protocol):
    """An estimator that maps stereo frames, in order of time, to estimates."""

    def track(self, frame: StereoFrame) -> Estimate:
        """Return the estimate of the next frame; never raise on image content."""
        ...


@runtime_checkable
class Finalizing(Protocol):
    """An estimator with a result after the last frame."""

    def finalize(self) -> FinalResult:
        """Return the final result, after the last frame."""
        ...
