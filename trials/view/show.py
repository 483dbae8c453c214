"""Views of recordings with their runs: of complete ones, and of one that goes on."""

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from trials.evaluation.alignment import Similarity
from trials.evaluation.mismatch import remark_mismatches
from trials.evaluation.runs import SavedRun, read_map
from trials.report.page import with_distinct_names
from trials.view import rerun_sdk as rr
from trials.view.blueprint import blueprint
from trials.view.recording_log import RecordingLog, log_sensors, sensor_readings
from trials.view.run_log import ERRORS, RunLog, RunStyle, first_seen_ns, run_style
from trials.view.run_rows import (
    IDENTITY,
    AlignedRun,
    Row,
    align_first_pose,
    align_runs,
    pose_errors,
)
from trials.view.stream import Stream, open_stream
from trials.view.target import Target
from trials.view.viewed_recording import ViewedRecording, open_recording
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.errors import ImageError
from vo.contract.estimator import Estimate
from vo.contract.remarks import remark
from vo.recordings.pairing import FrameSelection
from vo.runner import companion

Progress = Callable[[int, int], None]
"""Called with the number of frames done and that of all frames."""


def show(
    folder: Path,
    frames: FrameSelection,
    runs: Sequence[SavedRun],
    target: Target,
    progress: Progress | None = None,
) -> None:
    """Show the selected frames of a recording, and what runs say about them.

    Raises:
        DriftyardError: If the recording or a file beside a run is damaged, or a file cannot be
            written.
    """
    recording = open_recording(folder, frames)
    aligned = align_runs(recording.truth, with_distinct_names(runs))
    for run in aligned:
        if recording.truth is not None and run.pair is not None:
            remark_mismatches(recording.truth, run.run, recording.rig.T_body_cam)
    times_ns, numbers = recording.sequence.timestamps_ns, recording.numbers
    rows = [{row.frame: row for row in run.rows(times_ns, numbers)} for run in aligned]
    names = [run.run.estimator for run in aligned]
    stated = [run.run.frames is not None for run in aligned]
    poses = [x.T_world_cam for of in rows[:1] for x in of.values() if x.T_world_cam is not None]
    with _opened(recording, names, poses, target) as view:
        logs = [
            view.run_log(run_style(k, name, [x.estimate for x in of.values()], has_status))
            for k, (name, of, has_status) in enumerate(zip(names, rows, stated, strict=True))
        ]
        for i, number in enumerate(numbers.tolist()):
            here = [of.get(number) for of in rows]
            view.add_frame(i, here[0] if here else None)
            for row, log in zip(here, logs, strict=True):
                if row is not None:
                    log.add(row)
            if progress:
                progress(i + 1, len(numbers))
        for run, log in zip(aligned, logs, strict=True):
            view.add_map(run, log)


class LiveView:
    """View of one run that goes on."""

    def __init__(self, view: "_View", name: str) -> None:
        self._view, self._log = view, view.run_log(run_style(0, name))
        self._T_world_odom: Similarity | None = None
        if view.recording.truth is None:
            self._T_world_odom = IDENTITY
        self._waiting: list[tuple[int, Estimate]] = []
        self._shown: set[int] = set()

    def add(self, estimate: Estimate) -> None:
        """Show the next frame and its estimate.

        The first pose that has a true one is aligned to it; earlier ones wait for it.
        """
        recording = self._view.recording
        i = int(np.searchsorted(recording.sequence.timestamps_ns, estimate.timestamp_ns))
        T_odom_cam, T_world_cam = estimate.T_odom_cam, recording.T_world_cam[i]
        if self._T_world_odom is None and T_odom_cam is not None and is_known(T_world_cam):
            self._T_world_odom = align_first_pose(T_world_cam, T_odom_cam)
        self._waiting.append((i, estimate))
        row = self._row(i, estimate)
        self._view.add_frame(i, row)
        if self._T_world_odom is not None:
            for waiting in self._waiting:
                self._log.add(self._row(*waiting))
            self._waiting.clear()

    def _row(self, i: int, estimate: Estimate) -> Row:
        recording = self._view.recording
        number, T_world_cam = int(recording.numbers[i]), recording.T_world_cam[i]
        self._shown.add(number)
        if estimate.T_odom_cam is None or self._T_world_odom is None:
            return Row(number, estimate, None)
        T_world_est = self._T_world_odom.map(estimate.T_odom_cam[None])
        known = is_known(T_world_cam)
        errors = pose_errors(T_world_cam[None], T_world_est, True)[0] if known else ()
        return Row(number, estimate, T_world_est[0], *errors)

    def finish(self, run: SavedRun) -> None:
        """Add what is known at the end: drift and map; all frames of a program."""
        recording = self._view.recording
        self._T_world_odom = self._T_world_odom or IDENTITY  # no pose has a true one
        for waiting in self._waiting:
            self._log.add(self._row(*waiting))
        aligned = align_runs(recording.truth, [run])[0]
        places = {number: i for i, number in enumerate(recording.numbers.tolist())}
        for row in aligned.rows(recording.sequence.timestamps_ns, recording.numbers):
            if row.frame in self._shown:
                self._log.add_drift(row)
            else:
                self._view.add_frame(places[row.frame], row)
                self._log.add(row)
        self._view.add_map(aligned, self._log)


@contextmanager
def live_view(
    folder: Path, frames: FrameSelection, name: str, target: Target
) -> Generator[LiveView]:
    """Open a view of an estimator's run over the selected frames of a recording.

    A truth of positions only is left out: before the end, nothing can be aligned to it.

    Raises:
        DriftyardError: If the recording is invalid, or a file cannot be written.
    """
    recording = open_recording(folder, frames)
    if recording.truth is not None and recording.truth.point_cam is not None:
        recording = replace(recording, truth=None)
    with _opened(recording, [name], [], target) as view:
        yield LiveView(view, name)


class _View:
    """Open view of a recording."""

    def __init__(self, stream: Stream, recording: ViewedRecording, up: Array) -> None:
        self.recording, self._stream = recording, stream
        self._log = RecordingLog(stream, recording.rig, up, recording.positions, recording.scene)
        self.missing: list[ImageError] = []

    def run_log(self, style: RunStyle) -> RunLog:
        """Begin a run."""
        return RunLog(self._stream, style, self.recording.rig)

    def add_frame(self, i: int, row: Row | None) -> None:
        """Show frame i; without a true pose, at that of a run."""
        recording = self.recording
        true, images = recording.T_world_cam[i], None
        try:
            images = recording.sequence[i]
        except ImageError as error:
            self.missing.append(error)
        shown = true if is_known(true) else row.T_world_cam if row else None
        number, time_ns = int(recording.numbers[i]), int(recording.sequence.timestamps_ns[i])
        position = recording.positions[i]
        self._log.add(number, time_ns, shown, position, images, recording.depth_mm(i))

    def add_map(self, run: AlignedRun, log: RunLog) -> None:
        """Show the map of a run, each point from the frame that saw it first."""
        file, saved = companion(run.run.path, "map.ply"), run.run
        if not file.is_file():
            return
        found, times_ns = read_map(file), self.recording.sequence.timestamps_ns
        seen_ns = np.full(len(found.ids), times_ns[0])
        if saved.tracks is not None and saved.frames is not None:
            seen_ns = first_seen_ns(found, saved.tracks, saved.frames.timestamps_ns)
        T_odom_point = se3.pose(np.eye(3), found.points_odom)
        points_world = run.T_world_odom.map(T_odom_point)[:, :3, 3]
        place = np.searchsorted(times_ns, seen_ns).clip(max=len(times_ns) - 1)
        for i in np.unique(place).tolist():
            rows = place == i
            self._stream.at(int(self.recording.numbers[i]), int(times_ns[i]))
            log.add_map(points_world[rows], found.grey[rows])


def is_known(T_world_cam: Array) -> bool:
    """Whether a pose (4, 4) is one, and not NaN."""
    return not np.isnan(T_world_cam).any()


@contextmanager
def _opened(
    recording: ViewedRecording, names: Sequence[str], poses: Sequence[Array], target: Target
) -> Generator[_View]:
    """Open a view with its layout; `poses` are estimated ones (4, 4)."""
    times_ns, estimated = recording.sequence.timestamps_ns, np.reshape(poses, (-1, 4, 4))
    up, positions = recording.up(estimated), recording.positions
    sensors = sensor_readings(recording)
    layout = blueprint(
        names=[rr.escape_entity_path_part(x) for x in names],
        positions=estimated[:, :3, 3] if np.isnan(positions).all() else positions,
        up=up,
        errors=ERRORS if recording.truth is not None else ("inliers",),
        has_scene=recording.scene is not None,
        has_depth=bool(recording.labels),
        sensors=list(sensors),
    )
    with open_stream(recording.sequence.name, target, layout, int(times_ns[0])) as stream:
        view = _View(stream, recording, up)
        log_sensors(stream, sensors, recording)
        yield view
        if view.missing:
            count = f"{len(view.missing)} of {len(times_ns)} frames"
            remark(f"{view.missing[0]}; {count} are shown without images")
