"""Detection of a stationary camera: its pose is held while nothing shows motion (5.1.3, E11).

A stationary camera sees the same pixels, but for the noise of the images. So flow is measured
against the frames at which the camera came to rest, not against the previous frame: in time, a
motion shows however slow it is, and the pose is then corrected at once. The first frames at rest
and the last ones are each pooled, so that a frame with wrong matches does not end a halt, and a
creep below the noise of a single frame does.
"""

from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, find_sorted
from vo.contract.rig import StereoRig
from vo.map.frame import Matches, View
from vo.map.state import Halt
from vo.tracking.motion_evidence import FLOW_FIT, motion_evidence


@dataclass(frozen=True)
class StationaryThresholds:
    """Limits of the test; experiment E11 (docs/experiments.md) measures what they achieve."""

    pooled_frames: int = 7
    """Frames that are pooled at the end of a halt; after as many, it is settled."""
    reference_frames: int = 21
    """Frames that are pooled at the beginning of a halt: their noise is in every later test."""
    significant: float = 28 * 5
    """Of chi-squared with six degrees of freedom: 28 is exceeded once in 10,000; overlapping
    patches share their noise, five times where they are widest."""
    coasting: float = 14 * 5
    """The same with one degree of freedom, along the arrival, until the halt is settled: tested
    for longer, chance would end every other halt."""
    settled: float = 2.5
    """Factor on the limit of a settled halt: its end brings the error of a new pose, which in noise
    is more than what tyres creep in a minute."""
    few_frames: float = 3
    """Factor on the limit for a single frame, whose evidence has a longer tail, less one."""
    wheels_rest: float = 4.0
    """Factor on the limits where encoders report no motion."""
    same_ticks: int = 1
    """Difference at rest: an encoder on the edge of a tick may count it back and forth."""
    single_landmarks: int = 50
    """Landmarks of a single frame that can end a halt: fewer may agree by chance."""
    max_flow_px: float = 0.5
    """Median flow above which a single frame is tested, too."""


LIMITS = StationaryThresholds()


def detect_stationary(halt: Halt | None, view: View, inliers: Matches) -> Halt | None:
    """Return the halt with one frame more if the camera is still there, or else None."""
    mode = view.settings.stationary
    if halt is None or mode == "none":
        return None
    ticks = view.frame.wheel_ticks if mode == "encoders" else None
    return extend_halt(halt, inliers) if is_stationary(halt, inliers, ticks, view.rig) else None


def start_halt(
    T_odom_last: Array, T_odom_cam: Array, covariance: Array, view: View, inliers: Matches
) -> Halt:
    """Start a halt at a new pose (4, 4), its covariance (6, 6) given the map."""
    T_last_cam = se3.inverse(T_odom_last) @ T_odom_cam
    return Halt(T_odom_cam, T_last_cam, covariance, view.frame.wheel_ticks, (inliers,))


def encoders_at_rest(halt: Halt | None, view: View) -> bool:
    """Whether encoders report that no wheel has turned since the camera last moved."""
    if view.settings.stationary != "encoders" or halt is None or halt.wheel_ticks is None:
        return False
    return view.frame.wheel_ticks == halt.wheel_ticks


def extend_halt(halt: Halt, inliers: Matches) -> Halt:
    """Add a frame to a halt."""
    n = LIMITS.pooled_frames
    last = (*halt.last, inliers)
    return replace(halt, first=(*halt.first, *last[:-n])[: LIMITS.reference_frames], last=last[-n:])


def is_settled(halt: Halt) -> bool:
    """Whether a halt has lasted for as long as it takes to come to rest (a second at 15 Hz)."""
    return len(halt.first) >= LIMITS.pooled_frames


def is_stationary(
    halt: Halt, inliers: Matches, wheel_ticks: tuple[int, int] | None, rig: StereoRig
) -> bool:
    """Test whether the camera is where it came to rest, by images and wheel ticks, if any.

    Wheels that have turned deny it. Wheels that have not make it more likely, but the images
    decide: a rover may be carried, or slide. The fewer frames are pooled, the stronger must the
    evidence be, unless it is along the motion by which the camera arrived a moment ago.
    """
    first, latest = _pool(halt.first), extend_halt(halt, inliers).last
    single = _flow(first, inliers)
    pooled = _flow(first, _pool(latest)) if len(latest) > 1 else single
    flow_px, points_odom = pooled
    if len(flow_px) < FLOW_FIT.min_landmarks:
        return False
    factor = 1.0
    if wheel_ticks and halt.wheel_ticks:
        if np.abs(np.subtract(wheel_ticks, halt.wheel_ticks)).max() > LIMITS.same_ticks:
            return False
        factor = LIMITS.wheels_rest
    T_cam_odom, enough = se3.inverse(halt.T_odom_cam), len(single[0]) >= LIMITS.single_landmarks
    sudden_px, points = single if enough else pooled
    if np.median(np.abs(sudden_px).max(axis=1)) > LIMITS.max_flow_px:  # a motion, or noise
        found = motion_evidence(se3.transform(T_cam_odom, points), sudden_px, rig, np.eye(6))
        if found > factor * LIMITS.significant * (1 + LIMITS.few_frames):
            return False
    points_cam = se3.transform(T_cam_odom, points_odom)
    if not is_settled(halt):
        coasting = motion_evidence(points_cam, flow_px, rig, se3.log(halt.T_last_cam)[:, None])
        if coasting > factor * LIMITS.coasting:
            return False
    factor *= LIMITS.settled if is_settled(halt) else 1.0
    limit = factor * LIMITS.significant * (1 + LIMITS.few_frames / len(latest))
    return motion_evidence(points_cam, flow_px, rig, np.eye(6)) < limit


def _flow(first: Matches, now: Matches) -> tuple[Array, Array]:
    """Flow (N, 2) of the landmarks in both, and their positions (N, 3)."""
    place = find_sorted(first.ids, now.ids)
    both = place >= 0
    return now.pixels[both] - first.pixels[place[both]], now.points_odom[both]


def _pool(frames: tuple[Matches, ...]) -> Matches:
    """Pool frames: each landmark as first matched, but at the median of its pixels."""
    if len(frames) == 1:
        return frames[0]
    ids, first = np.unique(np.concatenate([x.ids for x in frames]), return_index=True)
    pixels = np.full((len(frames), len(ids), 2), np.nan)
    for row, x in zip(pixels, frames, strict=True):
        row[np.searchsorted(ids, x.ids)] = x.pixels
    count = (~np.isnan(pixels[..., 0])).sum(axis=0)
    ordered, every = np.sort(pixels, axis=0), np.arange(len(ids))  # NaN last
    middle = (ordered[(count - 1) // 2, every] + ordered[count // 2, every]) / 2
    return replace(reduce(Matches.extend, frames).select(first), pixels=middle)
