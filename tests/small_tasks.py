"""Tasks that write little, to see what becomes of them while workers are killed."""

import hashlib
import math
import os
import time
from dataclasses import dataclass
from pathlib import Path

from sim.camera.gl import open_context
from trials.execution.store import publish
from trials.execution.tasks import Task
from vo.contract.dataset import DatasetWriter
from vo.contract.files import write_text
from vo.contract.remarks import remark


def write_file(out: str, seed: int) -> int:
    """Write a file; return the process that did."""
    time.sleep(0.02)
    write_text(Path(out), hashlib.sha256(str(seed).encode()).hexdigest())
    publish(Path(out))
    return os.getpid()


def write_folder(out: str, seed: int) -> int:
    """Write a dataset folder of several files, slowly."""
    with DatasetWriter(Path(out), overwrite=True) as writer:
        for k in range(4):
            time.sleep(0.01)
            writer.add(f"mav0/{k}", hashlib.sha256(f"{seed} {k}".encode()).digest())
        writer.commit({"seed": seed})
    publish(Path(out))
    return os.getpid()


def say(text: str) -> str:
    """Issue a remark."""
    remark(text)
    return text


def die(file: str) -> None:
    """Kill the worker, and count how often."""
    with Path(file).open("a") as tries:
        tries.write("x")
    os._exit(9)


def wait_in(file: str) -> None:
    """Write the number of this process, and wait."""
    Path(file).write_text(str(os.getpid()))
    time.sleep(60)


def render_with(device: str) -> bool:
    """Open and close a context of OpenGL with a device of EGL."""
    os.environ["MUJOCO_EGL_DEVICE_ID"] = device
    try:
        open_context("auto", 8, 8).free()
    finally:
        del os.environ["MUJOCO_EGL_DEVICE_ID"]
    return True


@dataclass(frozen=True)
class Measured:
    """A result that is kept."""

    seed: int
    values: tuple[float, ...]


def measure_once(log: str, seed: int) -> list[Measured]:
    """Count a call, and return numbers that JSON has and has not."""
    with Path(log).open("a") as calls:
        calls.write("x")
    return [Measured(seed, (0.1, math.nan, math.inf, 1 / 3))]


def mixed_tasks(folder: str, count: int) -> list[Task[int]]:
    """Tasks that write files and folders in turns."""
    return [
        Task("file", f"{folder}/{k}", (write_file, write_folder)[k % 2], (f"{folder}/{k}", k))
        for k in range(count)
    ]
