"""The estimator protocol: stereo frames in, one estimate per frame out."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol, runtime_checkable

from vo.contract.arrays import Array, Image, Indices, Mask
from vo.contract.sequence import StereoFrame
from vo.contract.trajectory import Trajectory


class Status(StrEnum):
    """How a frame ended; exactly one for every frame."""

    START = "start"
    """The first frame, or the first after a loss: it defines or resumes the odometry frame."""
    TRACKED = "tracked"
    """The motion rests on enough inliers."""
    WEAK = "weak"
    """There is a pose, but it deserves suspicion; the reason says why."""
    LOST = "lost"
    """There is no pose for this frame; the reason says why."""


@dataclass(frozen=True)
class Observations:
    """The landmarks seen in one frame.

    Attributes:
        ids: (N,) landmark identifiers, unique over the whole run.
        pixels: (N, 2) left-image (u, v) in pixels.
        disparity_px: (N,) estimated disparity; NaN where unknown.
        inlier: (N,) whether the landmark agrees with the frame's motion.
    """

    ids: Indices
    pixels: Array
    disparity_px: Array
    inlier: Mask


@dataclass(frozen=True)
class PointMap:
    """The points that were estimated along the way.

    Attributes:
        ids: (N,) landmark identifiers.
        points_odom: (N, 3) metres, in the first left camera's frame.
        grey: (N,) uint8 brightness.
        views: (N,) frames that saw the point.
    """

    ids: Indices
    points_odom: Array
    grey: Image
    views: Indices


@dataclass(frozen=True)
class FinalResult:
    """What an estimator knows at the end of a sequence.

    Attributes:
        trajectory: T_odom_cam of the frames that had a pose, by all that came later; None if
            there is nothing better than what was said at the time.
        points: None if the estimator keeps no map.
    """

    trajectory: Trajectory | None = None
    points: PointMap | None = None


@dataclass(frozen=True)
class Estimate:
    """What an estimator says of one frame.

    Attributes:
        timestamp_ns: The frame's.
        status: Exactly one.
        T_odom_cam: (4, 4) left camera in the first left camera's frame; None only when lost.
        reason: Why the status is not `tracked`; empty when there is nothing to say.
        counts: Stage name to number of items that survived it, in stage order.
        timings_ms: Stage name to milliseconds, in stage order.
        observations: Landmarks seen, if the estimator shares them.
        covariance: (6, 6) of T_odom_cam, tangent (v m, w rad) in the camera's frame; None if the
            estimator does not say.
        step_covariance: (6, 6) of the motion since the last frame that had a pose, likewise.
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

    def __post_init__(self) -> None:
        if (self.T_odom_cam is None) != (self.status is Status.LOST):
            raise ValueError(f"status {self.status} with T_odom_cam {self.T_odom_cam}")


class Estimator(Protocol):
    """Anything that turns stereo frames into estimates, one call a frame, in order of time."""

    def track(self, frame: StereoFrame) -> Estimate:
        """Take the next frame and return its estimate; never raises on image content."""
        ...


@runtime_checkable
class Finalizing(Protocol):
    """An estimator that has something to say when the sequence is over."""

    def finalize(self) -> FinalResult:
        """Look back, after the last frame."""
        ...
