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
Image = NDArray[np.uint8]
Track = Callable[[float, Image, Image], tuple[Pose | None, str]]
"""Maps seconds and both images to the 4x4 pose of the left camera, or None and the reason."""


def serve(start: Callable[[dict[str, Any]], Track]) -> None:
    """Answer frames until the pipe closes; `start` builds the tracker from rig and options."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # output of the system must not mix with the answers
    source = sys.stdin.buffer
    rig = json.loads(source.readline())
    track = start(rig)
    print(json.dumps({"state": "ready"}), file=answers, flush=True)
    shape = (rig["height_px"], rig["width_px"])
    size = shape[0] * shape[1]
    for line in iter(source.readline, b""):
        left, right = (np.frombuffer(source.read(size), np.uint8).reshape(shape) for _ in range(2))
        begun = time.perf_counter()
        T, state = track(json.loads(line)["t"], left, right)
        ms = 1e3 * (time.perf_counter() - begun)
        said = None if T is None else np.asarray(T, dtype=float).ravel().tolist()
        print(json.dumps({"T": said, "state": state, "ms": ms}), file=answers, flush=True)
    os._exit(0)  # without waiting for threads and destructors of the system
