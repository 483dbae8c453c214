"""Stock renderer: MuJoCo's own, used as in its documentation, for comparison."""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import mujoco
import numpy as np

from scenes.scene import IMAGE_GROUP
from sim.camera.render import BOTH_GROUPS, SPARE_GEOMS
from sim.labels.labels import disparity_from_depth
from sim.settings import RenderSettings
from sim.world.rig import CAMERA
from sim.world.world import World
from vo.contract.arrays import Array, Image
from vo.contract.rig import StereoRig


@dataclass(frozen=True)
class StockView:
    """One frame of the stock renderer.

    Attributes:
        left: (H, W, 3) RGB uint8.
        right: Like `left`.
        depth_left_m: (H, W) float32 planar depth.
    """

    left: Image
    right: Image
    depth_left_m: Array


@contextmanager
def stock_renderer(world: World, settings: RenderSettings) -> Generator[mujoco.Renderer]:
    """Open `mujoco.Renderer` at the size of the rig and the quality of the settings.

    The environment's MUJOCO_GL must have named its backend before mujoco was imported.
    """
    quality = world.model.vis.quality
    quality.offsamples, quality.shadowsize = settings.samples, settings.shadow_size_px
    size = world.rig.height_px, world.rig.width_px
    with mujoco.Renderer(world.model, *size, world.model.ngeom + SPARE_GEOMS) as renderer:
        yield renderer


def render_plainly(renderer: mujoco.Renderer, world: World, depths: int) -> StockView:
    """Render both images and one or two depths in successive calls.

    Args:
        renderer: From `stock_renderer`.
        world: In the state to render.
        depths: 1 for the left depth, 2 for both; only the left one is returned.
    """
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
    view = StockView(left, right, render(-1, True))
    world.data.cam_xpos[camera] = centre
    return view


def write_plainly(view: StockView, rig: StereoRig, folder: Path) -> None:
    """Write the four files of a frame with OpenCV."""
    files = {
        "left.png": grey(view.left),
        "right.png": grey(view.right),
        "depth.tiff": view.depth_left_m,
        "disparity.tiff": disparity_from_depth(rig, view.depth_left_m),
    }
    for name, image in files.items():
        cv2.imwrite(str(folder / name), image)


def grey(rgb: Image) -> Image:
    """Convert (H, W, 3) RGB to (H, W) grey, the format of datasets."""
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)
