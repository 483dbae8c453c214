"""Pairing of the images of two eyes, and the choice of frames."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.contract.errors import DatasetError, SettingsError
from vo.contract.remarks import remark
from vo.recordings.images import Levels, number_of

NS_PER_MS = 1_000_000

TOLERANCE_NS = 3 * NS_PER_MS
"""Largest difference of the times of a pair by default: cameras with a common trigger, whose times
a computer assigns on arrival, stay below; a camera that turns by 1 rad/s turns by 0.2° in it."""

MAX_PERIODS, DEFAULT_PERIODS = 0.5, 0.25
"""Largest difference of the times of a pair in frame periods: at all, and by default."""


@dataclass(frozen=True)
class FrameSelection:
    """Frames of a recording that are used.

    Attributes:
        first: Index of the first frame, from 0.
        last: Index of the last frame; None for the last of the recording.
        every: Use only each k-th frame.
        skip_missing: Leave out frames whose image files are missing, which are an error otherwise.
        tolerance_ms: Largest difference of the times of a pair, ms; None for 3 ms, or a quarter of
            the frame period where that is less.
    """

    first: int = 0
    last: int | None = None
    every: int = 1
    skip_missing: bool = False
    tolerance_ms: float | None = None

    def rows(self, count: int, source: Path) -> slice:
        """Return the rows of `count` frames.

        Raises:
            SettingsError: If there is no such frame.
        """
        last = count - 1 if self.last is None else self.last
        if self.every < 1 or not 0 <= self.first <= last < max(count, 1):
            raise SettingsError(
                f"frames {self.first} to {last}, every {self.every}: {source} has frames 0 to "
                f"{count - 1}"
            )
        return slice(self.first, last + 1, self.every)


ALL_FRAMES = FrameSelection()


@dataclass(frozen=True)
class StereoFiles:
    """Image files of N stereo pairs, at times (N,).

    If images are parts of a larger file, their paths are names that `levels` reads.
    """

    timestamps_ns: Indices
    left: tuple[Path, ...]
    right: tuple[Path, ...]
    levels: Levels | None = None

    def __len__(self) -> int:
        return len(self.left)

    def select(self, frames: FrameSelection, source: Path) -> "StereoFiles":
        """Return the frames that are selected and have both files.

        Raises:
            SettingsError: If the selection is empty.
            DatasetError: If files are missing, unless the selection skips them.
        """
        if not len(self):
            raise DatasetError(f"{source}: the sequence has no frames")
        rows = np.arange(len(self))[frames.rows(len(self), source)]
        if self.levels:
            return self.at(rows)
        folders = {x.parent for i in rows for x in (self.left[i], self.right[i])}
        present = {x / name for x in folders if x.is_dir() for name in os.listdir(x)}
        absent = [x for i in rows for x in (self.left[i], self.right[i]) if x not in present]
        if absent:
            found = f"{len(absent)} of {2 * len(rows)} images are missing, the first: {absent[0]}"
            if not frames.skip_missing:
                raise DatasetError(f"{found}; --skip-missing goes on without them")
            rows = [i for i in rows if {self.left[i], self.right[i]} <= present]
            if not len(rows):
                raise DatasetError(f"{found}; no pair is left")
            remark(f"{found}; {len(rows)} pairs are left")
        return self.at(rows)

    def at(self, rows: Sequence[int] | Indices) -> "StereoFiles":
        """Return some of the pairs."""
        left, right = (tuple(x[i] for i in rows) for x in (self.left, self.right))
        times_ns = self.timestamps_ns[np.asarray(rows, dtype=np.int64)]
        return replace(self, timestamps_ns=times_ns, left=left, right=right)


def pair_by_time(
    folder: Path,
    left: tuple[Indices, Sequence[Path]],
    right: tuple[Indices, Sequence[Path]],
    tolerance_ms: float | None = None,
) -> StereoFiles:
    """Pair images whose times are nearest to each other, within a tolerance; times are the left's.

    Args:
        folder: Recording, for messages.
        left: Increasing times (N,) in ns and N files of the left eye.
        right: Likewise of the right eye, (M,).
        tolerance_ms: As of FrameSelection; infinity for the widest, just below half a period.

    Raises:
        DatasetError: If no times agree.
        SettingsError: If the tolerance reaches half a frame period.
    """
    (times, files_left), (times_right, files_right) = left, right
    if not len(times) or not len(times_right):
        raise DatasetError(f"{folder}: the sequence has no frames in one eye")
    tolerance_ns = _tolerance_ns(times, times_right, tolerance_ms)
    partner = _nearest(times_right, times)
    difference_ns = np.abs(times_right[partner] - times)
    mutual = _nearest(times, times_right)[partner] == np.arange(len(times))
    rows = np.flatnonzero(mutual & (difference_ns <= tolerance_ns))
    if not len(rows):
        raise DatasetError(
            f"{folder}: no images of left and right belong together: their times differ by "
            f"{difference_ns.min() / NS_PER_MS:g} ms or more, the tolerance (--pair-tolerance) is "
            f"{tolerance_ns / NS_PER_MS:g} ms"
        )
    _state(folder, len(times), len(times_right), len(rows), float(difference_ns[rows].max()))
    chosen = tuple(files_left[i] for i in rows.tolist())
    partners = tuple(files_right[i] for i in partner[rows].tolist())
    return StereoFiles(times[rows], chosen, partners)


def _state(folder: Path, left: int, right: int, pairs: int, max_difference_ns: float) -> None:
    """Remark that images are left without a partner, or that the times of pairs differ."""
    if left != pairs or right != pairs:
        remark(f"{folder}: {left} images left, {right} right: the {pairs} common pairs are used")
    if max_difference_ns:
        difference = f"{max_difference_ns / NS_PER_MS:g} ms"
        remark(f"{folder}: the times of left and right differ by up to {difference} in a pair")


def _tolerance_ns(times: Indices, times_right: Indices, tolerance_ms: float | None) -> float:
    steps = [float(np.median(np.diff(x))) for x in (times, times_right) if len(x) > 1]
    period_ns = min(steps, default=np.inf)
    if tolerance_ms is None:
        return min(TOLERANCE_NS, DEFAULT_PERIODS * period_ns)
    if tolerance_ms == np.inf:
        return np.nextafter(MAX_PERIODS * period_ns, 0)
    tolerance_ns = tolerance_ms * NS_PER_MS
    if not 0 <= tolerance_ns < MAX_PERIODS * period_ns:
        raise SettingsError(
            f"--pair-tolerance {tolerance_ms:g} ms: must be 0 or more, below half of the period of "
            f"{period_ns / NS_PER_MS:g} ms"
        )
    return tolerance_ns


def _nearest(times: Indices, queried: Indices) -> Indices:
    """Return the row of the time nearest to each queried one."""
    after = np.searchsorted(times, queried).clip(1, max(len(times) - 1, 1))
    before: Array = after - 1
    after = np.minimum(after, len(times) - 1)
    is_before = np.abs(queried - times[before]) <= np.abs(times[after] - queried)
    return np.where(is_before, before, after)


def pair_by_name(
    folder: Path,
    left: Sequence[Path],
    right: Sequence[Path],
    times_ns: Indices,
    table: Path,
    name_of: Callable[[Path], str] = lambda x: x.stem,
) -> StereoFiles:
    """Pair numbered images of the same name, which is the part `name_of`; a table has their times.

    The rows of the table belong to the names in order, or, where images are missing in both eyes,
    to their numbers from 0.

    Raises:
        DatasetError: If no names agree, or the table does not fit.
    """
    eyes = [{name_of(x): x for x in files} for files in (left, right)]
    names = sorted(eyes[0].keys() | eyes[1].keys(), key=lambda x: (number_of(x), x))
    if len(names) == len(times_ns):
        rows = dict(zip(names, range(len(names)), strict=True))
    else:
        rows = {x: number_of(x) for x in names}
        if not 0 <= min(rows.values(), default=0) <= max(rows.values(), default=0) < len(times_ns):
            counts = f"{len(names)} images ({len(left)} left, {len(right)} right, by name)"
            raise DatasetError(f"{table}: {len(times_ns)} times for {counts}")
        remark(f"{table}: {len(times_ns)} times for {len(names)} images, taken by their numbers")
    common = [x for x in names if x in eyes[0] and x in eyes[1]]
    if not common:
        raise DatasetError(f"{folder}: no image has the same name in both eyes")
    _state(folder, len(left), len(right), len(common), 0.0)
    files = (tuple(eye[x] for x in common) for eye in eyes)
    return StereoFiles(times_ns[[rows[x] for x in common]], next(files), next(files))
