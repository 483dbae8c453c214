"""The worker's end of `trials.estimators.systems.elsewhere`; needs NumPy alone."""

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
"""Seconds and both eyes to the left camera's pose, 4x4, or None and the reason."""


def serve(start: Callable[[dict[str, Any]], Track]) -> None:
    """Answer until the pipe closes.

    Args:
        start: Takes the rig and the options, and returns what takes the frames.
    """
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what the system prints goes elsewhere
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
    os._exit(0)  # the system's threads and destructors are not waited for
