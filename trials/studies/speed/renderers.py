"""Speed of this renderer and of the stock one."""

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from trials.execution.progress import ProgressBar, no_progress
from trials.studies.speed.drive import TimedDrive
from vo.contract.arrays import Array, Image

IN_A_ROW = 8
"""Successive frames of one renderer; a recording also draws without pauses."""


@dataclass(frozen=True)
class RenderSpeed:
    """Times of both renderers on the same frames; medians in milliseconds per frame.

    Attributes:
        ours_ms: Both images, both depths, both identities.
        stock_ms: Both images, both depths.
        stock_left_ms: Both images, left depth.
        stock_files_ms: Encoding and writing the stock frame's images, depth and disparity.
        different_grey: Mean difference of the left images.
    """

    ours_ms: float
    stock_ms: float
    stock_left_ms: float
    stock_files_ms: float
    different_grey: float


def measure_renderers(
    drive: TimedDrive, frames: int, folder: Path, bar: ProgressBar = no_progress
) -> RenderSpeed:
    """Draw the same instants of the drive with both renderers alternately, a few frames each.

    Each has a process of its own, as one changes the state of the driver for the other.

    Args:
        drive: The drive.
        frames: Number of frames to draw, at even intervals.
        folder: Folder of the stock frames.
        bar: Shows progress.
    """
    spawn = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(1, spawn, _open_ours, (drive,)) as ours,
        ProcessPoolExecutor(1, spawn, _open_stock, (drive,)) as stock,
        bar("rendering") as progress,
    ):
        shares = np.linspace(0, 1, frames)
        turns = np.split(shares, range(IN_A_ROW, frames, IN_A_ROW))
        ours_ms, stock_ms, different = [], [], []
        _draw_both(ours, stock, shares[:1], folder)  # uploads textures
        for done, turn in enumerate(turns, start=1):
            drawn, plain = _draw_both(ours, stock, turn, folder)
            ours_ms += [ms for ms, _ in drawn]
            stock_ms += [ms for ms, _ in plain]
            pairs = zip(drawn, plain, strict=True)
            different += [np.abs(a.astype(int) - b).mean() for (_, a), (_, b) in pairs]
            progress(done, len(turns))
    columns = ours_ms, *zip(*stock_ms, strict=True), different
    return RenderSpeed(*(float(np.median(column)) for column in columns))


def _draw_both(
    ours: ProcessPoolExecutor, stock: ProcessPoolExecutor, shares: Array, folder: Path
) -> tuple[list[tuple[float, Image]], list[tuple[tuple[float, ...], Image]]]:
    """Return milliseconds and left image of each frame, ours first."""
    drawn = ours.submit(_draw_ours, shares.tolist()).result()
    return drawn, stock.submit(_draw_stock, shares.tolist(), folder).result()


@dataclass(frozen=True)
class _Resident:
    """Renderer and world in a process of its own, open as long as the process lives."""

    world: Any
    trip: Any
    renderer: Any
    opened: Any

    def place(self, share: float) -> None:
        """Set the world to a fraction of the trip."""
        time_ns = self.trip.timestamps_ns[round(share * (len(self.trip) - 1))]
        states = self.trip.states.at(self.world.model, time_ns)
        self.world.place(time_ns * 1e-9, states)


_resident: _Resident


def _open_ours(drive: TimedDrive) -> None:
    from sim.camera.render import StereoRenderer

    global _resident
    world, trip = drive.build()
    opened = StereoRenderer(world, drive.settings().render)
    _resident = _Resident(world, trip, opened.__enter__(), opened)


def _open_stock(drive: TimedDrive) -> None:
    from sim.camera.gl import choose_backend

    # mujoco picks the backend of its own renderer when it is imported.
    os.environ["MUJOCO_GL"] = choose_backend("auto")
    from trials.studies.stock import stock_renderer

    global _resident
    world, trip = drive.build()
    opened = stock_renderer(world, drive.settings().render)
    _resident = _Resident(world, trip, opened.__enter__(), opened)


def _draw_ours(shares: list[float]) -> list[tuple[float, Image]]:
    """Return milliseconds and the left image of each frame."""
    drawn = []
    for share in shares:
        _resident.place(share)
        start = perf_counter()
        left, _ = _resident.renderer.render_images()
        _resident.renderer.render_geometry()
        drawn.append((1e3 * (perf_counter() - start), left))
    return drawn


def _draw_stock(shares: list[float], folder: Path) -> list[tuple[tuple[float, ...], Image]]:
    """Return milliseconds with both depths, with the left one, and of files; the left image."""
    from trials.studies.stock import grey, render_plainly, write_plainly

    drawn = []
    for share in shares:
        _resident.place(share)
        start = perf_counter()
        render_plainly(_resident.renderer, _resident.world, depths=2)
        both = perf_counter()
        plain = render_plainly(_resident.renderer, _resident.world, depths=1)
        left = perf_counter()
        write_plainly(plain, _resident.world.rig, folder)
        written = perf_counter()
        times_ms = 1e3 * (both - start), 1e3 * (left - both), 1e3 * (written - left)
        drawn.append((times_ms, grey(plain.left)))
    return drawn
