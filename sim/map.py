"""The scene from straight above, orthographic, so that a position has one pixel at any height."""

from dataclasses import dataclass

import mujoco
import numpy as np

from sim.render import StereoRenderer
from vo.contract.arrays import Array, Image

LONG_SIDE_PX = 1024
CAMERA_ABOVE_M = 30.0


@dataclass(frozen=True)
class TopDownMap:
    """A picture with x to the right and y up, and its place in the world.

    Attributes:
        image: (H, W, 3) RGB.
        x_min_m: World x of the left edge of the leftmost pixels.
        y_max_m: World y of the upper edge of the topmost pixels.
        metres_per_px: Scale, equal along both axes.
    """

    image: Image
    x_min_m: float
    y_max_m: float
    metres_per_px: float

    def pixels(self, points_world: Array) -> Array:
        """Map (..., 2 or 3) world points in metres to (..., 2) (u, v), centres on integers."""
        u = (points_world[..., 0] - self.x_min_m) / self.metres_per_px - 0.5
        v = (self.y_max_m - points_world[..., 1]) / self.metres_per_px - 0.5
        return np.stack([u, v], axis=-1)


def render_map(renderer: StereoRenderer, extent_m: tuple[float, float, float, float]) -> TopDownMap:
    """Render the scene from above.

    Args:
        renderer: Of the world, at the state to show.
        extent_m: x_min, y_min, x_max, y_max in world metres.
    """
    x_min, y_min, x_max, y_max = extent_m
    scale = max(x_max - x_min, y_max - y_min) / LONG_SIDE_PX
    width, height = (round(side / scale) for side in (x_max - x_min, y_max - y_min))
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    # Whole pixels: the lower and right edges may reach a little past the extent.
    camera.lookat = (x_min + width * scale / 2, y_max - height * scale / 2, 0.0)
    camera.distance, camera.azimuth, camera.elevation = CAMERA_ABOVE_M, 90.0, -90.0
    image = renderer.picture(camera, width, height, orthographic_m=height * scale)
    return TopDownMap(image, x_min, y_max, scale)
