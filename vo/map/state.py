"""State of the tracker: everything that one frame hands to the next."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from vo.contract.arrays import Array
from vo.map.frame import Matches, View
from vo.map.local_map import LocalMap, TrackedFrame, empty_map
from vo.stereo.right_camera import StereoErrors


@dataclass(frozen=True)
class Halt:
    """A pose at which the camera may have come to rest, and what was observed from there.

    Attributes:
        T_last_cam: (4, 4) step that led there.
        covariance: (6, 6) of the pose, given the map.
        wheel_ticks: Left and right count of the encoders there; None without encoders.
        first: Inliers of the first frames at rest.
        last: Inliers of the last frames that are not among the first.
    """

    T_odom_cam: Array
    T_last_cam: Array
    covariance: Array
    wheel_ticks: tuple[int, int] | None
    first: tuple[Matches, ...]
    last: tuple[Matches, ...] = ()


@dataclass(frozen=True)
class Pending:
    """A view that becomes a keyframe, its inliers, pose (4, 4), and covariance given the map.

    After the first step it is a keyframe, after the second the map is adjusted; it is kept for one
    frame more, so that no other keyframe is made in that.
    """

    view: View
    inliers: Matches
    covariance: Array
    T_odom_cam: Array
    steps: int = 0

    @property
    def has_work(self) -> bool:
        """Whether landmarks or the adjustment are left to do."""
        return self.steps < 2


@dataclass(frozen=True)
class LearntMotion:
    """What was learnt in a run of the motion that N numbers of a sensor stand for.

    Attributes:
        squares: (N, N) weighted sum of products of the numbers of a step.
        products: (N, M) of them with the step, of which M components are learnt.
        spread: (M, M) of what they did not predict.
        weight: Weight of the steps in them.
        readings: Of the sensor at the last pose, counted since the start; None if there were none.
        strikes: Successive contradictions so far.
        silent: Successive steps that the images saw and the sensor did not.
    """

    squares: Array
    products: Array
    spread: Array
    weight: float = 0.0
    readings: tuple[float, ...] | None = None
    strikes: int = 0
    silent: int = 0


def nothing_learnt(numbers: int, components: int) -> LearntMotion:
    """Return the state before the first step."""
    return LearntMotion(
        np.zeros((numbers, numbers)),
        np.zeros((numbers, components)),
        np.zeros((components, components)),
    )


@dataclass
class TrackerState:
    """Plain data, changed by `vo.odometry`, by the mapper and by the culling of landmarks only.

    Attributes:
        map: Keyframes and landmarks of the present segment; empty before its first frame.
        lost_map: Map of a segment that is not connected to the present one.
        T_odom_cam: (4, 4) pose of the last frame that had one, at `pose_ns`.
        T_last_cam: (4, 4) motion that led to it from the pose before, in `step_ns`.
        T_reported: (4, 4) that pose as it was reported; the map may have moved since.
        covariance: (6, 6) of T_odom_cam, given the map.
        odom_covariance: (6, 6) of it in the odometry frame.
        drift: (6, 6) that keyframes added to it since the last report.
        previous: The last frame that had a pose.
        halt: Where the camera last moved to.
        wheels: What was learnt of the encoders: 2 counts to a step, (v m, w rad).
        gyro: What was learnt of the gyroscope: 3 angles and time to the rotation of a step.
        ticks: Counts of the encoders at the present frame; None without, or where none are used.
        angles_rad: By which the gyroscope has turned until then; None without one.
        pending: The last keyframe, as long as another one waits for it.
        outlier_counts: Landmark to the number of successive frames in which it was an outlier;
            empty without `motion.landmark_prior`.
        smoothing_px: Standard deviation of the Gaussian for all images since a noisy one; 0: none.
        is_band_passed: Whether the last images were replaced by their band-pass.
        row_offsets_px: Of the last keyframes, vertical offset of the right image to the left one.
        stereo_errors: Errors of the calibration that are corrected; None if none are.
        velocities: (6,) mean of each of the last two steps, m/s and rad/s, in the left camera's
            frame; none after a loss, or where they are not needed.
        lost_frames: Frames since the last pose.
        is_faint: Whether the last keyframe is a faint image.
    """

    map: LocalMap = field(default_factory=empty_map)
    lost_map: LocalMap | None = None
    T_odom_cam: Array = field(default_factory=lambda: np.eye(4))
    T_last_cam: Array = field(default_factory=lambda: np.eye(4))
    T_reported: Array = field(default_factory=lambda: np.eye(4))
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    odom_covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    drift: Array = field(default_factory=lambda: np.zeros((6, 6)))
    previous: TrackedFrame | None = None
    halt: Halt | None = None
    wheels: LearntMotion = field(default_factory=lambda: nothing_learnt(2, 6))
    gyro: LearntMotion = field(default_factory=lambda: nothing_learnt(4, 3))
    ticks: tuple[int, int] | None = None
    angles_rad: tuple[float, float, float] | None = None
    pending: Pending | None = None
    outlier_counts: Mapping[int, int] = field(default_factory=dict[int, int])
    smoothing_px: float = 0.0
    is_band_passed: bool = False
    row_offsets_px: tuple[float, ...] = ()
    stereo_errors: StereoErrors | None = None
    velocities: tuple[Array, ...] = ()
    pose_ns: int = 0
    step_ns: int = 0
    frame_ns: int = -1
    lost_frames: int = 0
    is_faint: bool = False

    @property
    def has_work(self) -> bool:
        """Whether the last keyframe waits for its landmarks or its adjustment."""
        return self.pending is not None and self.pending.has_work
