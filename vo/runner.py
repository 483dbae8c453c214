"""Run of an estimator over a sequence, and the files of its record."""

import csv
import json
import platform
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from time import perf_counter
from typing import IO, Any, Self

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.dataset import MANIFEST, installed_version
from vo.contract.errors import DatasetError, ImageError
from vo.contract.estimator import Estimate, Estimator, Finalizing, FinalResult, PointMap, Status
from vo.contract.files import replacing
from vo.contract.observations import Observations
from vo.contract.ply import write_ply
from vo.contract.remarks import remark
from vo.contract.sequence import StereoSequence
from vo.contract.trajectory import TUM_HEADER, Trajectory, tum_lines, write_tum

PACKAGES = ("driftyard", "numpy", "opencv-python-headless", "gtsam", "numba", "scipy")
UNREADABLE = "unreadable image"
"""Reason of a lost frame that the estimator did not receive."""

FRAME_HEADER = ("timestamp_ns", "status", "reason", "frame_ms")
"""Columns of frames.csv before those of each stage."""

REVISED_M, REVISED_DEG, REVISED_SHARE = 0.002, 0.2, 0.04
"""Difference of a step in the smoothed trajectory, or over its length, above which it is marked."""

COUNT, MILLISECONDS = "count:", "ms:"
"""Prefixes of the per-stage columns of frames.csv."""

VERTEX = np.dtype(
    [
        *((axis, "<f4") for axis in "xyz"),
        *((channel, "u1") for channel in ("red", "green", "blue")),
        ("views", "<i4"),
        ("landmark", "<i4"),
    ]
)
"""Properties of a map point."""


@dataclass(frozen=True)
class Run:
    """Estimates of a whole sequence, one per frame in order of time, and the final result, if any.

    A program that writes keyframes has no estimate of the frames between them.
    `frame_ms` is the wall time of each `track` call, without the loading of images; 0 for a frame
    with an unreadable image.
    """

    sequence: str
    estimates: tuple[Estimate, ...]
    frame_ms: tuple[float, ...]
    final: FinalResult = field(default_factory=FinalResult)

    @property
    def trajectory(self) -> Trajectory:
        """T_odom_cam of the frames that are not lost; may be empty."""
        posed = [(x.timestamp_ns, x.T_odom_cam) for x in self.estimates if x.T_odom_cam is not None]
        times = np.array([time for time, _ in posed], dtype=np.int64)
        return Trajectory(times, np.array([T for _, T in posed]).reshape(-1, 4, 4))


def run(
    sequence: StereoSequence,
    estimator: Estimator,
    progress: Callable[[Estimate, float], None] | None = None,
) -> Run:
    """Pass every frame to a new estimator, in order.

    Each estimate is passed to `progress` at once, with its wall time in ms.

    A frame with an image that is missing, damaged or of the wrong size is lost, with a remark.

    Raises:
        ImageError: If this is so in every frame.
    """
    estimates: list[Estimate] = []
    frame_ms: list[float] = []
    problems: list[ImageError] = []
    for i, time_ns in enumerate(sequence.timestamps_ns.tolist()):
        try:
            frame = sequence[i]
        except ImageError as problem:
            problems.append(problem)
            estimates.append(Estimate(time_ns, Status.LOST, None, UNREADABLE))
            frame_ms.append(0.0)
        else:
            start = perf_counter()
            estimates.append(estimator.track(frame))
            frame_ms.append(1e3 * (perf_counter() - start))
        if progress:
            progress(estimates[-1], frame_ms[-1])
    if len(problems) == len(sequence):
        raise problems[0]
    if problems:
        remark(f"{problems[0]}; {len(problems)} of {len(sequence)} frames are lost by such images")
    final = estimator.finalize() if isinstance(estimator, Finalizing) else FinalResult()
    return Run(sequence.name, tuple(estimates), tuple(frame_ms), final)


def write_run(
    out: Path, run: Run, estimator: str, settings: Mapping[str, Any], dataset: Path
) -> None:
    """Write the trajectory and its companions, all of them or none; the trajectory comes last.

    The companions of the TUM file are `<stem>.frames.csv` (status, reason, how the smoothed
    trajectory revises the step, counts and milliseconds of every frame), `<stem>.tracks.npz` (one
    entry per landmark and frame), `.covariance.npz`, `.smoothed.txt` and `.map.ply` where the
    estimator offers them, and `.run.json`: the estimator's name and resolved settings, the folder
    of the sequence, and the hash of its manifest.
    """
    manifest = dataset / MANIFEST
    about = {
        "estimator": estimator,
        "sequence": run.sequence,
        "dataset": str(dataset.resolve()),
        "dataset_sha256": sha256(manifest.read_bytes()).hexdigest() if manifest.is_file() else None,
        "settings": dict(settings),
        "versions": {"python": platform.python_version()}
        | {package: installed_version(package) for package in PACKAGES},
    }
    with ExitStack() as files:

        def new(path: Path) -> Path:
            return files.enter_context(replacing(path))

        write_tum(new(out), run.trajectory)  # entered first, so it replaces its predecessor last
        _write_frames(new(companion(out, "frames.csv")), run)
        _write_tracks(new(companion(out, "tracks.npz")), run.estimates)
        new(companion(out, "run.json")).write_text(json.dumps(about, indent=1) + "\n", "utf-8")
        offered = {
            "covariance.npz": any(x.covariance is not None for x in run.estimates),
            "smoothed.txt": run.final.trajectory is not None,
            "map.ply": run.final.points is not None,
        }
        if offered["covariance.npz"]:
            _write_covariances(new(companion(out, "covariance.npz")), run.estimates)
        if run.final.trajectory is not None:
            write_tum(new(companion(out, "smoothed.txt")), run.final.trajectory)
        if run.final.points is not None:
            write_map(new(companion(out, "map.ply")), run.final.points)
        for kind in (x for x, is_offered in offered.items() if not is_offered):
            companion(out, kind).unlink(missing_ok=True)


class UnfinishedRun:
    """Record of a run while it goes on: `<stem>.unfinished.txt` and `.unfinished.frames.csv`.

    The files hold whole lines, one for each frame, from the moment at which it is estimated. This
    context manager removes them if the block succeeds, or if no frame had a pose.
    """

    def __init__(self, out: Path) -> None:
        self._paths = companion(out, "unfinished.txt"), companion(out, "unfinished.frames.csv")
        self._files: tuple[IO[str], ...] = ()
        self._frames = self._poses = 0

    def __enter__(self) -> Self:
        return self

    def add(self, estimate: Estimate, frame_ms: float) -> None:
        """Write the pose and the status of the next frame, and its wall time.

        Raises:
            DatasetError: If the disk is full.
        """
        time_ns, T = estimate.timestamp_ns, estimate.T_odom_cam
        row = time_ns, estimate.status.value, estimate.reason, f"{frame_ms:.3f}"
        try:
            if not self._files:
                self._open()
            if T is not None:
                lines = tum_lines(Trajectory(np.array([time_ns]), T[None]))
                self._files[0].write("\n".join(lines) + "\n")
            csv.writer(self._files[1], lineterminator="\n").writerow(row)
            for file in self._files:
                file.flush()
        except OSError as error:
            raise DatasetError(f"{self._paths[0]}: cannot be written ({error.strerror})") from None
        self._frames, self._poses = self._frames + 1, self._poses + (T is not None)

    def _open(self) -> None:
        self._paths[0].parent.mkdir(parents=True, exist_ok=True)
        self._files = tuple(x.open("w", encoding="utf-8", newline="") for x in self._paths)
        self._files[0].write(TUM_HEADER + "\n")
        csv.writer(self._files[1], lineterminator="\n").writerow(FRAME_HEADER)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        for file in self._files:
            with suppress(OSError):  # a full disk was reported before
                file.close()
        if kind is None or not self._poses:
            for path in self._paths[: len(self._files)]:
                path.unlink(missing_ok=True)
        else:
            remark(f"{self._paths[0]}: holds the poses of the {self._frames} frames before the end")


def companion(out: Path, kind: str) -> Path:
    """Path of a file that belongs to the trajectory `out`."""
    return out.with_name(f"{out.stem}.{kind}")


def _write_frames(path: Path, run: Run) -> None:
    counts = _stages(x.counts for x in run.estimates)
    timings = _stages(x.timings_ms for x in run.estimates)
    header, revised = [*FRAME_HEADER, "revised"], _revisions(run)
    header += [COUNT + name for name in counts] + [MILLISECONDS + name for name in timings]
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(header)
        for x, ms in zip(run.estimates, run.frame_ms, strict=True):
            row = [x.timestamp_ns, x.status.value, x.reason, f"{ms:.3f}"]
            row.append(revised.get(x.timestamp_ns, ""))
            row += [x.counts.get(name, "") for name in counts]
            row += [f"{x.timings_ms[n]:.3f}" if n in x.timings_ms else "" for n in timings]
            table.writerow(row)


def _revisions(run: Run) -> dict[int, str]:
    """Time of a frame whose step later frames contradict, to the difference of the smoothed one."""
    online, smoothed = run.trajectory, run.final.trajectory
    if smoothed is None or not np.array_equal(online.timestamps_ns, smoothed.timestamps_ns):
        return {}
    claimed, better = (
        se3.inverse(x[:-1]) @ x[1:] for x in (online.T_ref_frame, smoothed.T_ref_frame)
    )
    apart = se3.log(se3.inverse(claimed) @ better)
    metres, radians = (np.linalg.norm(x, axis=1) for x in (apart[:, :3], apart[:, 3:]))
    limit_m = np.maximum(REVISED_M, REVISED_SHARE * np.linalg.norm(better[:, :3, 3], axis=1))
    marked = np.flatnonzero((metres > limit_m) | (radians > np.radians(REVISED_DEG)))
    return {
        int(online.timestamps_ns[i + 1]): f"{1e3 * metres[i]:.1f} mm, {np.degrees(radians[i]):.2f}°"
        for i in marked
    }


def _write_tracks(path: Path, estimates: tuple[Estimate, ...]) -> None:
    nothing = Observations(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0))
    seen = [x.observations or nothing for x in estimates] or [nothing]
    frames = [np.full(len(x.ids), i, dtype=np.int64) for i, x in enumerate(seen)]
    pixels = np.concatenate([x.pixels for x in seen]).astype(np.float32)
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            landmark=np.concatenate([x.ids for x in seen]).astype(np.int64),
            frame=np.concatenate(frames),
            u_px=pixels[:, 0],
            v_px=pixels[:, 1],
            disparity_px=np.concatenate([x.disparity_px for x in seen]).astype(np.float32),
            inlier=np.concatenate([x.inlier for x in seen]).astype(bool),
        )


def _write_covariances(path: Path, estimates: tuple[Estimate, ...]) -> None:
    """Write (N, 6, 6) of poses, steps and drift; NaN where the estimator does not say."""

    def stack(values: Iterable[Array | None]) -> Array:
        found = [np.full((6, 6), np.nan) if x is None else x for x in values]
        return np.array(found, dtype=np.float64).reshape(-1, 6, 6)

    with path.open("wb") as file:
        np.savez_compressed(
            file,
            timestamp_ns=np.array([x.timestamp_ns for x in estimates], dtype=np.int64),
            pose=stack(x.covariance for x in estimates),
            step=stack(x.step_covariance for x in estimates),
            drift=stack(
                x.step_covariance if x.drift_covariance is None else x.drift_covariance
                for x in estimates
            ),
        )


def write_map(path: Path, points: PointMap) -> None:
    """Write a map as binary PLY: position in metres, grey as colour, track length, identifier."""
    table = np.zeros(len(points.ids), VERTEX)
    for k, axis in enumerate("xyz"):
        table[axis] = points.points_odom[:, k]
    for channel in ("red", "green", "blue"):
        table[channel] = points.grey
    table["views"], table["landmark"] = points.views, points.ids
    write_ply(path, table)


def _stages(records: Iterable[Mapping[str, Any]]) -> list[str]:
    """Every stage name once, in the order of the most complete frames."""
    return list(dict.fromkeys(name for x in sorted(records, key=len, reverse=True) for name in x))
