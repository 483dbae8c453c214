"""Standing still: a pose is held while nothing shows that the camera has moved (thesis 5.1.3, E11).

What stands still sees the same pixels, but for the noise of the images. So flow is held against a
frame at which the camera came to rest, not against the frame before: however slow a motion is, in
time it shows, and what was held back is caught up with at once.
"""

from dataclasses import dataclass

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.correspondence import Matches

SIGNIFICANT = 28 * 2.5
"""Of chi-squared with a motion's six degrees of freedom: exceeded once in 10,000, were the noise
of landmarks independent. Patches overlap, and share it."""

WHEELS_REST = 4.0
"""So many times more may noise explain where encoders say that no wheel has turned."""

SAME_TICKS = 1
"""An encoder at rest on the edge of a tick may count it back and forth."""

FEWEST = 12
"""Landmarks that can tell motion from noise."""

LARGEST_PX = 0.5
"""Median flow that is never put down to noise."""

LEAST_NOISE_PX = 0.01
"""Of a pixel's flow: alignment converges to no better."""

OUTLYING = 3.0
"""Standard deviations of flow beyond which a landmark moves by itself."""

ROUNDS = 5
"""In which what fits ill loses its weight."""

TO_DEVIATION = 1.4826
"""From the median absolute value of normal errors to their standard deviation."""


@dataclass(frozen=True)
class Rest:
    """A frame that had a pose, at which the camera may have come to rest.

    Attributes:
        T_odom_cam: (4, 4).
        spread: (6, 6) covariance of it, given the map.
        ids: (N,) landmarks that agreed with it, ascending.
        pixels: (N, 2) where they were seen.
        wheel_ticks: Counted until then; None if nothing counts.
    """

    T_odom_cam: Array
    spread: Array
    ids: Indices
    pixels: Array
    wheel_ticks: tuple[int, int] | None

    @classmethod
    def at(cls, T_odom_cam: Array, spread: Array, inliers: Matches, frame: StereoFrame) -> "Rest":
        """Rest at a pose, by the landmarks that agree with it."""
        return cls(T_odom_cam, spread, inliers.ids, inliers.pixels, frame.wheel_ticks)


def stands(
    rest: Rest, inliers: Matches, wheel_ticks: tuple[int, int] | None, rig: StereoRig
) -> bool:
    """Whether the camera is where it was, as far as images and wheels can tell.

    Wheels that have turned deny it. Wheels that have not make it more likely, but the images
    decide: a rover may be carried, or slide.

    Args:
        rest: Where it was.
        inliers: Landmarks that agree with the pose of the present frame.
        wheel_ticks: Counted until now; None where nothing counts, or nobody shall be asked.
        rig: Projects.
    """
    _, then, now = np.intersect1d(rest.ids, inliers.ids, assume_unique=True, return_indices=True)
    flow_px = inliers.pixels[now] - rest.pixels[then]
    if len(now) < FEWEST or np.median(np.abs(flow_px).max(axis=1)) > LARGEST_PX:
        return False
    limit = SIGNIFICANT
    if wheel_ticks and rest.wheel_ticks:
        if np.abs(np.subtract(wheel_ticks, rest.wheel_ticks)).max() > SAME_TICKS:
            return False
        limit *= WHEELS_REST
    points_cam = se3.transform(se3.inverse(rest.T_odom_cam), inliers.points_odom[now])
    return motion_evidence(points_cam, flow_px, rig) < limit


def motion_evidence(points_cam: Array, flow_px: Array, rig: StereoRig) -> float:
    """How far a small motion of the camera explains flow: chi-squared, six degrees of freedom.

    The noise is that of the flow which no motion explains; what moves by itself is left out.
    Infinite if hardly anything remains.

    Args:
        points_cam: (N, 3) metres.
        flow_px: (N, 2) in the left image.
        rig: Projects.

    Source:
        Analysis of variance, after least absolute deviations by reweighting; image Jacobian
        after Longuet-Higgins and Prazdny, 1980.
    """
    x, y = (points_cam[:, :2] / points_cam[:, 2:]).T
    near, none = 1 / points_cam[:, 2], np.zeros(len(points_cam))
    across = np.column_stack([-near, none, x * near, x * y, -1 - x * x, y])
    down = np.column_stack([none, -near, y * near, 1 + y * y, -x * y, -x])
    jacobian = rig.f_px * np.stack([across, down], axis=1)  # (N, 2, 6), tangent (v, w)
    weight, noise_px, left_px = np.ones(len(flow_px)), 0.0, flow_px
    for _ in range(ROUNDS):
        weighted = jacobian * weight[:, None, None]
        information = np.einsum("nij,nik->jk", weighted, jacobian)
        motion = np.linalg.pinv(information) @ np.einsum("nij,ni->j", weighted, flow_px)
        left_px = flow_px - jacobian @ motion
        noise_px = max(TO_DEVIATION * float(np.median(np.abs(left_px))), LEAST_NOISE_PX)
        weight = 1 / np.maximum(np.abs(left_px).max(axis=1) / noise_px, 1.0)
    keep = np.abs(left_px).max(axis=1) < OUTLYING * noise_px
    if keep.sum() < FEWEST:
        return np.inf
    rows = jacobian[keep].reshape(-1, 6)
    motion = np.linalg.lstsq(rows, flow_px[keep].ravel())[0]
    noise_px = TO_DEVIATION * float(np.median(np.abs(flow_px[keep].ravel() - rows @ motion)))
    return float(((rows @ motion) ** 2).sum()) / max(noise_px, LEAST_NOISE_PX) ** 2
