"""A stream to Rerun's viewer: into its window, to an address, or into a file."""

from collections.abc import Generator
from contextlib import ExitStack, contextmanager
from time import monotonic, sleep
from typing import Any
from uuid import uuid4

import numpy as np

from trials.view import rerun_sdk as rr
from trials.view.target import EXAMPLE, PORT, Target, listens
from vo.contract.arrays import Array, Indices
from vo.contract.errors import DatasetError, SettingsError
from vo.contract.files import replacing
from vo.contract.remarks import remark

APPLICATION = "driftyard"
FRAME, TIME = "frame", "sensor_time"
"""Timelines: number of the frame in the recording, and time of the sensors."""
START_S = 30.0
"""Longest time until a window listens."""
FLUSH_S = 60.0
"""Longest time until a viewer has received everything."""
EPOCH_NS = 10**17
"""Times from here on are dates; earlier ones count from the start of the recording."""


class Stream:
    """Logs at times of frames; its paths are entities of Rerun, its parts archetypes."""

    def __init__(self, recording: Any, is_dated: bool) -> None:
        """Log into a RecordingStream of Rerun, with dates or with times since the start."""
        self.recording, self._is_dated = recording, is_dated

    def at(self, frame: int, time_ns: int) -> None:
        """Set the time of what is logged next."""
        self.recording.set_time(FRAME, sequence=frame)
        if self._is_dated:
            self.recording.set_time(TIME, timestamp=np.datetime64(time_ns, "ns"))
        else:
            self.recording.set_time(TIME, duration=np.timedelta64(time_ns, "ns"))

    def log(self, path: str, *parts: Any, static: bool = False) -> None:
        """Log archetypes at an entity; static ones have no time."""
        self.recording.log(path, *parts, static=static)

    def log_columns(self, path: str, frames: Indices, times_ns: Indices, values: Array) -> None:
        """Log scalars (N, K) at the times of N readings."""
        kind, word = (
            ("datetime64[ns]", "timestamp") if self._is_dated else ("timedelta64[ns]", "duration")
        )
        indexes = [
            rr.TimeColumn(FRAME, sequence=frames),
            rr.TimeColumn(TIME, **{word: np.asarray(times_ns).astype(kind)}),
        ]
        self.recording.send_columns(path, indexes, rr.Scalars.columns(scalars=np.asarray(values)))


@contextmanager
def open_stream(name: str, target: Target, blueprint: Any, start_ns: int) -> Generator[Stream]:
    """Open a stream of a recording with a name; a file appears when the block succeeds.

    Raises:
        DatasetError: If the file cannot be written.
        SettingsError: If a window does not open.
    """
    recording = rr.RecordingStream(APPLICATION, recording_id=uuid4())
    recording.send_recording_name(name)
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    stream = Stream(recording, start_ns >= EPOCH_NS)
    with ExitStack() as file:
        if target.file is not None:
            partial = file.enter_context(replacing(target.file))
            partial.touch()  # a folder that refuses it is named by Python
            recording.save(partial, default_blueprint=blueprint)
        else:
            recording.connect_grpc(target.url or open_window(), default_blueprint=blueprint)
        try:
            yield stream
            _flush(recording, target)
        finally:
            recording.disconnect()


def _flush(recording: Any, target: Target) -> None:
    """Wait until everything is written or sent; a viewer that was closed brings a remark."""
    try:
        recording.flush(timeout_sec=FLUSH_S)
    except RuntimeError as error:  # Rerun has logged why
        if target.file is not None:
            raise DatasetError(f"{target.file}: cannot be written ({error})") from None
        remark(f"{target.url}: the viewer has not received everything ({error})")


def open_window() -> str:
    """Start a viewer; returns its address.

    Raises:
        SettingsError: If it does not start.
    """
    window = rr.RecordingStream(APPLICATION)
    window.spawn(port=PORT, connect=False, hide_welcome_screen=True)
    until_s = monotonic() + START_S
    while not listens("127.0.0.1", PORT):
        if monotonic() > until_s:
            raise SettingsError("the viewer does not start; write a file with --save FILE.rrd")
        sleep(0.1)
    return EXAMPLE
