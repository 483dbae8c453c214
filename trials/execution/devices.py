"""GPUs of workers: each worker renders with the GPU of its machine that the fewest others use."""

import fcntl
import os
import tempfile
from collections.abc import Sequence
from functools import cache
from itertools import count
from pathlib import Path
from typing import IO

from sim.egl_devices import gpu_files, vulkan_variables

VARIABLE = "MUJOCO_EGL_DEVICE_ID"
OF_VULKAN = (
    "DRI_PRIME", "MESA_VK_DEVICE_SELECT", "VK_DRIVER_FILES", "VK_ICD_FILENAMES",
    "VK_LOADER_DEVICE_SELECT",
)  # fmt: skip
"""Variables by which a user chooses the device of Vulkan, with which Filament renders."""


@cache
def gpus() -> dict[int, str]:
    """Device files of this machine's GPUs by their number for VARIABLE; none if the user set it."""
    return {} if VARIABLE in os.environ else gpu_files()


@cache
def choose_gpu() -> IO[bytes] | None:
    """Let this process render with a GPU from its first image on; none is chosen of less than two.

    That is the GPU of OpenGL and of Vulkan, unless the user chose Vulkan's device. What it returns
    is open as long as the process uses the GPU.
    """
    files = gpus()
    if len(files) < 2:
        return None
    number, claim = claim_gpu([*files], Path(tempfile.gettempdir()))
    if not any(x in os.environ for x in OF_VULKAN):
        os.environ.update(vulkan_variables(files[number]))
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
