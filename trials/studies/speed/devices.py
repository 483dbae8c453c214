"""Frame rate of several generators at once on each device of EGL: how many a GPU serves best."""

import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from sim.egl_devices import gpu_files
from trials.report.tables import text_table
from trials.studies.speed.drive import SPAWN, TimedDrive
from trials.studies.speed.generator import GeneratorSpeed, measure_generator

ENOUGH = 0.95
"""Ratio of the highest frame rate that the best number of processes reaches."""


@dataclass(frozen=True)
class DeviceSpeed:
    """Frame rate of all generators together, by their number, on a device."""

    number: int
    gl: str
    rates: dict[int, float]

    @property
    def best(self) -> int:
        """Smallest number of generators that reaches nearly the highest frame rate."""
        return min(n for n, x in self.rates.items() if x >= ENOUGH * max(self.rates.values()))


def measure_devices(drive: TimedDrive, most: int, folder: Path) -> list[DeviceSpeed]:
    """Measure each GPU, or else the first device, with 1, 2, 4, ... and `most` generators.

    One that is not counted loads before them what all share.
    """
    numbers = sorted({min(2**k, most) for k in range(most.bit_length() + 1)})
    found: list[DeviceSpeed] = []
    for device in gpu_files() or [0]:
        first = _measure(device, drive, 1, folder)
        rates = {n: _rate(_measure(device, drive, n, folder)) for n in numbers}
        found.append(DeviceSpeed(device, first[0].gl, rates))
    return found


def _measure(device: int, drive: TimedDrive, number: int, folder: Path) -> list[GeneratorSpeed]:
    outs = [folder / f"{device}-{number}-{k}" for k in range(number)]
    with ProcessPoolExecutor(number, SPAWN) as pool:
        jobs = [pool.submit(_measure_on, device, drive, out) for out in outs]
        return [x.result() for x in jobs]


def _measure_on(device: int, drive: TimedDrive, out: Path) -> GeneratorSpeed:
    os.environ["MUJOCO_EGL_DEVICE_ID"] = str(device)
    return measure_generator(drive, out.with_name(f"{out.name}-{os.getpid()}"))


def _rate(speeds: Sequence[GeneratorSpeed]) -> float:
    return sum(1e3 / x.frame_ms for x in speeds)


def device_table(speeds: Sequence[DeviceSpeed]) -> Table:
    """Tabulate the frame rate by the number of processes."""
    rows = [
        (f"{x.number}, {x.gl}", str(n), f"{rate:.1f}", f"{rate / n:.1f}",
         "best" if n == x.best else "")
        for x in speeds
        for n, rate in x.rates.items()
    ]  # fmt: skip
    return text_table(("device", "processes", "frames/s", "of each", "--workers-per-gpu"), rows)
