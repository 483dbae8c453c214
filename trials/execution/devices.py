"""GPUs of workers: each worker renders with the GPU of its machine that the fewest others use."""

import fcntl
import os
import tempfile
from collections.abc import Sequence
from functools import cache
from itertools import count
from pathlib import Path
from typing import IO

from sim.egl_devices import gpu_numbers

VARIABLE = "MUJOCO_EGL_DEVICE_ID"


@cache
def gpus() -> tuple[int, ...]:
    """Numbers of this machine's GPUs for VARIABLE; none if the user has set it."""
    return () if VARIABLE in os.environ else tuple(gpu_numbers())


@cache
def choose_gpu() -> IO[bytes] | None:
    """Let this process render with a GPU from its first image on; none is chosen of less than two.

    What it returns is open as long as the process uses the GPU.
    """
    numbers = gpus()
    if len(numbers) < 2:
        return None
    number, claim = claim_gpu(numbers, Path(tempfile.gettempdir()))
    os.environ[VARIABLE] = str(number)
    return claim


def claim_gpu(numbers: Sequence[int], folder: Path) -> tuple[int, IO[bytes]]:
    """Claim one of the GPUs that the fewest processes on this machine use.

    A claim is a lock on a file, which the system removes when a process ends, however it ends, so
    that workers of any scheduler and of several commands share the GPUs of a machine.
    """
    for place in count():
        for number in numbers:
            path = folder / f"driftyard-{os.getuid()}-gpu-{number}-{place}.lock"
            file = path.open("ab")
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                file.close()
            else:
                return number, file
    raise AssertionError  # there is no last place
