"""Speed of this renderer and of the stock one: MuJoCo's own, used as in its documentation."""

import os
from collections.abc import Generator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from types import SimpleNamespace
from typing import Any

import cv2
import mujoco
import numpy as np

from scenes.scene import IMAGE_GROUP
from sim.camera.gl import choose_backend
from sim.camera.render import BOTH_GROUPS, SPARE_GEOMS, StereoRenderer
from sim.labels.labels import disparity_from_depth
from sim.settings import RenderSettings
from sim.world.rig import CAMERA
from sim.world.world import World
from trials.execution.progress import ProgressBar, no_progress
from trials.studies.speed.drive import SPAWN, TimedDrive
from vo.contract.arrays import Array, Image

IN_A_ROW = 8
"""Successive frames of one renderer; a recording also draws without pauses."""
FEW_PIXELS = ("rig.width_px=64", "rig.height_px=48")
"""A hundredth of the pixels of the default camera, which sees the same."""
opened: Any = SimpleNamespace()
"""World, trip and renderer of this process, which remain open as long as it lives."""


@dataclass(frozen=True)
class RenderSpeed:
    """Times of both renderers on the same frames; medians in milliseconds per frame.

    Attributes:
        ours_ms: Both images, both depths, both identities.
        few_pixels_ms: The same at FEW_PIXELS: what does not depend on the number of pixels.
        stock_ms: Both images, both depths.
        stock_left_ms: Both images, left depth.
        stock_files_ms: Encoding and writing the stock frame's images, depth and disparity.
        different_grey: Mean difference of the left images.
    """

    ours_ms: float
    few_pixels_ms: float
    stock_ms: float
    stock_left_ms: float
    stock_files_ms: float
    different_grey: float

    @property
    def pixels_ms(self) -> float:
        """Time of ours that grows with the pixels: filling and shading, copying, decoding."""
        return self.ours_ms - self.few_pixels_ms


def measure_renderers(
    drive: TimedDrive, frames: int, folder: Path, bar: ProgressBar = no_progress
) -> RenderSpeed:
    """Draw the same instants of the drive with both renderers alternately, a few frames each.

    Each has a process of its own, as one changes the state of the driver for the other. The stock
    frames are written into a folder.
    """
    # MuJoCo chooses the backend of its own renderer when a process imports it.
    os.environ["MUJOCO_GL"] = choose_backend("auto")
    with (
        ProcessPoolExecutor(1, SPAWN, _open, (drive, StereoRenderer)) as ours,
        ProcessPoolExecutor(1, SPAWN, _open, (drive, StereoRenderer, *FEW_PIXELS)) as few,
        ProcessPoolExecutor(1, SPAWN, _open, (drive, stock_renderer)) as stock,
        bar("rendering") as progress,
    ):
        shares = np.linspace(0, 1, frames)
        turns = [shares[:1], *np.split(shares, range(IN_A_ROW, frames, IN_A_ROW))]
        rows: list[tuple[float, ...]] = []
        for done, turn in enumerate(turns):
            drawn = ours.submit(_draw_ours, turn.tolist()).result()
            small = few.submit(_draw_ours, turn.tolist()).result()
            plain = stock.submit(_draw_stock, turn.tolist(), folder).result()
            for (ours_ms, our_left), (few_ms, _), (*stock_ms, left) in zip(
                drawn, small, plain, strict=True
            ):
                different_grey = np.abs(our_left.astype(int) - left).mean()
                rows.append((ours_ms, few_ms, *stock_ms, different_grey))
            progress(done, len(turns) - 1)
    return RenderSpeed(*np.median(rows[1:], axis=0).tolist())  # the first uploads textures


@contextmanager
def stock_renderer(world: World, settings: RenderSettings) -> Generator[mujoco.Renderer]:
    """Open `mujoco.Renderer` at the size of the rig and the quality of the settings."""
    quality = world.model.vis.quality
    quality.offsamples, quality.shadowsize = settings.samples, settings.shadow_size_px
    size = world.rig.height_px, world.rig.width_px
    with mujoco.Renderer(world.model, *size, world.model.ngeom + SPARE_GEOMS) as renderer:
        yield renderer


def _open(drive: TimedDrive, renderer: Any, *overrides: str) -> None:
    settings = drive.settings(*overrides)
    opened.world, opened.trip = drive.build(settings)
    opened.context = renderer(opened.world, settings.render)
    opened.renderer = opened.context.__enter__()


def _place(share: float) -> None:
    """Set the world to a fraction of the trip."""
    time_ns = opened.trip.timestamps_ns[round(share * (len(opened.trip) - 1))]
    opened.world.place(time_ns * 1e-9, opened.trip.states.at(opened.world.model, time_ns))


def _draw_ours(shares: list[float]) -> list[tuple[float, Image]]:
    """Return milliseconds and the left image of each frame."""
    drawn = []
    for share in shares:
        _place(share)
        start = perf_counter()
        left, _ = opened.renderer.render_images()
        opened.renderer.render_geometry()
        drawn.append((1e3 * (perf_counter() - start), left))
    return drawn


def _draw_stock(shares: list[float], folder: Path) -> list[tuple[Any, ...]]:
    """Return milliseconds with both depths, with the left one, and of files; the left image."""
    drawn = []
    for share in shares:
        _place(share)
        start = perf_counter()
        _render_stock(depths=2)
        both = perf_counter()
        left, right, depth_m = _render_stock(depths=1)
        one = perf_counter()
        greys = [np.asarray(cv2.cvtColor(x, cv2.COLOR_RGB2GRAY), np.uint8) for x in (left, right)]
        disparity_px = disparity_from_depth(opened.world.rig, depth_m)
        files = zip(("left.png", "right.png", "depth.tiff", "disparity.tiff"),
                    (*greys, depth_m, disparity_px), strict=True)  # fmt: skip
        for name, image in files:
            cv2.imwrite(str(folder / name), image)
        times_s = np.diff([start, both, one, perf_counter()])
        drawn.append((*(1e3 * times_s), greys[0]))
    return drawn


def _render_stock(depths: int) -> tuple[Image, Image, Array]:
    """Render RGB images (H, W, 3) and one or two depths; return images and left depth (H, W), m."""
    world, renderer = opened.world, opened.renderer
    camera = world.model.camera(CAMERA).id
    centre = world.data.cam_xpos[camera].copy()
    option = mujoco.MjvOption()
    option.geomgroup[:] = 0
    option.geomgroup[[*BOTH_GROUPS, IMAGE_GROUP]] = 1
    half_baseline = world.rig.baseline_m / 2 * world.data.cam_xmat[camera].reshape(3, 3)[:, 0]

    def render(side: int, depth: bool) -> Array:
        world.data.cam_xpos[camera] = centre + side * half_baseline
        if depth:
            renderer.enable_depth_rendering()
        renderer.update_scene(world.data, camera, option)
        image = renderer.render()
        renderer.disable_depth_rendering()
        return image

    right, left = render(1, False), render(-1, False)
    if depths == 2:
        render(1, True)
    depth_left_m = render(-1, True)
    world.data.cam_xpos[camera] = centre
    return left, right, depth_left_m
