"""Motion of image points between any two frames, and through all frames."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from driftyard.dataset import Dataset, PathLike, dataset_of
from driftyard.failures import in_one_family
from sim.dataset.image_codecs import encode_png
from sim.labels.labels import VISIBLE
from sim.preview.colours import flow_colours, round_up
from sim.truth.tracks import Tracks, query, track
from vo.contract.arrays import Array, Image, Mask
from vo.contract.errors import SettingsError


@dataclass(frozen=True, repr=False, eq=False)
class Flow:
    """Motion of each pixel's point from one frame to another.

    Attributes:
        flow: (H, W, 2) float32 du, dv in pixels; that of the sky is that of a point at infinity.
            NaN where the point is behind the other camera, or on what deforms or is seen through.
        depth_m: (H, W) float32 depth of the point in the other frame; NaN for the sky.
        covisibility: (H, W) uint8 whether the other frame shows the point: 0 visible, 1 hidden by
            a surface that is nearer by more than 1 %, 2 out of view, 3 no surface or unknown
            motion, 4 an outline within a pixel hides it or not.

    Example:
        >>> far = dy.flow(ds, 0, len(ds) - 1)
        >>> far.flow.shape == (ds.rig.height_px, ds.rig.width_px, 2)
        True
        >>> bool(np.isfinite(far.flow[far.visible]).all())
        True
    """

    flow: Array
    depth_m: Array
    covisibility: Image

    @property
    def visible(self) -> Mask:
        """(H, W) whether both frames show the point."""
        return self.covisibility == VISIBLE

    def _repr_png_(self) -> bytes:
        lengths = np.hypot(*np.moveaxis(self.flow, -1, 0))
        full_px = round_up(max(float(np.nanmax(lengths, initial=0.0)), 0.1))
        return encode_png(flow_colours(self.flow, full_px))

    def __repr__(self) -> str:
        height, width = self.covisibility.shape
        return f"Flow({width} x {height} px, {self.visible.mean():.0%} visible in both frames)"


@in_one_family
def flow(dataset: Dataset | PathLike, i: int, j: int) -> Flow:
    """Return the exact motion of the left image's points from frame i to frame j, any two frames.

    It follows from depth, the camera's poses and the motion of objects. If labels do not tell
    which pixels of frame i are static, or some are not, the drive is simulated and its geometry
    rendered again, on first use, which takes seconds. `j` may be before `i`.

    Raises:
        DatasetError: If the recording has no depth, no true poses, or cannot be simulated again.
        FrameIndexError: If there is no such frame.
        GraphicsError: If geometry must be rendered, and there is no OpenGL.

    Example:
        >>> label, motion = ds.flow(2), dy.flow(ds, 2, 3)
        >>> bool(np.nanmax(abs(label[..., :2] - motion.flow)) < 1e-3)
        True
        >>> back = dy.flow(ds, 3, 2)
        >>> bool(np.nanmedian(motion.flow[..., 1]) > 0 > np.nanmedian(back.flow[..., 1]))
        True
    """
    ds = dataset_of(dataset)
    motion, covisibility = ds.views.motion(ds.row(i), ds.row(j))
    return Flow(motion[..., :2], motion[..., 2], covisibility)


@in_one_family
def tracks(dataset: Dataset | PathLike, points: ArrayLike | int = 16, frame: int = 0) -> Tracks:
    """Follow points of the left image of one frame through all frames.

    Args:
        dataset: An open recording, of which the chosen frames are used, or its folder.
        points: (N, 2) u, v in pixels, or the spacing of a grid of points in pixels.
        frame: Index of the frame in which they are given.

    Raises:
        SettingsError: If a point is outside of the image, or the spacing is not positive.
        DatasetError: If the recording has no true poses, no depth, or cannot be simulated again.
        FrameIndexError: If there is no such frame.
        GraphicsError: If geometry must be rendered, and there is no OpenGL.

    Example:
        >>> dy.tracks(ds, 20, frame=3)
        Tracks(48 points, ...)
    """
    ds = dataset_of(dataset)
    row = ds.row(frame)
    pixels = _query_pixels(points, ds.views.rig.width_px, ds.views.rig.height_px)
    views = ds.views
    replayed = not views.are_static(row, np.rint(pixels).astype(np.int64))
    with views.opened(replayed) as view:
        followed = (view(k) for k in range(len(ds)))
        return track(query(view(row), pixels), row, pixels, ds.timestamps_ns, followed)


def _query_pixels(points: ArrayLike | int, width_px: int, height_px: int) -> Array:
    try:
        given = np.asarray(points, dtype=float)
    except (TypeError, ValueError):
        raise SettingsError("points: expected numbers, (N, 2) u, v or a spacing") from None
    if given.ndim == 0:
        spacing = float(given)
        if not spacing >= 1:
            raise SettingsError(f"points: a spacing of {points} px; expected at least 1")
        u, v = (np.arange((n - 1) % spacing / 2, n, spacing) for n in (width_px, height_px))
        given = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    if given.ndim != 2 or given.shape[1] != 2:
        raise SettingsError(f"points: shape {given.shape}; expected (N, 2) u, v or a spacing")
    inside = ((given >= 0) & (given <= (width_px - 1, height_px - 1))).all(axis=1)
    for k in np.flatnonzero(~inside)[:1]:
        u, v = given[k]
        size = f"0 to {width_px - 1} and 0 to {height_px - 1}"
        raise SettingsError(f"points: row {k}, ({u:g}, {v:g}), is outside the image: {size} px")
    return given
