"""Association of two trajectories by time, and alignment of one to the other."""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import TrajectoryError
from vo.contract.trajectory import Trajectory

LONG_GAP_NS = 1_000_000_000
"""Shortest time without truth across which no motion is compared."""

MAX_GAP_NS = 20_000_000
"""Largest distance in time from the nearest sample of the truth: 6 mm of motion at 0.3 m/s."""


class Alignment(StrEnum):
    """Alignment of the estimate to the truth before positions are compared."""

    FIRST_POSE = "first_pose"
    """First poses coincide: nothing is fitted, and an initial heading error grows with distance."""
    SE3 = "se3"
    """Least-squares rigid motion over all positions."""
    SIM3 = "sim3"
    """Least-squares similarity, which removes the error of scale."""

    @property
    def words(self) -> str:
        """Description in captions."""
        return "first poses aligned" if self is Alignment.FIRST_POSE else "all positions aligned"


@dataclass(frozen=True)
class Pair:
    """Truth and estimate of the left camera at the same N >= 2 times.

    Attributes:
        timestamps_ns: (N,).
        T_world_cam: (N, 4, 4) truth.
        T_odom_cam: (N, 4, 4) estimate, in any fixed frame.
        has_attitude: Whether the rotations are known; otherwise both are the identity, and the
            positions are those of the point that the truth measures.
    """

    timestamps_ns: Indices
    T_world_cam: Array
    T_odom_cam: Array
    has_attitude: bool = True

    @property
    def travelled_m(self) -> Array:
        """(N,) length of the true path up to each time: the sum of its chords, metres."""
        steps = np.linalg.norm(np.diff(self.T_world_cam[:, :3, 3], axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def at(self, rows: Indices | slice) -> "Pair":
        """Keep some of the times."""
        return replace(
            self,
            timestamps_ns=self.timestamps_ns[rows],
            T_world_cam=self.T_world_cam[rows],
            T_odom_cam=self.T_odom_cam[rows],
        )

    def split(self, times_ns: Indices) -> list["Pair"]:
        """Return the parts of two times and more between which the given times (K,) lie."""
        before = np.searchsorted(times_ns, self.timestamps_ns, side="left")
        parts = [np.flatnonzero(before == x) for x in np.unique(before)]
        return [self.at(x) for x in parts if len(x) > 1] or [self]

    def motion_errors(self, starts: Indices, ends: Indices) -> Array:
        """Return inverse(true motion) @ estimated motion (K, 4, 4) between K pairs of indices."""
        true, estimated = (
            se3.inverse(T[starts]) @ T[ends] for T in (self.T_world_cam, self.T_odom_cam)
        )
        return se3.inverse(true) @ estimated


@dataclass(frozen=True)
class Similarity:
    """Similarity transformation p_a = scale * R_a_b @ p_b + t_a_b; rigid if scale is 1.

    Attributes:
        R_a_b: (3, 3).
        t_a_b: (3,) metres in a.
        scale: Length in a of one metre in b.
    """

    R_a_b: Array
    t_a_b: Array
    scale: float = 1.0

    def map(self, T_b_frame: Array) -> Array:
        """Transform poses (N, 4, 4) from b to a; rotations are not scaled."""
        t = self.scale * T_b_frame[:, :3, 3] @ self.R_a_b.T + self.t_a_b
        return se3.pose(self.R_a_b @ T_b_frame[:, :3, :3], t)


def associate(truth: Trajectory, estimate: Trajectory) -> Pair:
    """Interpolate the truth at the estimate's times.

    Times beyond the ends of the truth and in gaps of more than MAX_GAP_NS to its nearest sample are
    left out.

    Raises:
        TrajectoryError: If fewer than two times remain.
    """
    times, known, near = estimate.timestamps_ns, truth.timestamps_ns, ""
    distance_ns = truth_distance_ns(truth, times)
    shared = distance_ns <= MAX_GAP_NS
    if np.isfinite(distance_ns).any():
        near = f"; the nearest true pose is {distance_ns.min() / 1e6:.1f} ms away, "
        near += f"of {MAX_GAP_NS / 1e6:g} allowed"
    if shared.sum() < 2:
        truth_span, span = (f"{x[0]}..{x[-1]} ns" if len(x) else "is empty" for x in (known, times))
        raise TrajectoryError(
            f"the estimate shares {shared.sum()} times with the truth, scoring needs 2; "
            f"truth {truth_span}, estimate {span}{near}"
        )
    T_world_cam, T_odom_cam = truth.at(times[shared]).T_ref_frame, estimate.T_ref_frame[shared]
    if truth.point_cam is not None:
        points_odom = se3.transform(T_odom_cam, truth.point_cam[None])[:, 0]
        T_odom_cam = se3.pose(np.eye(3), points_odom)
    return Pair(times[shared], T_world_cam, T_odom_cam, truth.point_cam is None)


def truth_distance_ns(truth: Trajectory, times_ns: Indices) -> Array:
    """Return the distance of times (N,) from the nearest sample of the truth, infinite outside."""
    known = truth.timestamps_ns
    if not len(known):
        return np.full(len(times_ns), np.inf)
    after = np.searchsorted(known, times_ns).clip(1, len(known) - 1) if len(known) > 1 else 0
    nearest = np.minimum(np.abs(times_ns - known[after]), np.abs(times_ns - known[after - 1]))
    return np.where((times_ns >= known[0]) & (times_ns <= known[-1]), nearest, np.inf)


def true_poses(truth: Trajectory, times_ns: Indices) -> Array:
    """Interpolate T_world_cam (N, 4, 4) at N times; NaN where `associate` leaves them out."""
    T_world_cam = np.full((len(times_ns), 4, 4), np.nan)
    known = truth_distance_ns(truth, times_ns) <= MAX_GAP_NS
    T_world_cam[known] = truth.at(times_ns[known]).T_ref_frame
    return T_world_cam


def gaps(truth: Trajectory) -> Indices:
    """Return the middles (K,) in ns of long gaps in the truth, as outside of a motion capture."""
    steps = np.diff(truth.timestamps_ns)
    long = np.flatnonzero(steps > max(LONG_GAP_NS, 5 * np.median(steps))) if len(steps) else []
    return truth.timestamps_ns[long] + steps[long] // 2


def fit(pair: Pair, alignment: Alignment) -> Similarity:
    """Compute the motion that aligns the estimate to the truth.

    Raises:
        TrajectoryError: If a scale is requested and the estimate does not move.
    """
    if alignment is Alignment.FIRST_POSE:
        T_world_odom = pair.T_world_cam[0] @ se3.inverse(pair.T_odom_cam[0])
        return Similarity(T_world_odom[:3, :3], T_world_odom[:3, 3])
    world, odom = pair.T_world_cam[:, :3, 3], pair.T_odom_cam[:, :3, 3]
    return umeyama(world, odom, with_scale=alignment is Alignment.SIM3)


def umeyama(points_a: Array, points_b: Array, with_scale: bool) -> Similarity:
    """Compute the least-squares motion from b to a of corresponding points.

    Args:
        points_a: (N, 3) metres.
        points_b: (N, 3) metres; on a line, one of several minimisers is returned.
        with_scale: Whether the scale is estimated; otherwise it is 1.

    Raises:
        TrajectoryError: If the scale is estimated and points_b coincide.

    Source:
        Umeyama, Least-squares estimation of transformation parameters between two point
        patterns, PAMI 13(4), 1991.
    """
    mean_a, mean_b = points_a.mean(axis=0), points_b.mean(axis=0)  # eqs. 34, 35
    a, b = points_a - mean_a, points_b - mean_b
    variance_b = np.mean(np.sum(b**2, axis=1))  # eq. 37
    R_a_b, signed = se3.nearest_rotation(a.T @ b / len(a))  # eqs. 38 to 40, 43
    scale = 1.0
    if with_scale:
        if variance_b == 0:
            raise TrajectoryError("the estimate does not move, so its scale is undefined")
        scale = float(np.sum(signed) / variance_b)  # eq. 42
    return Similarity(R_a_b, mean_a - scale * R_a_b @ mean_b, scale)  # eq. 41
