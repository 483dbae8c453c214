"""Programs as estimators: a command reads a dataset folder and writes a TUM trajectory."""

import os
import shlex
import signal
import subprocess
import tempfile
import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from trials.estimators.plugins import PluginError
from vo.contract import se3
from vo.contract.arrays import Indices, Mask
from vo.contract.errors import SettingsError, TrajectoryError
from vo.contract.estimator import Estimate, Status
from vo.contract.files import replacing
from vo.contract.remarks import Remark, remark
from vo.contract.sequence import StereoSequence
from vo.contract.trajectory import Trajectory
from vo.recordings.trajectory_files import SAME_TIME_NS, read_trajectory
from vo.runner import Run

KEYFRAME_GAP_NS = (1_000_000_000, 5_000_000_000)
"""Bounds of the longest time between keyframes that is no loss: five times the median."""


@dataclass(frozen=True)
class Command:
    """A program that runs once for a whole sequence.

    Attributes:
        template: Words, quoted as for a shell, but executed without one; `{dataset}` and `{out}`
            stand for the dataset folder and the trajectory to write.
        timeout_s: Longest run time.
        label: Name in tables; the file name of the program by default.

    Raises:
        SettingsError: If a place is missing, or a quotation mark is not closed.

    Example:
        >>> dy.Command("python3 my_vo.py {dataset} {out}", label="mine").name
        'mine'
    """

    template: str
    timeout_s: float = 3600.0
    label: str = ""

    def __post_init__(self) -> None:
        for place in ("{dataset}", "{out}"):
            if place not in self.template:
                raise SettingsError(f"--command {self.template}: {place} is missing")
        try:
            shlex.split(self.template)
        except ValueError as error:
            raise SettingsError(f"--command {self.template}: {error}") from None

    @property
    def name(self) -> str:
        """Label, or the file name of the program."""
        return self.label or Path(shlex.split(self.template)[0]).name

    def words(self, dataset: Path, out: Path) -> list[str]:
        """Words with their placeholders filled in."""
        places = {"{dataset}": str(dataset.resolve()), "{out}": str(out.resolve())}
        words = shlex.split(self.template)
        for place, path in places.items():
            words = [word.replace(place, path) for word in words]
        return words


def run_command(command: Command, dataset: Path, sequence: StereoSequence, log: Path) -> Run:
    """Run a program in the working directory over a dataset and assign its poses to frames.

    The dataset contains the ground truth, which the program must not read. Its output is logged.

    Returns:
        Poses relative to the first; frames without a pose are lost, or, between keyframes, have no
        estimate. Every frame gets the same share of the wall time.

    Raises:
        PluginError: If the program cannot be started, exits with a status, exceeds its time, or
            writes no usable trajectory.
    """
    with tempfile.TemporaryDirectory(prefix="driftyard-") as scratch:
        out = Path(scratch) / "trajectory.txt"
        started = perf_counter()
        _execute(command, command.words(dataset, out), log)
        wall_ms = 1e3 * (perf_counter() - started)
        if not out.is_file():
            raise PluginError(f"{command.name} wrote no trajectory; it printed {log}")
        try:
            with warnings.catch_warnings(record=True) as remarks:
                warnings.simplefilter("always", Remark)
                trajectory = read_trajectory(out, sequence.timestamps_ns)
        except TrajectoryError as error:
            place = str(error).replace(f"{out}: ", "").replace(f"{out}:", "line ")
            raise PluginError(f"{command.name} wrote a malformed trajectory, {place}") from None
    for x in remarks:  # they name a file that is gone
        remark(str(x.message).replace(str(out), f"the trajectory of {command.name}"))
    estimates = _estimates(command, trajectory, sequence)
    if unclaimed := len(sequence) - len(estimates):
        remark(
            f"{command.name} gives poses of keyframes: {unclaimed} of {len(sequence)} frames "
            "between them count neither as estimated nor as lost"
        )
    return Run(sequence.name, estimates, (wall_ms / len(sequence),) * len(estimates))


def _execute(command: Command, words: Sequence[str], log: Path) -> None:
    with replacing(log) as partial:
        with partial.open("wb") as file:
            try:
                process = subprocess.Popen(
                    words, stdin=subprocess.DEVNULL, stdout=file, stderr=file,
                    start_new_session=True,
                )  # fmt: skip
            except OSError as error:
                raise PluginError(f"--command: cannot run {words[0]} ({error.strerror})") from None
            status = None
            with suppress(subprocess.TimeoutExpired):
                try:
                    status = process.wait(command.timeout_s)
                finally:
                    if process.returncode is None:  # timed out, or interrupted
                        os.killpg(process.pid, signal.SIGKILL)
                        process.wait()
        last = _last_line(partial)
    if status is None:
        raise PluginError(
            f"{command.name} was stopped after {command.timeout_s:g} s (--timeout); "
            f"it printed {log}"
        )
    if status:
        how = f"exit status {status}" if status > 0 else f"signal {-status}"
        raise PluginError(f"{command.name} failed with {how}: {last} (all of it in {log})")


def _last_line(printed: Path) -> str:
    lines = printed.read_text(encoding="utf-8", errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "it printed nothing")


def _estimates(
    command: Command, trajectory: Trajectory, sequence: StereoSequence
) -> tuple[Estimate, ...]:
    """Build one estimate per frame from the pose nearest in time, if it is near enough.

    Frames between keyframes, which the program does not claim, have none.
    """
    times, known = sequence.timestamps_ns, trajectory.timestamps_ns
    rows = np.interp(times - times[0], known - times[0], np.arange(len(known)))
    nearest = np.rint(rows).astype(np.int64)
    min_step_ns = int(np.diff(times).min()) if len(times) > 1 else 2 * SAME_TIME_NS
    found = np.abs(known[nearest] - times) < min(SAME_TIME_NS, min_step_ns / 2)
    if not found.any():
        raise PluginError(
            f"{command.name}: none of its {len(known)} poses is at the time of a frame; "
            f"its first is at {known[0]} ns, the first frame at {times[0]} ns"
        )
    T_first_ref = se3.inverse(trajectory.T_ref_frame[nearest[np.argmax(found)]])
    estimates: list[Estimate] = []
    unclaimed = between_keyframes(times, found)
    rows = zip(times.tolist(), nearest, found, unclaimed, strict=True)
    for time, row, posed in (x[:3] for x in rows if not x[3]):
        if not posed:
            estimates.append(Estimate(time, Status.LOST, None, "the command gave no pose"))
            continue
        first = all(x.status is Status.LOST for x in estimates)
        status = Status.START if first else Status.TRACKED
        estimates.append(Estimate(time, status, T_first_ref @ trajectory.T_ref_frame[row]))
    return tuple(estimates)


def between_keyframes(times_ns: Indices, has_pose: Mask) -> Mask:
    """Return which of N frames, some with a pose, a program that writes keyframes leaves out.

    Keyframes are poses of every second frame or fewer, from the first of them to the last. Longer
    gaps between them, and before the first and after the last, are losses.
    """
    rows = np.flatnonzero(has_pose)
    if len(rows) < 2 or 2 * len(rows) > rows[-1] - rows[0] + 2:
        return np.zeros(len(times_ns), dtype=bool)
    known = times_ns[rows]
    limit_ns = np.clip(5 * np.median(np.diff(known)), *KEYFRAME_GAP_NS)
    gaps_ns = np.diff(known, prepend=times_ns[0], append=times_ns[-1])
    return ~has_pose & (gaps_ns[np.searchsorted(known, times_ns)] <= limit_ns)
