"""The least error that the estimator's own tracks allow (Cramér–Rao), beside what it achieves.

Tracks, geometry and noise are those of a run: which landmarks it saw where, and how far its
measurements are from the truth. What the bound leaves out is what an estimator can still lose:
that errors are biased or go together, and that a pose is told before the frames after it are seen.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import stats

from trials.diagnosis.oracles import NEAR_PX
from trials.evaluation.alignment import Pair, associate
from trials.evaluation.information import motion_covariance, pose_covariance
from trials.evaluation.runs import SavedRun
from trials.evaluation.truth import TrueWorld
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import TrajectoryError
from vo.contract.files import replacing
from vo.contract.readers import read_truth
from vo.contract.rig import StereoRig

BORN_SIGMA_PX = 0.01
"""A landmark is the surface point at its first pixel, which has no error."""

FITTED = 4000
"""Residuals to which a distribution is fitted."""

LEAST_SIGHTINGS = 100
"""Fewer say nothing of the noise."""

FEWEST_ACROSS = 6
"""Landmarks seen before and after a gap between frames that connect the two sides of it."""

LENGTH_M = 1.0
STRIDE = 5
"""From every so manieth frame starts a metre; those between say the same."""


@dataclass(frozen=True)
class Noise:
    """Errors of measurements, as a Student t distribution.

    Attributes:
        bias_px: (3,) of u, v and disparity.
        effective_px: (3,) the standard deviation of a Gaussian with the same information.
    """

    bias_px: Array
    effective_px: Array


@dataclass(frozen=True)
class Bound:
    """What a run achieved and could have, root mean squares over motions.

    Where tracks break off, as after lost frames, of the longest stretch that they connect.

    Attributes:
        noise: Of its measurements.
        over_1m_percent: Error of translation over 1 m.
        least_over_1m_percent: Its bound.
        end_m: Error of translation from its first to its last pose.
        least_end_m: Its bound.
        observations: Of landmarks by frames.
    """

    noise: Noise
    over_1m_percent: float
    least_over_1m_percent: float
    end_m: float
    least_end_m: float
    observations: int

    @property
    def ratio_over_1m(self) -> float:
        """Achieved error over its bound."""
        return self.over_1m_percent / self.least_over_1m_percent

    @property
    def ratio_end(self) -> float:
        """Achieved error over its bound: one sample, so it varies a lot."""
        return self.end_m / self.least_end_m


@dataclass(frozen=True)
class Sightings:
    """What a run saw of landmarks whose true place is known.

    Attributes:
        points_world: (J, 3) metres.
        born: (J,) frame in which each was first seen.
        camera: (M,) frame of each later sighting.
        point: (M,) its landmark.
        residual_px: (M, 3) measured less true u, v and disparity; NaN where not measured.
    """

    points_world: Array
    born: Indices
    camera: Indices
    point: Indices
    residual_px: Array


def bound(dataset: Path, run: SavedRun, births: Path) -> Bound:
    """Bound the errors of a run by its own tracks.

    Args:
        dataset: With depth labels.
        run: With tracks and the record of its frames.
        births: As `write_births` writes them.

    Raises:
        TrajectoryError: If the run has no tracks, or they do not connect its frames, or it is
            shorter than 1 m.
    """
    truth = read_truth(dataset)
    if truth is None:
        raise TrajectoryError(f"{dataset}: holds no truth to compare with")
    world, pair = TrueWorld(dataset), associate(truth, run.trajectory)
    pair, seen = connected(*_seeing(pair, _sightings(world, pair, run, births)))
    travelled_m = pair.travelled_m
    starts = np.flatnonzero(travelled_m + LENGTH_M <= travelled_m[-1])[::STRIDE]
    if len(starts) == 0:
        raise TrajectoryError(f"{run.path}: its path is shorter than {LENGTH_M:g} m")
    noise = _noise(seen.residual_px)
    covariance = _least_covariance(world.rig, pair, seen, noise, run.path)
    ends = np.searchsorted(travelled_m, travelled_m[starts] + LENGTH_M)
    over_1m, least_over_1m = _rms_m(pair, covariance, starts, ends.clip(max=len(travelled_m) - 1))
    end_m, least_end_m = _rms_m(pair, covariance, np.array([0]), np.array([len(travelled_m) - 1]))
    percent, least_percent = 100 * over_1m / LENGTH_M, 100 * least_over_1m / LENGTH_M
    return Bound(noise, percent, least_percent, end_m, least_end_m, len(seen.point))


def _sightings(world: TrueWorld, pair: Pair, run: SavedRun, births: Path) -> Sightings:
    """Inliers that are on the right thing, of landmarks born in a frame with a pose."""
    tracks, frames = run.tracks, run.frames
    if tracks is None or frames is None or tracks.landmark.size == 0:
        raise TrajectoryError(f"{run.path}: its estimator shares no tracks")
    times = frames.timestamps_ns[tracks.frame]
    with np.load(births) as file:
        ids, born_ns, pixels = file["landmark"], file["timestamp_ns"], file["pixels"]
    later = np.ones(len(times), dtype=bool)
    if len(ids) == 0:  # nobody heard of births: each landmark is what it was first seen as
        ids, first = np.unique(tracks.landmark, return_index=True)
        born_ns, pixels, later[first] = times[first], tracks.pixels[first], False
    points = np.full((len(ids), 3), np.nan)
    for time in np.unique(born_ns).tolist():
        points[born_ns == time] = world.points_world(time, pixels[born_ns == time])
    known = ids[np.isfinite(points[:, 0]) & np.isin(born_ns, pair.timestamps_ns)]
    kept = tracks.inlier & later & np.isin(tracks.landmark, known)
    kept &= np.isin(times, pair.timestamps_ns)
    rows = np.searchsorted(ids, tracks.landmark[kept])
    camera = np.searchsorted(pair.timestamps_ns, times[kept])
    T_cam_world = se3.inverse(pair.T_world_cam)[camera]
    points_cam = np.einsum("mij,mj->mi", T_cam_world[:, :3, :3], points[rows])
    true = world.rig.project(points_cam + T_cam_world[:, :3, 3])
    residual = np.column_stack([tracks.pixels, tracks.disparity_px])[kept] - true
    right = np.nanmax(np.abs(residual), axis=1) < NEAR_PX
    if right.sum() < LEAST_SIGHTINGS:
        raise TrajectoryError(f"{run.path}: only {right.sum()} inliers are where they should be")
    used, point = np.unique(rows[right], return_inverse=True)
    born = np.searchsorted(pair.timestamps_ns, born_ns[used])
    return Sightings(points[used], born, camera[right], point, residual[right])


def _seeing(pair: Pair, seen: Sightings) -> tuple[Pair, Sightings]:
    """Keep the frames that see something: the others have no bound."""
    frames = np.unique(np.concatenate([seen.born, seen.camera]))
    born, camera = (np.searchsorted(frames, x) for x in (seen.born, seen.camera))
    kept = Pair(*(x[frames] for x in (pair.timestamps_ns, pair.T_world_cam, pair.T_odom_cam)))
    return kept, replace(seen, born=born, camera=camera)


def connected(pair: Pair, seen: Sightings) -> tuple[Pair, Sightings]:
    """Keep the longest stretch of frames in which landmarks cross from each frame to the next."""
    last = seen.born.copy()
    np.maximum.at(last, seen.point, seen.camera)
    crossing = np.zeros(len(pair.timestamps_ns), dtype=np.int64)
    np.add.at(crossing, seen.born, 1)
    np.subtract.at(crossing, last, 1)
    breaks = np.flatnonzero(np.cumsum(crossing)[:-1] < FEWEST_ACROSS) + 1
    edges = np.concatenate([[0], breaks, [len(crossing)]])
    longest = int(np.argmax(np.diff(edges)))
    start, end = edges[longest : longest + 2].tolist()
    inside = (start <= seen.born) & (seen.born < end)
    kept = inside[seen.point] & (seen.camera < end)
    of_stretch = slice(start, end)
    pair = Pair(*(x[of_stretch] for x in (pair.timestamps_ns, pair.T_world_cam, pair.T_odom_cam)))
    return pair, Sightings(
        seen.points_world[inside],
        seen.born[inside] - start,
        seen.camera[kept] - start,
        (np.cumsum(inside) - 1)[seen.point[kept]],
        seen.residual_px[kept],
    )


def _least_covariance(
    rig: StereoRig, pair: Pair, seen: Sightings, noise: Noise, name: Path
) -> Array:
    sigma = np.where(np.isnan(seen.residual_px), np.inf, noise.effective_px)
    at_birth = np.array([BORN_SIGMA_PX, BORN_SIGMA_PX, noise.effective_px[2]])
    try:
        return pose_covariance(
            pair.T_world_cam,
            seen.points_world,
            np.concatenate([seen.born, seen.camera]),
            np.concatenate([np.arange(len(seen.born)), seen.point]),
            np.concatenate([np.tile(at_birth, (len(seen.born), 1)), sigma]),
            rig,
        )
    except np.linalg.LinAlgError:
        raise TrajectoryError(f"{name}: its tracks do not connect all frames") from None


def _rms_m(pair: Pair, covariance: Array, starts: Indices, ends: Indices) -> tuple[float, float]:
    """Root mean square error of translation over motions, and its bound."""
    true, estimated = (
        se3.inverse(T[starts]) @ T[ends] for T in (pair.T_world_cam, pair.T_odom_cam)
    )
    off = (se3.inverse(true) @ estimated)[:, :3, 3]
    least = [
        np.trace(motion_covariance(covariance, pair.T_world_cam, a, b)[:3, :3])
        for a, b in zip(starts.tolist(), ends.tolist(), strict=True)
    ]
    return float(np.sqrt((off**2).sum(axis=1).mean())), float(np.sqrt(np.mean(least)))


def write_births(path: Path, births: Mapping[int, tuple[int, float, float]]) -> None:
    """Keep where landmarks were first seen: landmark to time, ns, and left-image (u, v)."""
    ids = np.array(sorted(births), dtype=np.int64)
    times = np.array([births[x][0] for x in ids.tolist()], dtype=np.int64)
    pixels = np.array([births[x][1:] for x in ids.tolist()]).reshape(-1, 2)
    with replacing(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, landmark=ids, timestamp_ns=times, pixels=pixels)


def _noise(residual: Array) -> Noise:
    """Fit a Student t distribution to each column of (M, 3) residuals.

    Its information on its place is (n + 1) / (n + 3) / s^2 with n degrees of freedom and scale s
    (Lange, Little and Taylor, Robust statistical modeling using the t distribution, 1989).
    """
    bias, effective = np.zeros(3), np.zeros(3)
    for k in range(3):
        known = residual[np.isfinite(residual[:, k]), k]
        n, bias[k], scale = stats.t.fit(known[:: -(-len(known) // FITTED)])
        effective[k] = scale * np.sqrt((n + 3) / (n + 1))
    return Noise(bias, effective)
