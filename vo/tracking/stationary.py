"""Standing still: a pose is held while nothing shows that the camera has moved (thesis 5.1.3, E11).

What stands still sees the same pixels, but for the noise of the images. So flow is held against
the frames at which the camera came to rest, not against the frame before: however slow a motion
is, in time it shows, and what was held back is caught up with at once. The first frames at rest
and the last ones are each taken together, so that a frame in which matching went wrong does not
end a halt, and a creep that no single frame could tell from noise does.
"""

from dataclasses import dataclass, replace

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.projection import image_jacobian
from vo.contract.rig import StereoRig
from vo.tracking.association import Matches

POOLED = 7
"""Frames that are taken together, at the beginning of a halt and at its end."""

SIGNIFICANT = 28 * 5
"""Of chi-squared with a motion's six degrees of freedom: exceeded once in 10,000, were the noise
of landmarks independent. Patches overlap, and share it: five times where they are widest."""

COASTING = 14 * 5
"""The same with one degree of freedom: a camera that comes to rest goes on as it came, slower. It
is asked until the rest is settled; asked for longer, chance would end every other halt in noise."""

FEW_FRAMES = 3
"""A single frame's evidence has a longer tail than that of many: it must be so much stronger."""

WHEELS_REST = 4.0
"""So many times more may noise explain where encoders say that no wheel has turned."""

SAME_TICKS = 1
"""An encoder at rest on the edge of a tick may count it back and forth."""

FEWEST = 12
"""Landmarks that can tell motion from noise."""

CLEAR = 50
"""Landmarks of a single frame that can end a halt by themselves: fewer may agree with each other
by chance, and are believed together with those of the frames before."""

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
class Glimpse:
    """Landmarks in a frame, or in some frames taken together.

    Attributes:
        ids: (N,) ascending.
        pixels: (N, 2) where they were seen.
        points_odom: (N, 3) metres.
    """

    ids: Indices
    pixels: Array
    points_odom: Array


@dataclass(frozen=True)
class Rest:
    """A pose at which the camera may have come to rest, and what was seen from there.

    Attributes:
        T_odom_cam: (4, 4).
        arrival: (6,) tangent of the step that led there, in the camera's frame.
        spread: (6, 6) covariance of the pose, given the map.
        wheel_ticks: Counted until then; None if nothing counts.
        first: Glimpses of the first frames at rest, at most `POOLED`.
        last: Of the last ones that are not among the first, likewise.
    """

    T_odom_cam: Array
    arrival: Array
    spread: Array
    wheel_ticks: tuple[int, int] | None
    first: tuple[Glimpse, ...]
    last: tuple[Glimpse, ...] = ()

    @property
    def settled(self) -> bool:
        """Whether it has lasted for as long as it takes to come to rest (a second at 15 Hz)."""
        return len(self.first) == POOLED

    def joined(self, glimpse: Glimpse) -> "Rest":
        """Rest with one frame more."""
        last = (*self.last, glimpse)
        first = (*self.first, *last[:-POOLED])[:POOLED]
        return replace(self, first=first, last=last[-POOLED:])


def glimpse(inliers: Matches) -> Glimpse:
    """Of the landmarks that agree with a frame's pose."""
    return Glimpse(inliers.ids, inliers.pixels, inliers.points_odom)


def stands(rest: Rest, seen: Glimpse, wheel_ticks: tuple[int, int] | None, rig: StereoRig) -> bool:
    """Whether the camera is where it was, as far as images and wheels can tell.

    Wheels that have turned deny it. Wheels that have not make it more likely, but the images
    decide: a rover may be carried, or slide. The fewer frames there are to judge by, the clearer
    must they be, unless what they show is the motion by which the camera came, a moment ago.

    Args:
        rest: Where it was, and what it saw until now.
        seen: Landmarks that agree with the pose of the present frame.
        wheel_ticks: Counted until now; None where nothing counts, or nobody shall be asked.
        rig: Projects.
    """
    then, latest = _pool(rest.first), rest.joined(seen).last
    alone_px, _ = _flow(then, seen)
    flow_px, points_odom = _flow(then, _pool(latest))
    if len(flow_px) < FEWEST:
        return False
    sudden_px = alone_px if len(alone_px) >= CLEAR else flow_px
    if np.median(np.abs(sudden_px).max(axis=1)) > LARGEST_PX:
        return False
    excuse = 1.0
    if wheel_ticks and rest.wheel_ticks:
        if np.abs(np.subtract(wheel_ticks, rest.wheel_ticks)).max() > SAME_TICKS:
            return False
        excuse = WHEELS_REST
    points_cam = se3.transform(se3.inverse(rest.T_odom_cam), points_odom)
    coasting = rest.arrival[:, None]
    if not rest.settled and motion_evidence(points_cam, flow_px, rig, coasting) > excuse * COASTING:
        return False
    limit = excuse * SIGNIFICANT * (1 + FEW_FRAMES / len(latest))
    return motion_evidence(points_cam, flow_px, rig, np.eye(6)) < limit


def _flow(then: Glimpse, now: Glimpse) -> tuple[Array, Array]:
    """How far (N, 2) the landmarks seen both times have moved, and where (N, 3) they are."""
    _, i, j = np.intersect1d(then.ids, now.ids, assume_unique=True, return_indices=True)
    return now.pixels[j] - then.pixels[i], now.points_odom[j]


def _pool(glimpses: tuple[Glimpse, ...]) -> Glimpse:
    """Glimpses taken together: each landmark at the median of its pixels."""
    if len(glimpses) == 1:
        return glimpses[0]
    ids, first = np.unique(np.concatenate([g.ids for g in glimpses]), return_index=True)
    pixels = np.full((len(glimpses), len(ids), 2), np.nan)
    for row, g in zip(pixels, glimpses, strict=True):
        row[np.searchsorted(ids, g.ids)] = g.pixels
    count = (~np.isnan(pixels[..., 0])).sum(axis=0)
    ordered, every = np.sort(pixels, axis=0), np.arange(len(ids))  # NaN last
    middle = (ordered[(count - 1) // 2, every] + ordered[count // 2, every]) / 2
    return Glimpse(ids, middle, np.concatenate([g.points_odom for g in glimpses])[first])


def motion_evidence(points_cam: Array, flow_px: Array, rig: StereoRig, along: Array) -> float:
    """How far a small motion of the camera explains flow: chi-squared, K degrees of freedom.

    The noise is that of the flow which no motion explains; what moves by itself is left out.
    Infinite if hardly anything remains.

    Args:
        points_cam: (N, 3) metres.
        flow_px: (N, 2) in the left image.
        rig: Projects.
        along: (6, K) tangents of the motions that are thought of.

    Source:
        Analysis of variance, after least absolute deviations by reweighting.
    """
    x, y = (points_cam[:, :2] / points_cam[:, 2:]).T
    rows = [  # from (w, v) to (v, w)
        np.column_stack(np.broadcast_arrays(*row[3:], *row[:3]))
        for row in image_jacobian(x, y, 1 / points_cam[:, 2])
    ]
    jacobian = rig.f_px * np.stack(rows, axis=1) @ along  # (N, 2, K)
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
    rows = jacobian[keep].reshape(-1, along.shape[1])
    motion = np.linalg.lstsq(rows, flow_px[keep].ravel())[0]
    noise_px = TO_DEVIATION * float(np.median(np.abs(flow_px[keep].ravel() - rows @ motion)))
    return float(((rows @ motion) ** 2).sum()) / max(noise_px, LEAST_NOISE_PX) ** 2
