"""Point tracks: where the points that one frame shows are in every frame, and what hides them.

The form is that of TAP-Vid (Doersch et al., TAP-Vid: A Benchmark for Tracking Any Point in a
Video, 2022): positions of N points in T frames, and flags.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.labels.labels import EDGE, NOTHING, VISIBLE, nearness_at, visibility
from sim.labels.views import View, motions_between
from vo.contract import se3
from vo.contract.arrays import Array, Image, Indices, Mask
from vo.contract.files import known_suffix, replacing
from vo.contract.rig import StereoRig


@dataclass(frozen=True, repr=False, eq=False)
class Tracks:
    """Tracks of N query points through T frames.

    Attributes:
        rig: True camera; the right image shows a point at u - f b / depth.
        timestamps_ns: (T,) of the frames.
        queries: (N, 3) frame, u, v of each query.
        pixels: (N, T, 2) float64 u, v in the left images, also where the point is hidden or out of
            view; NaN behind the camera and where its motion is unknown.
        depth_m: (N, T) float64 along the optical axis; NaN for the sky.
        visibility: (N, T) uint8 codes as of `covisibility`: 0 visible, 1 hidden, 2 out of view, 3
            no surface or unknown motion, 4 an outline within a pixel hides it or not.
        points_world: (N, T, 3) float64 positions in the world, metres; NaN for the sky.

    Example:
        >>> tracks = dy.tracks(ds, [[40.0, 90.0], [120.5, 100.25]])
        >>> tracks.pixels.shape == (2, len(ds), 2) and tracks.pixels[1, 0].tolist()
        [120.5, 100.25]
        >>> tracks.occluded[:, 0].tolist()
        [False, False]
        >>> tracks.save("tracks.npz").name
        'tracks.npz'
    """

    rig: StereoRig
    timestamps_ns: Indices
    queries: Array
    pixels: Array
    depth_m: Array
    visibility: Image
    points_world: Array

    @property
    def occluded(self) -> Mask:
        """(N, T) whether a frame does not show the point: hidden, out of view or of no surface.

        Where an outline within a pixel makes it undecidable, it is True, and so is `undecided`.
        """
        return self.visibility != VISIBLE

    @property
    def undecided(self) -> Mask:
        """(N, T) whether pixels cannot tell if the point is hidden: an outline is too near."""
        return self.visibility == EDGE

    @property
    def pixels_right(self) -> Array:
        """(N, T, 2) float64 u, v in the right images of the ideal, rectified pair."""
        disparity_px = self.rig.f_px * self.rig.baseline_m / self.depth_m
        return self.pixels - np.stack([disparity_px, np.zeros_like(disparity_px)], axis=-1)

    def save(self, path: Path | str) -> Path:
        """Write a `.npz` of NumPy; return its path.

        Its arrays are `points` (N, T, 2), `occluded` (N, T) and `query_points` (N, 3) frame, v, u
        as TAP-Vid names them, in pixels with centres on integers, and those of this class.

        Raises:
            SettingsError: If the name has another suffix.
            DatasetError: If the file cannot be written.
        """
        out = Path(path)
        known_suffix(out, (".npz",))
        with replacing(out) as partial, partial.open("wb") as file:
            np.savez_compressed(
                file,
                points=self.pixels.astype(np.float32),
                occluded=self.occluded,
                query_points=self.queries[:, [0, 2, 1]],
                visibility=self.visibility,
                depth_m=self.depth_m.astype(np.float32),
                points_world=self.points_world.astype(np.float32),
                timestamps_ns=self.timestamps_ns,
                K=self.rig.K,
                baseline_m=self.rig.baseline_m,
            )
        return out

    def __repr__(self) -> str:
        points, frames = self.visibility.shape
        share = float(np.mean(~self.occluded)) if points else 0.0
        return f"Tracks({points} points, {frames} frames, {share:.0%} visible)"


@dataclass(frozen=True)
class Queries:
    """Query points (N,) that a view shows: rays, 1 / depth, bodies, and whether these are known."""

    view: View
    rays: Array
    nearness: Array
    bodies: Indices
    known: Mask


def query(view: View, pixels: Array) -> Queries:
    """Find what a view shows at (N, 2) u, v inside the image.

    Between pixels, the surface of the nearest one continues by its slope.
    """
    rig, (u, v) = view.rig, np.rint(pixels).astype(np.int64).T
    rays = np.column_stack([rig.normalized(pixels), np.ones(len(pixels))])
    nearness = nearness_at(view.depth_m, pixels)
    unknown = np.zeros(len(u), bool) if view.unpredicted is None else view.unpredicted[v, u]
    return Queries(view, rays, nearness, view.body_of[view.numbers[v, u]], ~unknown)


def track(
    queries: Queries, row: int, pixels: Array, times_ns: Indices, views: Iterable[View]
) -> Tracks:
    """Follow points, seen at `pixels` (N, 2) in the frame `row`, through the views of T frames."""
    view, count, frames = queries.view, len(pixels), len(times_ns)
    rig = view.rig
    found = np.full((count, frames, 2), np.nan)
    depths, world = np.full((count, frames), np.nan), np.full((count, frames, 3), np.nan)
    codes = np.full((count, frames), NOTHING, np.uint8)
    known, is_sky = queries.known, queries.nearness <= 0
    for t, then in enumerate(views):
        T = motions_between(view, then)[queries.bodies]
        # A point at infinity, of the sky, is a direction: it turns, and is not displaced.
        ahead = (T[:, :3, :3] @ queries.rays[:, :, None])[..., 0]
        ahead += T[:, :3, 3] * queries.nearness[:, None]
        seen = known & (ahead[:, 2] > 0)
        found[seen, t] = rig.project(ahead[seen])[:, :2]
        with np.errstate(divide="ignore"):
            depths[:, t] = np.where(seen & ~is_sky, ahead[:, 2] / queries.nearness, np.nan)
            points_cam = ahead / np.where(is_sky, np.nan, queries.nearness)[:, None]
        world[known, t] = se3.transform(then.T_world_cam, points_cam[known])
        where = np.column_stack([found[:, t], depths[:, t]])
        codes[known, t] = visibility(where, then.surface_m)[known]
    found[:, row], codes[known & ~is_sky, row] = pixels, VISIBLE
    times_queries = np.column_stack([np.full(count, float(row)), pixels])
    return Tracks(rig, times_ns, times_queries, found, depths, codes, world)
