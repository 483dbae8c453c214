"""Report of runs on one dataset, as an HTML page, with stills of the observed landmarks."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from trials.evaluation.alignment import Alignment, Pair, associate, fit
from trials.evaluation.mismatch import remark_mismatches
from trials.evaluation.runs import SavedRun, Tracks
from trials.evaluation.score import score_run
from trials.evaluation.truth import true_trajectory
from trials.report.charts import drift_by_length, error_over_distance, stage_counts, stage_timings
from trials.report.html import data_uri, write_html
from trials.report.trajectory_plot import plot_trajectories, read_scene_map
from vo.contract.arrays import Array, Image, Indices
from vo.contract.sequence import StereoSequence
from vo.contract.trajectory import Trajectory
from vo.recordings.pairing import FrameSelection
from vo.recordings.readers import open_sequence

WIDTH_PX = 800
TRAIL_FRAMES = 12
OUTLIER, UNKNOWN = (150, 150, 150), (235, 235, 235)
"""BGR of outliers, and of landmarks without a disparity."""


def write_report(dataset: Path, runs: Sequence[SavedRun], out: Path) -> None:
    """Write one HTML file without references to other files or the network.

    The first of the runs, at least one, is shown in detail.

    Raises:
        DatasetError: If the dataset is unreadable or has no ground truth.
        TrajectoryError: If a run and the truth share fewer than two times.
    """
    sequence = open_sequence(dataset, FrameSelection(skip_missing=True, tolerance_ms=np.inf))
    truth = true_trajectory(dataset)
    runs = with_distinct_names(runs)
    main, table = runs[0], runs[0].frames
    for run in runs:
        remark_mismatches(truth, run, sequence.rig.T_body_cam)
    scores = [score_run(truth, run, len(sequence)) for run in runs]
    pairs, alignment, positions = aligned_positions(truth, runs)
    charts = [error_over_distance(pairs, alignment)]
    if scores[0].segments:
        charts.append(drift_by_length(scores))
    if table is not None and table.counts:
        charts.append(stage_counts(table))
    if table is not None and table.timings_ms:
        charts.append(stage_timings(table))
    write_html(
        out,
        "page.html.j2",
        name=sequence.name,
        duration_s=(sequence.timestamps_ns[-1] - sequence.timestamps_ns[0]) / 1e9,
        scores=scores,
        main=scores[0],
        trajectories=plot_trajectories(
            pairs[main.estimator],
            positions,
            read_scene_map(dataset),
            alignment,
        ),
        charts=charts,
        stills=stills(sequence, main),
        trail_frames=TRAIL_FRAMES,
        records=[(run.estimator, json.dumps(dict(run.about), indent=1)) for run in runs],
    )


def aligned_positions(
    truth: Trajectory, runs: Sequence[SavedRun]
) -> tuple[dict[str, Pair], Alignment, dict[str, Array]]:
    """Align runs of distinct names: pairs with the truth, how, and positions (M, 3) in the world.

    Raises:
        TrajectoryError: If a run and the truth share fewer than two times.
    """
    pairs = {run.estimator: associate(truth, run.trajectory) for run in runs}
    # Without attitude, a first pose does not align anything.
    alignment = Alignment.FIRST_POSE if truth.point_cam is None else Alignment.SE3
    fitted = {x: fit(pair, alignment).map(pair.T_odom_cam) for x, pair in pairs.items()}
    return pairs, alignment, {x: T_world_cam[:, :3, 3] for x, T_world_cam in fitted.items()}


def with_distinct_names(runs: Sequence[SavedRun]) -> list[SavedRun]:
    """Add the file name to the names of runs of the same estimator, or a number if it is equal."""
    names = [run.estimator for run in runs]
    files = [f"{run.estimator} ({run.path.stem})" for run in runs]
    distinct: list[SavedRun] = []
    for k, (run, name, file) in enumerate(zip(runs, names, files, strict=True), 1):
        numbered = f"{name} ({k})" if files.count(file) > 1 else file
        distinct.append(replace(run, estimator=name if names.count(name) == 1 else numbered))
    return distinct


@dataclass(frozen=True)
class Still:
    """An annotated JPEG as a data URI, with its frame, time and counts as a caption."""

    uri: str
    caption: str


def stills(sequence: StereoSequence, run: SavedRun, count: int = 4) -> list[Still]:
    """Draw frames at even intervals of the run, and the one with the fewest inliers.

    Returns:
        At most `count` stills in order of time; none if the run has no tracks.
    """
    if run.tracks is None or len(run.tracks.frame) == 0:
        return []
    frame = run.tracks.frame
    inliers = np.bincount(frame[run.tracks.inlier], minlength=int(frame.max()) + 1)
    seen = np.unique(frame)
    even = seen[((np.arange(count - 1) + 0.5) / (count - 1) * len(seen)).astype(int)]
    hardest = seen[np.argmin(inliers[seen])]
    chosen = np.unique([*even, hardest]).tolist()
    return [x for i in chosen if (x := _still(sequence, run, run.tracks, i)) is not None]


def _still(sequence: StereoSequence, run: SavedRun, tracks: Tracks, frame: int) -> Still | None:
    """Draw a frame of the run, which may hold a selection of the sequence's; None without image."""
    times_ns = run.frames.timestamps_ns if run.frames is not None else sequence.timestamps_ns
    row = np.flatnonzero(sequence.timestamps_ns == times_ns[frame])
    if not len(row):
        return None
    canvas = _annotate(sequence[int(row[0])].left, tracks, frame)
    jpeg = cv2.imencode(".jpg", canvas, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()
    here = tracks.frame == frame
    time_s = (times_ns[frame] - sequence.timestamps_ns[0]) / 1e9
    caption = (
        f"frame {frame}, {time_s:.1f} s: {tracks.inlier[here].sum()} of {here.sum()} are inliers"
    )
    if run.frames is not None:
        caption += f", {run.frames.status[frame].value}"
    return Still(data_uri(jpeg, "image/jpeg"), caption)


def _annotate(image: Image, tracks: Tracks, frame: int) -> Image:
    """Draw trails of up to TRAIL_FRAMES frames; warm colours are near, cool ones far."""
    scale = max(1.0, WIDTH_PX / image.shape[1])
    size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
    canvas = cv2.cvtColor(
        cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), cv2.COLOR_GRAY2BGR
    )
    canvas = (0.8 * canvas).astype(np.uint8)
    shift = 4  # OpenCV draws at 1/16 pixel
    fixed = np.round(((tracks.pixels + 0.5) * scale - 0.5) * (1 << shift)).astype(np.int32)
    here = np.flatnonzero(tracks.frame == frame)
    recent = np.flatnonzero((tracks.frame <= frame) & (tracks.frame > frame - TRAIL_FRAMES))
    colours = _colours(tracks, here)
    for k, colour in zip(here, colours, strict=True):
        trail = recent[tracks.landmark[recent] == tracks.landmark[k]]
        cv2.polylines(canvas, [fixed[trail]], False, colour, 2, cv2.LINE_AA, shift)
    for k, colour in zip(here, colours, strict=True):
        centre = (int(fixed[k, 0]), int(fixed[k, 1]))
        filled = -1 if tracks.inlier[k] else 1
        cv2.circle(canvas, centre, 3 << shift, colour, filled, cv2.LINE_AA, shift)
    return canvas


def _colours(tracks: Tracks, here: Indices) -> Sequence[tuple[int, int, int]]:
    """Return BGR of K observations by the rank of their disparity."""
    disparity_px = tracks.disparity_px[here]
    known = np.isfinite(disparity_px)
    rank = np.argsort(np.argsort(disparity_px)) / max(int(known.sum()) - 1, 1)  # NaN sorts last
    lookup = (25 + 205 * rank.clip(max=1)).astype(np.uint8)[None]  # the table's ends are too dark
    table: Array = cv2.applyColorMap(lookup, cv2.COLORMAP_TURBO)[0]
    table[~known] = UNKNOWN
    table[~tracks.inlier[here]] = OUTLIER
    return [(int(b), int(g), int(r)) for b, g, r in table]
