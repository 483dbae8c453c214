"""Worker side of `trials.estimators.systems.subprocess_estimator`; requires only NumPy."""

import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Pose = NDArray[np.float64]
Image = NDArray[Any]
Track = Callable[[float, Image, Image], tuple[Pose | None, str]]
"""Maps seconds, the left image and the right one, or depth, to the 4x4 pose of the left camera, or
to None and the reason."""


def serve(start: Callable[[dict[str, Any]], Track], second: type = np.uint8) -> None:
    """Answer frames until the pipe closes; `start` builds the tracker from rig and options.

    The type of the second image is that of the right one, or float64 for depth in metres.
    """
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # output of the system must not mix with the answers
    source = sys.stdin.buffer
    rig = json.loads(source.readline())
    track = start(rig)
    print(json.dumps({"state": "ready"}), file=answers, flush=True)
    shape = (rig["height_px"], rig["width_px"])
    size = shape[0] * shape[1]

    def image(kind: type) -> Image:
        return np.frombuffer(source.read(size * np.dtype(kind).itemsize), kind).reshape(shape)

    for line in iter(source.readline, b""):
        images = image(np.uint8), image(second)
        begun = time.perf_counter()
        T, state = track(json.loads(line)["t"], *images)
        ms = 1e3 * (time.perf_counter() - begun)
        said = None if T is None else np.asarray(T, dtype=float).ravel().tolist()
        print(json.dumps({"T": said, "state": state, "ms": ms}), file=answers, flush=True)
    os._exit(0)  # without waiting for threads and destructors of the system
