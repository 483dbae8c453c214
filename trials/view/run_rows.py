"""What a run says about each frame, aligned to the truth as its score is."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trials.evaluation.alignment import (
    MAX_GAP_NS,
    Alignment,
    Pair,
    Similarity,
    associate,
    fit,
    gaps,
)
from trials.evaluation.metrics import errors_over_distance
from trials.evaluation.runs import DAMAGE, SavedRun
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import TrajectoryError
from vo.contract.estimator import Estimate, Status
from vo.contract.observations import Observations
from vo.contract.remarks import remark
from vo.contract.trajectory import Trajectory
from vo.runner import companion

IDENTITY = Similarity(np.eye(3), np.zeros(3))
DRIFT_LENGTH_M = 1.0


@dataclass(frozen=True)
class Row:
    """One frame of a run.

    Attributes:
        frame: Number of the frame in the recording.
        estimate: What the estimator returned.
        T_world_cam: (4, 4) its pose, aligned; None without.
        translation_error_m: Distance from the true position; NaN where unknown, as the others.
        rotation_error_deg: Angle from the true attitude.
        drift_pct: Drift over the metre of true path that begins here, in per cent.
    """

    frame: int
    estimate: Estimate
    T_world_cam: Array | None
    translation_error_m: float = np.nan
    rotation_error_deg: float = np.nan
    drift_pct: float = np.nan

    @property
    def inliers(self) -> float:
        """Number of inliers, or of what the last stage kept; NaN where it is not known."""
        seen, counts = self.estimate.observations, self.estimate.counts
        if seen is not None and len(seen.ids):
            return float(seen.inlier.sum())
        return float(list(counts.values())[-1]) if counts else np.nan


@dataclass(frozen=True)
class AlignedRun:
    """A saved run in the world of the truth, or of another run where there is no truth.

    Attributes:
        run: The run, with a name of its own.
        T_world_odom: Motion that aligns it.
        truth: True trajectory, None without.
        pair: True and estimated poses at the same times; None without truth.
    """

    run: SavedRun
    T_world_odom: Similarity
    truth: Trajectory | None = None
    pair: Pair | None = None

    def rows(self, times_ns: Indices, numbers: Indices) -> Iterator[Row]:
        """Yield the frames nearest to times (N,), of frames of those numbers, in order."""
        estimates = self._estimates
        known = np.array([x.timestamp_ns for x in estimates], dtype=np.int64)
        for time_ns, number in zip(times_ns.tolist(), numbers.tolist(), strict=True):
            near = int(np.argmin(np.abs(known - time_ns))) if len(known) else -1
            if near >= 0 and abs(int(known[near]) - time_ns) <= MAX_GAP_NS:
                yield self._row(number, estimates[near])

    def _row(self, number: int, estimate: Estimate) -> Row:
        T_odom_cam, time_ns = estimate.T_odom_cam, estimate.timestamp_ns
        if T_odom_cam is None:
            return Row(number, estimate, None)
        errors = self._errors.get(time_ns, (np.nan, np.nan))
        drift_pct = self.drift_pct.get(time_ns, np.nan)
        return Row(number, estimate, self.T_world_odom.map(T_odom_cam[None])[0], *errors, drift_pct)

    @cached_property
    def _errors(self) -> dict[int, tuple[float, float]]:
        """Time to errors of position, m, and attitude, degrees."""
        if self.pair is None:
            return {}
        T_world_est = self.T_world_odom.map(self.pair.T_odom_cam)
        errors = pose_errors(self.pair.T_world_cam, T_world_est, self.pair.has_attitude)
        return dict(zip(self.pair.timestamps_ns.tolist(), errors, strict=True))

    @cached_property
    def drift_pct(self) -> dict[int, float]:
        """Time to the drift over 1 m from there, in per cent, of which the score is the mean."""
        found: dict[int, float] = {}
        if self.truth is None or self.pair is None or not self.pair.has_attitude:
            return found
        for part in self.pair.split(gaps(self.truth)):
            errors = errors_over_distance(part, DRIFT_LENGTH_M)
            starts = part.timestamps_ns[errors.start].tolist()
            found |= dict(zip(starts, errors.percent.tolist(), strict=True))
        return found

    @cached_property
    def _estimates(self) -> list[Estimate]:
        """Every frame of the run, as its estimator returned it."""
        run, poses = self.run, self.run.trajectory
        T_of = dict(zip(poses.timestamps_ns.tolist(), poses.T_ref_frame, strict=True))
        if run.frames is None:
            return [Estimate(t, Status.TRACKED, T) for t, T in T_of.items()]
        covariances, table = _read_covariances(run), run.frames
        found: list[Estimate] = []
        for i, time_ns in enumerate(table.timestamps_ns.tolist()):
            T_odom_cam = T_of.get(time_ns)
            status = table.status[i] if T_odom_cam is not None else Status.LOST
            counts = {x: int(n[i]) for x, n in table.counts.items() if np.isfinite(n[i])}
            of_frame = Estimate(
                *(time_ns, status, T_odom_cam, table.reason[i], counts),
                observations=self._observations(i),
                covariance=covariances.get(time_ns),
            )
            found.append(of_frame)
        return found

    def _observations(self, i: int) -> Observations | None:
        tracks = self.run.tracks
        if tracks is None:
            return None
        here = slice(*np.searchsorted(tracks.frame, [i, i + 1]).tolist())
        return Observations(
            *(tracks.landmark[here], tracks.pixels[here], tracks.disparity_px[here]),
            tracks.inlier[here],
        )


def align_runs(truth: Trajectory | None, runs: Sequence[SavedRun]) -> list[AlignedRun]:
    """Align runs to the truth as their scores do; without truth, by their first common poses.

    A run of which fewer than two poses have a truth stays where it is, with a remark.
    """
    return [_aligned(truth, run, runs[0]) for run in runs]


def _aligned(truth: Trajectory | None, run: SavedRun, first: SavedRun) -> AlignedRun:
    if truth is None and run is first:
        return AlignedRun(run, IDENTITY)
    has_attitude = truth is None or truth.point_cam is None
    alignment = Alignment.FIRST_POSE if has_attitude else Alignment.SE3
    try:
        pair = associate(first.trajectory if truth is None else truth, run.trajectory)
    except TrajectoryError as error:
        remark(f"{run.path}: shown without alignment: {error}")
        return AlignedRun(run, IDENTITY)
    return AlignedRun(run, fit(pair, alignment), truth, pair if truth is not None else None)


def align_first_pose(T_world_cam: Array, T_odom_cam: Array) -> Similarity:
    """Return the motion after which an estimated pose (4, 4) is the true one."""
    T_world_odom = T_world_cam @ se3.inverse(T_odom_cam)
    return Similarity(T_world_odom[:3, :3], T_world_odom[:3, 3])


def pose_errors(
    T_world_cam: Array, T_world_est: Array, has_attitude: bool
) -> list[tuple[float, float]]:
    """Return errors of position, m, and attitude, degrees, of poses (N, 4, 4); NaN if unknown."""
    offsets_m = np.linalg.norm(T_world_est[:, :3, 3] - T_world_cam[:, :3, 3], axis=1)
    turns = np.degrees(se3.rotation_angle(se3.inverse(T_world_cam) @ T_world_est))
    degrees = turns if has_attitude else np.full(len(turns), np.nan)
    return list(zip(offsets_m.tolist(), degrees.tolist(), strict=True))


def _read_covariances(run: SavedRun) -> dict[int, Array]:
    """Read time to covariance (6, 6) of the pose, where the estimator gave one.

    Raises:
        TrajectoryError: If the file is damaged.
    """
    path = companion(run.path, "covariance.npz")
    if not path.is_file():
        return {}
    try:
        with np.load(path) as file:
            times, poses = file["timestamp_ns"].tolist(), np.reshape(file["pose"], (-1, 6, 6))
        return {t: P for t, P in zip(times, poses, strict=True) if np.isfinite(P).all()}
    except DAMAGE as error:
        raise TrajectoryError(f"{path}: a companion file is damaged ({error})") from None
