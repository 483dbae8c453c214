"""Frames of a run in Rerun: estimated path and cameras, features, map, errors and status."""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from trials.evaluation.runs import Tracks
from trials.view import rerun_sdk as rr
from trials.view.recording_log import (
    CENTRE_PX,
    LEFT,
    RIGHT,
    WORLD,
    log_cameras,
    log_step,
    points,
    transform,
)
from trials.view.run_rows import Row
from trials.view.stream import Stream
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.estimator import Estimate, PointMap, Status
from vo.contract.observations import Observations
from vo.contract.rig import StereoRig

RUNS, PLOTS, STATUS, LOG = f"{WORLD}/runs", "plots", "status", "log"
COLOURS = ((255, 122, 80), (90, 170, 255), (240, 200, 60), (110, 210, 130), (190, 150, 250))
"""RGB of runs on the viewer's dark background, in order."""
STATUS_COLOURS: Mapping[Status, int] = {
    Status.START: 0x5AAAFFFF,
    Status.TRACKED: 0x4CAF50FF,
    Status.WEAK: 0xFFB300FF,
    Status.LOST: 0xEF5350FF,
}
"""RGBA of the timeline."""
LEVELS = {Status.WEAK: "WARN", Status.LOST: "ERROR"}
OUTLIER = (150, 150, 150)
TRAIL_FRAMES = 12
"""Number of frames of which tracks are drawn."""
FEATURE_POINTS, TRAIL_POINTS, MAP_POINTS = 3.5, 1.2, 3.0
SIGMAS = 3.0
"""Half axes of ellipsoids in standard deviations, before they are magnified."""
MAGNIFICATION = 10.0
SHOWN_M = 0.05
"""Smallest size of the median ellipsoid; powers of ten magnify it up to here."""
ERRORS = {
    "translation_error_m": "translation error, m",
    "rotation_error_deg": "rotation error, °",
    "drift_pct": "drift over the next 1 m, %",
    "inliers": "inliers",
}
"""Attribute of a row to the title of its plot."""


@dataclass(frozen=True)
class RunStyle:
    """How a run is shown.

    Attributes:
        name: In legends.
        colour: RGB.
        magnification: Of the ellipsoids.
        has_status: Whether the estimator states one for each frame.
    """

    name: str
    colour: tuple[int, int, int]
    magnification: float
    has_status: bool


def run_style(
    k: int, name: str, estimates: Iterable[Estimate] = (), has_status: bool = True
) -> RunStyle:
    """Return the style of run k, whose ellipsoids are magnified by a power of ten to be seen.

    Where no covariance is known yet, it is MAGNIFICATION.
    """
    sizes_m = [
        SIGMAS * float(np.sqrt(np.linalg.eigvalsh(x.covariance[:3, :3])[-1].clip(0)))
        for x in estimates
        if x.covariance is not None
    ]
    median_m, magnification = float(np.median(sizes_m or [0.0])), MAGNIFICATION
    if median_m > 0:
        magnification = 10.0 ** max(0, int(np.ceil(np.log10(SHOWN_M / median_m))))
    return RunStyle(name, COLOURS[k % len(COLOURS)], magnification, has_status)


class RunLog:
    """Logs the frames of a run in order."""

    def __init__(self, stream: Stream, style: RunStyle, rig: StereoRig) -> None:
        """Log what has no time."""
        self._stream, self._style = stream, style
        self._place = rr.escape_entity_path_part(style.name)
        self._path = f"{RUNS}/{self._place}"
        self._last: Array | None = None
        self._status: Status | None = None
        self._trails: dict[int, deque[Array]] = {}
        log_cameras(stream, f"{self._path}/cameras", rig, np.eye(4), style.colour)
        for kind in ERRORS:
            line = rr.SeriesLines(names=style.name, colors=[list(style.colour)])
            stream.log(f"{PLOTS}/{kind}/{self._place}", line, static=True)
        if not style.has_status:
            return
        states = list(STATUS_COLOURS)
        lanes = rr.StateConfiguration(
            values=[x.value for x in states],
            colors=np.array([STATUS_COLOURS[x] for x in states], np.uint32),
        )
        stream.log(f"{STATUS}/{self._place}", lanes, static=True)

    def add(self, row: Row) -> None:
        """Log one frame."""
        self._stream.at(row.frame, row.estimate.timestamp_ns)
        self._add_pose(row.T_world_cam, row.estimate.covariance)
        self._add_observations(row.estimate.observations)
        if self._style.has_status:
            self._add_status(row.frame, row.estimate)
        for kind in ERRORS:
            self._add_value(kind, row)

    def add_drift(self, row: Row) -> None:
        """Log the drift of a frame that is logged already."""
        self._stream.at(row.frame, row.estimate.timestamp_ns)
        self._add_value("drift_pct", row)

    def _add_value(self, kind: str, row: Row) -> None:
        value: float = getattr(row, kind)
        if np.isfinite(value):
            self._stream.log(f"{PLOTS}/{kind}/{self._place}", rr.Scalars(value))

    def add_map(self, points_world: Array, grey: Array) -> None:
        """Log map points (N, 3), metres, with their brightness (N,), at the present time."""
        colours = 0.4 * grey[:, None] + 0.6 * np.array(self._style.colour)
        cloud = rr.Points3D(points_world, colors=colours.astype(np.uint8), radii=points(MAP_POINTS))
        self._stream.log(f"{self._path}/map", cloud)

    def _add_pose(self, T_world_cam: Array | None, covariance: Array | None) -> None:
        colour, style = self._style.colour, self._style
        position = None if T_world_cam is None else T_world_cam[:3, 3]
        self._last = log_step(self._stream, f"{self._path}/path", self._last, position, colour)
        if T_world_cam is None:
            return
        self._stream.log(f"{self._path}/cameras", transform(T_world_cam))
        if covariance is not None:
            half_m, T_world_axes = ellipsoid(T_world_cam, covariance)
            shape = rr.Ellipsoids3D(
                centers=[T_world_axes[:3, 3]],
                half_sizes=[half_m * style.magnification],
                quaternions=[np.roll(se3.to_quat_wxyz(T_world_axes), -1)],
                colors=[list(colour)],
            )
            name = f"covariance_{SIGMAS:g}_sigma_x{style.magnification:g}"
            self._stream.log(f"{self._path}/{name}", shape)

    def _add_observations(self, seen: Observations | None) -> None:
        """Log features and tracks; those of the frame before vanish if there are none."""
        if seen is None or not len(seen.ids):
            if not self._trails:
                return
            seen = Observations(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0))
        colours = disparity_colours(seen)
        self._points(f"{LEFT}/features/{self._place}", seen.pixels, colours)
        has_match = np.isfinite(seen.disparity_px)
        right = (seen.pixels - np.stack([seen.disparity_px, 0 * seen.disparity_px], -1))[has_match]
        self._points(f"{RIGHT}/features/{self._place}", right, colours[has_match])
        trails, shown = self._extended(seen.ids, seen.pixels), seen.inlier
        strips = [x for x, is_inlier in zip(trails, shown, strict=True) if is_inlier]
        tracks = rr.LineStrips2D(strips, colors=colours[shown], radii=points(TRAIL_POINTS))
        self._stream.log(f"{LEFT}/tracks/{self._place}", tracks)

    def _points(self, path: str, pixels: Array, colours: Array) -> None:
        cloud = rr.Points2D(pixels + CENTRE_PX, colors=colours, radii=points(FEATURE_POINTS))
        self._stream.log(path, cloud)

    def _extended(self, ids: Indices, pixels: Array) -> list[Array]:
        """Return the tracks of landmarks (N,) with their new pixels (N, 2); forget others."""
        trails = {int(k): self._trails.get(int(k), deque(maxlen=TRAIL_FRAMES)) for k in ids}
        for trail, place in zip(trails.values(), pixels + CENTRE_PX, strict=True):
            trail.append(place)
        self._trails = trails
        return [np.array(x) for x in trails.values()]

    def _add_status(self, frame: int, estimate: Estimate) -> None:
        status = estimate.status
        if status is not self._status:
            state = rr.StateChange(state=status.value)
            self._stream.log(f"{STATUS}/{self._place}", state)
        if status is not self._status or status in LEVELS:
            text = f"frame {frame}: {status.value}" + f": {estimate.reason}" * bool(estimate.reason)
            level = LEVELS.get(status, "INFO")
            self._stream.log(f"{LOG}/{self._place}", rr.TextLog(text, level=level))
        self._status = status


def ellipsoid(T_world_cam: Array, covariance: Array) -> tuple[Array, Array]:
    """Return half axes (3,) of the position's ellipsoid, m, and their pose (4, 4).

    They are SIGMAS standard deviations. The covariance (6, 6) is of a tangent (v m, w rad) in the
    camera's frame.
    """
    variances, axes = np.linalg.eigh(covariance[:3, :3])
    axes[:, 2] *= np.sign(np.linalg.det(axes))  # a rotation
    R_world_axes = T_world_cam[:3, :3] @ axes
    return SIGMAS * np.sqrt(variances.clip(0)), se3.pose(R_world_axes, T_world_cam[:3, 3])


def disparity_colours(seen: Observations) -> Array:
    """Return RGB (N, 3) uint8 by the rank of the disparity, warm for near; outliers are grey.

    A feature has one colour in both images.
    """
    known = np.isfinite(seen.disparity_px)
    rank = np.argsort(np.argsort(seen.disparity_px)) / max(int(known.sum()) - 1, 1)
    lookup = (25 + 205 * rank.clip(max=1)).astype(np.uint8)[None]
    bgr = cv2.applyColorMap(lookup, cv2.COLORMAP_TURBO)[0] if len(seen.ids) else np.zeros((0, 3))
    colours = np.array(bgr, np.uint8)[:, ::-1].copy()
    colours[~(seen.inlier & known)] = OUTLIER
    return colours


def first_seen_ns(points_of: PointMap, tracks: Tracks, times_ns: Indices) -> Indices:
    """Return the times (N,) at which map points were first observed; that of frame 0 if never.

    The frames of the tracks are at `times_ns`.
    """
    landmarks, first = np.unique(tracks.landmark, return_index=True)  # frames do not decrease
    row = np.searchsorted(landmarks, points_of.ids).clip(max=max(len(landmarks) - 1, 0))
    if not len(landmarks):
        return np.full(len(points_of.ids), times_ns[0])
    frame = np.where(landmarks[row] == points_of.ids, tracks.frame[first[row]], 0)
    return times_ns[frame]
