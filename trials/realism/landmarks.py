"""Statistics of a run of the estimator: landmarks, matches, and what patches show at them."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from trials.evaluation.runs import SavedRun, Tracks
from trials.realism.quantities import QUANTITIES, SHIFT_R2, Statistic
from trials.realism.sharpness import sample_inside
from trials.realism.vignetting import LightPairs, vignetting_by_frame
from vo.contract.arrays import Array, Image, Indices
from vo.contract.rig import StereoRig

HALF_PX = 4
"""Half side of the patches that are compared."""
CELLS = (8, 6)
"""Columns and rows of the cells in which landmarks are counted."""
DARK = 0.002
"""Mean linear light below which a patch tells nothing about gains."""


@dataclass(frozen=True)
class Patches:
    """What N landmarks of a frame with a disparity look like.

    Attributes:
        ids: (N,) landmarks.
        pixels: (N, 2) places in the left image; right_pixels those in the right one.
        left: (N, P) grey levels around them, and right.
        light: (N, 2) mean linear light of left and right.
    """

    ids: Indices
    pixels: Array
    right_pixels: Array
    left: Array
    right: Array
    light: Array


_NO_PATCH, _NO_PLACE = np.zeros((0, (2 * HALF_PX + 1) ** 2)), np.zeros((0, 2))
NO_PATCHES = Patches(np.zeros(0, np.int64), _NO_PLACE, _NO_PLACE, _NO_PATCH, _NO_PATCH, _NO_PLACE)
"""Patches of an unreadable image."""


def cut_patches(
    images: tuple[Image, Image], tracks: Tracks, frame: int, decode: Callable[[Image], Array]
) -> Patches:
    """Cut the patches of the inliers of a frame, which are whole in both images."""
    rows = (tracks.frame == frame) & tracks.inlier & np.isfinite(tracks.disparity_px)
    pixels = tracks.pixels[rows].astype(np.float64)
    shift = np.stack([tracks.disparity_px[rows], np.zeros(len(pixels))], axis=1)
    places = pixels, pixels - shift
    grey = [_cut(image, at) for image, at in zip(images, places, strict=True)]
    light = [_cut(decode(x), at).mean(axis=1) for x, at in zip(images, places, strict=True)]
    whole = np.isfinite(grey[0]).all(axis=1) & np.isfinite(grey[1]).all(axis=1)
    parts = tracks.landmark[rows], *places, *grey, np.stack(light, axis=1)
    return Patches(*(x[whole] for x in parts))


def run_statistics(run: SavedRun, frames: int) -> dict[str, Statistic]:
    """Return what the run itself tells: counts, disparities, track lengths and image motion."""
    tracks, table = run.tracks, run.frames
    if tracks is None or table is None or not len(tracks.frame):
        return {}
    found: dict[str, Statistic] = {}
    known = np.isfinite(tracks.disparity_px)
    found["stereo_matches"] = per_frame(np.bincount(tracks.frame[known], minlength=frames))
    if {"matches", "consensus"} <= table.counts.keys():
        matches, agreed = (np.nan_to_num(table.counts[x]) for x in ("matches", "consensus"))
        found["matches"] = per_frame(np.where(np.arange(frames) > 0, matches, np.nan))
        found["inlier_ratio"] = Statistic(agreed[:, None], matches[:, None])
    found["disparity"] = histogram(
        "disparity", tracks.disparity_px[known], tracks.frame[known], frames
    )
    order = np.lexsort((tracks.frame, tracks.landmark))
    ids, at = tracks.landmark[order], tracks.frame[order]
    starts = np.flatnonzero(np.r_[True, np.diff(ids) != 0])
    lengths = np.diff(np.r_[starts, len(ids)])
    found["track_length"] = histogram("track_length", lengths, at[starts], frames)
    follows = (np.diff(ids) == 0) & (np.diff(at) == 1)
    moved = np.linalg.norm(np.diff(tracks.pixels[order], axis=0), axis=1)[follows]
    found["motion"] = histogram("motion", moved, at[1:][follows], frames)
    return found


def landmarks_of(run: SavedRun) -> Array:
    """Return columns, rows and disparities (N, 3), px, of the inliers of all frames."""
    tracks = run.tracks
    if tracks is None:
        return np.zeros((0, 3))
    known = tracks.inlier & np.isfinite(tracks.disparity_px)
    return np.column_stack([tracks.pixels[known], tracks.disparity_px[known]]).astype(np.float64)


def steps_of(run: SavedRun) -> tuple[Array, Array]:
    """Return distances, m, and turns about the image's vertical, radians, (N,) each.

    Both are from pose to pose.
    """
    T_ref_cam = run.trajectory.T_ref_frame
    T_cam_next = np.linalg.inv(T_ref_cam[:-1]) @ T_ref_cam[1:]
    turns = np.arctan2(T_cam_next[:, 0, 2], T_cam_next[:, 2, 2])
    return np.linalg.norm(T_cam_next[:, :3, 3], axis=1), turns


def coverage(pixels: Array, rig: StereoRig) -> float:
    """Return the share of the cells of an image that hold one of N pixels (N, 2)."""
    cell = (pixels + 0.5) / (rig.width_px, rig.height_px) * CELLS
    column, row = np.clip(cell.astype(int), 0, np.array(CELLS) - 1).T
    return len(np.unique(row * CELLS[0] + column)) / (CELLS[0] * CELLS[1])


def patch_statistics(patches: list[Patches], rig: StereoRig) -> dict[str, Statistic]:
    """Return residuals after alignment, the gain of the right eye, and the vignetting."""
    frames = len(patches)
    frame = np.repeat(np.arange(frames), [len(x.ids) for x in patches])
    residual = np.concatenate([_residual(x.left, x.right) for x in patches])
    found = {"stereo_residual": histogram("stereo_residual", residual, frame, frames)}
    residuals, at = [np.zeros(0)], [np.zeros(0, np.int64)]
    for i, (before, now) in enumerate(pairwise(patches), 1):
        _, old, new = np.intersect1d(before.ids, now.ids, return_indices=True)
        residuals.append(_residual(before.left[old], now.left[new]))
        at.append(np.full(len(old), i))
    found["residual"] = histogram("residual", np.concatenate(residuals), np.concatenate(at), frames)
    light = np.concatenate([x.light for x in patches])
    places = [np.concatenate([getattr(x, k) for x in patches]) for k in ("pixels", "right_pixels")]
    bright = light.min(axis=1, initial=1) > DARK
    light, frame = light[bright], frame[bright]
    centre = np.array([rig.cx_px, rig.cy_px])
    far = np.maximum(centre, (rig.width_px - 1, rig.height_px - 1) - centre)
    r2 = np.stack([((x[bright] - centre) ** 2).sum(axis=1) for x in places], axis=1) / (far @ far)
    ratio = np.log(light[:, 1] / light[:, 0])
    pairs = LightPairs(r2, ratio, np.zeros(len(frame), np.int64), frame)
    weights, weighted = vignetting_by_frame(pairs, frames)
    found["vignetting"] = Statistic(weighted[:, None], weights[:, None])
    shifts = np.bincount(frame, abs(r2[:, 0] - r2[:, 1]), frames)[:, None]
    vignetting = weighted.sum() / weights.sum() if weights.any() else 0.0
    fall_off = np.log1p(-np.clip(vignetting, -1, 0.99) * r2)
    gain = np.exp(ratio - fall_off[:, 1] + fall_off[:, 0])
    groups = np.split(gain, np.searchsorted(frame, range(1, frames)))
    medians = np.array([np.median(x) if len(x) else 0.0 for x in groups])[:, None]
    count = np.bincount(frame, minlength=frames)[:, None].astype(np.float64)
    found["right_gain"] = Statistic(medians * count, count)
    found[SHIFT_R2] = Statistic(shifts, count)
    return found


def histogram(name: str, values: Array, frame: Indices, frames: int) -> Statistic:
    """Count values (N,) of frames (N,) in the bins of a quantity; the last bin is open."""
    x = QUANTITIES[name].x
    width = x[1] - x[0]
    bins = np.clip((values - x[0]) / width + 0.5, 0, len(x) - 1).astype(np.int64)
    counts = np.bincount(frame * len(x) + bins, minlength=frames * len(x))
    return Statistic(counts.reshape(frames, len(x)).astype(np.float64))


def per_frame(values: Array) -> Statistic:
    """Average values (F,) over the frames in which they are known."""
    known = np.isfinite(values)[:, None].astype(np.float64)
    return Statistic(np.nan_to_num(values)[:, None], known)


def _cut(image: Array, pixels: Array) -> Array:
    """Sample (N, P) values around pixels (N, 2); NaN beyond the image."""
    side = np.arange(-HALF_PX, HALF_PX + 1)
    offsets = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    return sample_inside(image.astype(np.float32), pixels[:, None] + offsets).astype(np.float64)


def _residual(first: Array, second: Array) -> Array:
    """Return the standard deviation (N,) of the difference of patches (N, P), each."""
    return (first - second).std(axis=1)
