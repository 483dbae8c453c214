"""Saved runs: the trajectory and its companion files."""

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from vo.contract.arrays import Array, Indices, Mask
from vo.contract.errors import TrajectoryError
from vo.contract.estimator import PointMap, Status
from vo.contract.remarks import remark
from vo.contract.trajectory import Trajectory
from vo.recordings.readers import read_frame_times
from vo.recordings.tables import read_table
from vo.recordings.trajectory_files import read_trajectory
from vo.runner import COUNT, MILLISECONDS, VERTEX, companion

DAMAGE = (
    *(OSError, EOFError, ValueError, KeyError, TypeError, AttributeError),
    *(BadZipFile, RecursionError, csv.Error),
)
"""What readers of damaged CSV, JSON and NPZ files raise."""


@dataclass(frozen=True)
class FrameTable:
    """Content of frames.csv for N frames.

    Attributes:
        timestamps_ns: (N,).
        status: N statuses.
        reason: N texts, may be empty.
        frame_ms: (N,) wall time of the estimator.
        counts: Stage to (N,) items that passed it; NaN where the stage did not run.
        timings_ms: Stage to (N,) milliseconds; NaN where the stage did not run.
        revised: N texts: by how much the smoothed trajectory revises the step; mostly empty.
    """

    timestamps_ns: Indices
    status: tuple[Status, ...]
    reason: tuple[str, ...]
    frame_ms: Array
    counts: Mapping[str, Array]
    timings_ms: Mapping[str, Array]
    revised: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.timestamps_ns)


@dataclass(frozen=True)
class Tracks:
    """Sparse visibility mask: K observations of landmarks in left images.

    Attributes:
        landmark: (K,) identifiers.
        frame: (K,) frame indices, not decreasing.
        pixels: (K, 2) (u, v).
        disparity_px: (K,), NaN where unknown.
        inlier: (K,).
    """

    landmark: Indices
    frame: Indices
    pixels: Array
    disparity_px: Array
    inlier: Mask


@dataclass(frozen=True)
class SavedRun:
    """Trajectory file and its companion files.

    Attributes:
        path: The trajectory file.
        estimator: Display name: of the estimator if known, else of the file.
        trajectory: T_odom_cam, or any trajectory of the left camera up to a rigid motion.
        frames: None for a trajectory without frames.csv.
        tracks: None for a trajectory without tracks.npz.
        about: Content of run.json; empty if there is none.
    """

    path: Path
    estimator: str
    trajectory: Trajectory
    frames: FrameTable | None = None
    tracks: Tracks | None = None
    about: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def moved(self, T_frame_cam: Array) -> "SavedRun":
        """Convert poses of a frame to those of the left camera, at (4, 4) in it."""
        known = self.trajectory
        trajectory = Trajectory(known.timestamps_ns, known.T_ref_frame @ T_frame_cam)
        return replace(self, trajectory=trajectory)


def read_run(path: Path, frame_times_ns: Indices | None = None) -> SavedRun:
    """Read a trajectory file of a recording with frames at (N,) times, and its companion files.

    The trajectory may be empty if frames.csv marks every frame as lost.

    Raises:
        TrajectoryError: If the trajectory is missing or malformed, or a companion file is damaged.
    """
    frames, tracks = companion(path, "frames.csv"), companion(path, "tracks.npz")
    record = companion(path, "run.json")
    try:
        about = json.loads(record.read_text(encoding="utf-8")) if record.is_file() else {}
        table = _read_frames(frames) if frames.is_file() else None
        is_lost = table is not None and set(table.status) == {Status.LOST}
        if is_lost and path.is_file() and not len(read_table(path, TrajectoryError)):
            trajectory = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 4, 4)))
        else:
            trajectory = read_trajectory(path, frame_times_ns)
        seen = _read_tracks(tracks) if tracks.is_file() else None
        if table and not np.isin(trajectory.timestamps_ns, table.timestamps_ns).all():
            remark(f"{frames}: has no row for some poses of {path.name}: of another run, not used")
            table = seen = None
        name = str(about.get("estimator", path.stem))
        return SavedRun(path, name, trajectory, table, seen, about)
    except DAMAGE as error:
        raise TrajectoryError(f"{path}: a companion file is damaged ({error})") from None


def read_runs(dataset: Path, files: Sequence[Path]) -> list[SavedRun]:
    """Read trajectory files of a recording; DriftyardError if one cannot be read."""
    frame_times_ns = read_frame_times(dataset)
    return [read_run(file, frame_times_ns) for file in files]


def read_map(path: Path) -> PointMap:
    """Read a PLY file that `vo.runner.write_map` wrote.

    Raises:
        TrajectoryError: If it is missing or has another format.
    """
    try:
        header, end, body = path.read_bytes().partition(b"end_header\n")
    except OSError as error:
        raise TrajectoryError(f"{path}: cannot be read ({error.strerror})") from None
    properties = [line.split()[-1] for line in header.split(b"\n") if line[:8] == b"property"]
    if (
        not end
        or tuple(map(bytes.decode, properties)) != VERTEX.names
        or len(body) % VERTEX.itemsize
    ):
        raise TrajectoryError(f"{path}: not a map written by driftyard")
    table = np.frombuffer(body, VERTEX)
    return PointMap(
        table["landmark"].astype(np.int64),
        np.stack([table[axis] for axis in "xyz"], axis=-1).astype(float),
        table["red"].copy(),
        table["views"].astype(np.int64),
    )


def _read_frames(path: Path) -> FrameTable:
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    if not rows:
        raise ValueError(f"{path.name} has no rows")

    def column(name: str) -> Array:
        return np.array([float(row[name] or "nan") for row in rows])

    names = list(rows[0])
    return FrameTable(
        np.array([int(row["timestamp_ns"]) for row in rows], dtype=np.int64),
        tuple(Status(row["status"]) for row in rows),
        tuple(row["reason"] for row in rows),
        column("frame_ms"),
        {x.removeprefix(COUNT): column(x) for x in names if x.startswith(COUNT)},
        {x.removeprefix(MILLISECONDS): column(x) for x in names if x.startswith(MILLISECONDS)},
        tuple(row.get("revised") or "" for row in rows),
    )


def _read_tracks(path: Path) -> Tracks:
    with path.open("rb") as stream, np.load(stream) as file:
        return Tracks(
            file["landmark"],
            file["frame"],
            np.stack([file["u_px"], file["v_px"]], axis=-1).astype(float),
            file["disparity_px"].astype(float),
            file["inlier"],
        )
