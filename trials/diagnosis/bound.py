"""Cramér–Rao bound of the pose errors of a run, for its own tracks and measurement noise.

Tracks, geometry and noise are those of the run: its observations of landmarks and their errors
against the truth. The bound does not cover biased or correlated errors, nor that a pose is
estimated before later frames are available.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import stats

from trials.diagnosis.hooks import MAX_MATCH_PX
from trials.evaluation.alignment import Pair, associate
from trials.evaluation.information import motion_covariance, pose_covariance
from trials.evaluation.runs import SavedRun
from trials.evaluation.truth import TrueWorld, true_trajectory
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import TrajectoryError
from vo.contract.files import replacing

FIRST_SIGMA_PX = 0.01
"""Std. dev. of u and v of the first observation, px: it defines the landmark and has no error."""

MAX_FITTED = 4000
"""Largest number of residuals to which a distribution is fitted."""

MIN_OBSERVATIONS = 100
"""Number of observations below which the noise is not estimated."""

MIN_CROSSING = 6
"""Number of landmarks observed before and after a gap that connect its two sides."""

LENGTH_M = 1.0
STRIDE = 5
"""Frames between the starts of two segments."""


@dataclass(frozen=True)
class Bound:
    """Translation errors of a run and their bounds, root mean squares over motions.

    If the tracks do not connect all frames, of the longest sequence of frames that they connect.

    Attributes:
        over_1m_percent: Error over 1 m, %.
        bound_over_1m_percent: Its bound.
        end_m: Error of the motion from the first to the last pose.
        bound_end_m: Its bound.
        noise_px: Std. dev. of u, v and disparity: of a Gaussian with the Fisher information of the
            Student t distributions that model the errors.
        bias_px: Of the same.
        observations: Number of observations of landmarks.
    """

    over_1m_percent: float
    bound_over_1m_percent: float
    end_m: float
    bound_end_m: float
    noise_px: tuple[float, ...]
    bias_px: tuple[float, ...]
    observations: int


@dataclass(frozen=True)
class TrueTracks:
    """Observations of landmarks whose true positions are known.

    Attributes:
        points_world: (J, 3) metres.
        born: (J,) frame of the first observation of each.
        camera: (M,) frame of each later observation.
        point: (M,) its landmark.
        residual_px: (M, 3) measured minus true u, v and disparity; NaN where not measured.
    """

    points_world: Array
    born: Indices
    camera: Indices
    point: Indices
    residual_px: Array


def bound(dataset: Path, run: SavedRun, births: Path) -> Bound:
    """Compute the errors of a run with tracks and their Cramér–Rao bounds.

    The dataset has depth labels, the file of births is that of `write_births`.

    Raises:
        DatasetError: If the dataset has no labels or no ground truth.
        TrajectoryError: If the run has no tracks, they do not connect its frames, or it is shorter
            than 1 m.
    """
    world, pair = TrueWorld(dataset), associate(true_trajectory(dataset), run.trajectory)
    pair, seen = connected(*_observing(pair, _true_tracks(world, pair, run, births)))
    travelled_m = pair.travelled_m
    starts = np.flatnonzero(travelled_m + LENGTH_M <= travelled_m[-1])[::STRIDE]
    if len(starts) == 0:
        raise TrajectoryError(f"{run.path}: its path is shorter than {LENGTH_M:g} m")
    noise_px, bias_px = _noise(seen.residual_px)
    sigma = np.where(np.isnan(seen.residual_px), np.inf, noise_px)
    at_birth = np.array([FIRST_SIGMA_PX, FIRST_SIGMA_PX, noise_px[2]])
    try:
        covariance = pose_covariance(
            pair.T_world_cam,
            seen.points_world,
            np.concatenate([seen.born, seen.camera]),
            np.concatenate([np.arange(len(seen.born)), seen.point]),
            np.concatenate([np.tile(at_birth, (len(seen.born), 1)), sigma]),
            world.rig,
        )
    except np.linalg.LinAlgError:
        raise TrajectoryError(f"{run.path}: the tracks do not connect all frames") from None
    last = len(travelled_m) - 1
    ends = np.searchsorted(travelled_m, travelled_m[starts] + LENGTH_M).clip(max=last)
    over_1m, bound_1m = (100 * x / LENGTH_M for x in _rms_m(pair, covariance, starts, ends))
    end_m, bound_m = _rms_m(pair, covariance, np.array([0]), np.array([last]))
    noise, bias = (tuple(x.tolist()) for x in (noise_px, bias_px))
    return Bound(over_1m, bound_1m, end_m, bound_m, noise, bias, len(seen.point))


def _true_tracks(world: TrueWorld, pair: Pair, run: SavedRun, births: Path) -> TrueTracks:
    """Return correct inliers of landmarks first observed in a frame with a pose."""
    tracks, frames = run.tracks, run.frames
    if tracks is None or frames is None or tracks.landmark.size == 0:
        raise TrajectoryError(f"{run.path}: the run has no tracks")
    times = frames.timestamps_ns[tracks.frame]
    with np.load(births) as file:
        ids, born_ns, pixels = file["landmark"], file["timestamp_ns"], file["pixels"]
    later = np.ones(len(times), dtype=bool)
    if len(ids) == 0:  # no hooks: a landmark is defined by its first observation
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
    right = np.nanmax(np.abs(residual), axis=1) < MAX_MATCH_PX
    if right.sum() < MIN_OBSERVATIONS:
        raise TrajectoryError(
            f"{run.path}: only {right.sum()} inliers are correct, {MIN_OBSERVATIONS} are needed"
        )
    used, point = np.unique(rows[right], return_inverse=True)
    born = np.searchsorted(pair.timestamps_ns, born_ns[used])
    return TrueTracks(points[used], born, camera[right], point, residual[right])


def _observing(pair: Pair, seen: TrueTracks) -> tuple[Pair, TrueTracks]:
    """Keep the frames with observations; the others have no bound."""
    frames = np.unique(np.concatenate([seen.born, seen.camera]))
    born, camera = (np.searchsorted(frames, x) for x in (seen.born, seen.camera))
    return pair.at(frames), replace(seen, born=born, camera=camera)


def connected(pair: Pair, seen: TrueTracks) -> tuple[Pair, TrueTracks]:
    """Keep the longest sequence of frames whose successive frames share MIN_CROSSING landmarks."""
    last = seen.born.copy()
    np.maximum.at(last, seen.point, seen.camera)
    crossing = np.zeros(len(pair.timestamps_ns), dtype=np.int64)
    np.add.at(crossing, seen.born, 1)
    np.subtract.at(crossing, last, 1)
    breaks = np.flatnonzero(np.cumsum(crossing)[:-1] < MIN_CROSSING) + 1
    edges = np.concatenate([[0], breaks, [len(crossing)]])
    longest = int(np.argmax(np.diff(edges)))
    start, end = edges[longest : longest + 2].tolist()
    inside = (start <= seen.born) & (seen.born < end)
    kept = inside[seen.point] & (seen.camera < end)
    return pair.at(slice(start, end)), TrueTracks(
        seen.points_world[inside],
        seen.born[inside] - start,
        seen.camera[kept] - start,
        (np.cumsum(inside) - 1)[seen.point[kept]],
        seen.residual_px[kept],
    )


def _rms_m(pair: Pair, covariance: Array, starts: Indices, ends: Indices) -> tuple[float, float]:
    """Return the root mean square error of translation over motions, and its bound."""
    error = pair.motion_errors(starts, ends)[:, :3, 3]
    bounds = [
        np.trace(motion_covariance(covariance, pair.T_world_cam, a, b)[:3, :3])
        for a, b in zip(starts.tolist(), ends.tolist(), strict=True)
    ]
    return float(np.sqrt((error**2).sum(axis=1).mean())), float(np.sqrt(np.mean(bounds)))


def write_births(path: Path, births: Mapping[int, tuple[int, float, float]]) -> None:
    """Write the first observations: landmark to time, ns, and left-image (u, v)."""
    ids = np.array(sorted(births), dtype=np.int64)
    times = np.array([births[x][0] for x in ids.tolist()], dtype=np.int64)
    pixels = np.array([births[x][1:] for x in ids.tolist()]).reshape(-1, 2)
    with replacing(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, landmark=ids, timestamp_ns=times, pixels=pixels)


def _noise(residual: Array) -> tuple[Array, Array]:
    """Fit a Student t distribution to each column of (M, 3) residuals; return sigma and bias (3,).

    Its Fisher information on location is (n + 1) / (n + 3) / s^2 with n degrees of freedom, scale s
    (Lange, Little and Taylor, Robust statistical modeling using the t distribution, 1989).
    """
    sigma, bias = np.zeros((2, 3))
    for k in range(3):
        known = residual[np.isfinite(residual[:, k]), k]
        n, bias[k], scale = stats.t.fit(known[:: -(-len(known) // MAX_FITTED)])
        sigma[k] = scale * np.sqrt((n + 3) / (n + 1))
    return sigma, bias
