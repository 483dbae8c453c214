"""An estimator in another process, connected by pipes.

The worker is a script that runs in the environment of its system, where this project is not
installed. It reads a line of JSON (rig and options) and answers with a line. For each frame it
reads a line of JSON `{"t": seconds}` and the pixels of both images, or of the left one and its
depth in metres, and answers with a line `{"T": 16 numbers or null, "state": word, "ms":
milliseconds}`. T maps the left camera to the first left camera.
"""

import json
import select
import subprocess
import tempfile
import weakref
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np

from trials.estimators.plugins import WorkerEndedError
from trials.estimators.systems.environments import python_of
from vo.contract.arrays import Array
from vo.contract.clock import Clock
from vo.contract.estimator import Estimate, FinalResult, Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.contract.trajectory import NS_PER_S

WORKERS = Path(__file__).parent / "workers"


class SubprocessEstimator:
    """Estimator whose poses come from a worker process."""

    def __init__(
        self, system: str, rig: StereoRig, options: Mapping[str, Any], timeout_s: float = 120.0
    ) -> None:
        """Start the worker of a system; the timeout holds for the start and for each frame.

        Raises:
            ForeignSystemError: If the system is not installed.
            WorkerEndedError: If the worker does not start.
        """
        self.system, self.timeout_s = system, timeout_s
        self._last = "it was ended"
        words = [str(python_of(system)), str(WORKERS / f"{system}_worker.py")]
        self._output = tempfile.TemporaryFile()  # noqa: SIM115, open as long as the process
        self._process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._output
        )
        self._end = weakref.finalize(self, _end, self._process, self._output)
        names = ("width_px", "height_px", "f_px", "cx_px", "cy_px", "baseline_m")
        self._send({**{name: getattr(rig, name) for name in names}, **options})
        self._receive()
        self._started = False

    def track(self, frame: StereoFrame) -> Estimate:
        """Send a frame and receive its pose.

        Raises:
            WorkerEndedError: If the worker has ended, does not answer, or answers nonsense.
        """
        clock, time = Clock(), frame.timestamp_ns
        images = self.images(frame, clock)
        self._send({"t": time / NS_PER_S}, *(x.tobytes() for x in images))
        answer = self._receive()
        timings = {**clock.ms, "track": float(answer["ms"])}
        if answer["T"] is None:
            return Estimate(time, Status.LOST, None, answer["state"], timings_ms=timings)
        T_odom_cam = np.array(answer["T"], dtype=float).reshape(4, 4)
        status = Status.TRACKED if self._started else Status.START
        self._started = True
        return Estimate(time, status, T_odom_cam, timings_ms=timings)

    def images(self, frame: StereoFrame, clock: Clock) -> tuple[Array, Array]:
        """Return the images that the worker receives."""
        return frame.left, frame.right

    def finalize(self) -> FinalResult:
        """End the worker; the result is empty."""
        self._end()
        return FinalResult()

    def _send(self, header: Mapping[str, Any], *blocks: bytes) -> None:
        assert self._process.stdin
        if not self._end.alive:
            raise self._failure()
        try:
            self._process.stdin.write(json.dumps(header).encode() + b"\n")
            for block in blocks:
                self._process.stdin.write(block)
            self._process.stdin.flush()
        except BrokenPipeError:
            raise self._failure() from None

    def _receive(self) -> dict[str, Any]:
        pipe = self._process.stdout
        assert pipe
        if not select.select([pipe], [], [], self.timeout_s)[0]:
            self._process.kill()
            self._end()
            raise WorkerEndedError(f"{self.system} does not answer for {self.timeout_s:g} s")
        line = pipe.readline()
        if not line:
            raise self._failure()
        try:
            return json.loads(line)
        except ValueError:
            self._process.kill()
            self._end()
            said = line.decode(errors="replace").strip()
            raise WorkerEndedError(f"{self.system} answers what is no JSON: {said}") from None

    def _failure(self) -> WorkerEndedError:
        if self._end.alive:
            self._process.wait()
            self._output.seek(0)
            lines = self._output.read().decode(errors="replace").strip().splitlines()
            self._last = lines[-1] if lines else "no output"
            self._end()
        status = self._process.returncode
        how = f"exit status {status}" if status >= 0 else f"signal {-status}"
        return WorkerEndedError(f"{self.system} ended with {how}: {self._last}")


def _end(process: "subprocess.Popen[bytes]", output: IO[bytes]) -> None:
    for pipe in (process.stdin, process.stdout, output):
        if pipe:
            with suppress(BrokenPipeError):
                pipe.close()
    try:
        process.wait(5)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
