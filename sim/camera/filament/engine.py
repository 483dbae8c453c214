"""Images of a world by Filament: linear light of both cameras, from the same poses and frustums.

Filament's own processing of images is off: it would round to 8 bits, blur edges and add noise that
changes from frame to frame. Without it there is one linear number for each pixel, its red; so each
channel of the image is a scene of its own, whose red is that channel: grey or red, green, blue.
"""

import math
from typing import Any

import cv2
import mujoco
import numpy as np

from sim.camera.filament.context import open_filament
from sim.camera.filament.look import (
    BRIGHTEST,
    channel_model,
    headlight_of,
    lamps_of,
    options,
    sky_of,
)
from sim.camera.filament.sky import ktx_file
from sim.settings import RenderSettings
from sim.world.world import World
from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.rig import StereoRig

LAMP_CUTOFF_DEG, LAMP_RANGE_M = 85.0, 12.0
GREY = ((0.299, 0.587, 0.114),)
"""Weights of red, green and blue in grey, ITU-R BT.601, as in the classic renderer."""
RGB = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class FilamentImages:
    """Renders the images of a world; owns Filament's contexts, which survive no fork.

    `device` is the name of Vulkan's device.
    """

    def __init__(
        self, world: World, settings: RenderSettings, color: bool, shown: mujoco.MjvOption
    ) -> None:
        """Upload what a world shows; images are RGB if `color`.

        Raises:
            GraphicsError: If Filament or Vulkan is missing.
            SettingsError: If the lens is too wide for a single view.
        """
        if world.lens.views:
            raise SettingsError(
                "setting render.engine: filament has no lens that needs several views; use classic"
            )
        self._width_px = world.render_rig.width_px
        weights = np.array(RGB if color else GREY)
        self._channels = [_Channel(world, settings, x, shown) for x in weights]
        self.device = self._channels[0].device

    def render(self) -> tuple[Array, Array]:
        """Render left and right (H, W) grey or (H, W, 3) RGB image, float32 linear light.

        Light 1 is the brightest grey level; highlights may be brighter.
        """
        planes = [channel.render() for channel in self._channels]
        both = planes[0] if len(planes) == 1 else np.stack(planes, axis=-1)
        return both[:, : self._width_px].copy(), both[:, self._width_px :].copy()

    def free(self) -> None:
        """Release the scenes before the contexts that own them."""
        for channel in self._channels:
            channel.free()


class _Channel:
    """One channel of the images, the (3,) weighted mean of red, green and blue."""

    def __init__(
        self, world: World, settings: RenderSettings, weights: Array, shown: mujoco.MjvOption
    ) -> None:
        self._world, self._settings = world, settings
        self.device, mjrf, self._context = open_filament()
        self._mjrf = mjrf
        rig, (across, down) = world.render_rig, sample_grid(settings.samples)
        self._eye = rig.width_px * across, rig.height_px * down
        self._light = np.empty((self._eye[1], 2 * self._eye[0]), np.float32)
        formats = mjrf.PixelFormat
        self._target = self._context.create_render_target(
            mjrf.RenderTargetConfig(
                width=2 * self._eye[0],
                height=self._eye[1],
                color_format=formats.PIXEL_FORMAT_R32F,
                depth_format=formats.PIXEL_FORMAT_DEPTH32F,
            )
        )
        self._read = mjrf.ReadRequest(target=self._target)
        self._read.set_buffer(self._light)
        self._scene = self._context.create_scene(mjrf.SceneParams())
        self._scene.configure_from_model(options(settings))
        self._model = channel_model(world, settings, weights)
        self._resources = mjrf.ModelResources(self._context, self._model)
        self._lights = mjrf.ModelLights(self._scene, self._resources)
        self._surfaces = mjrf.ModelRenderables(self._scene, self._resources)
        self._surfaces.set_options(shown)
        self._headlight = headlight_of(world, weights)
        sky = sky_of(world, weights)
        self._sky = [] if sky is None else self._sky_light(ktx_file(sky))
        self._lamps = [self._lamp(*lamp) for lamp in lamps_of(world, weights)]

    def render(self) -> Array:
        """Render both cameras side by side, (H, 2W) float32 linear light."""
        rig, (width, height) = self._world.render_rig, self._eye
        self._lights.update(self._world.data)
        self._surfaces.update(self._world.data)
        requests = [
            self._mjrf.RenderRequest(
                scene=self._scene,
                camera=self._mjrf.Camera(**frustum),
                viewport=self._mjrf.Rect(k * width, 0, width, height),
                target=self._target,
                post_processing=False,
                reflections=False,
                haze=False,
                shadows=self._settings.shadow_size_px > 0,
                headlight=self._headlight > 0,
                headlight_intensity=self._headlight,
            )
            for k, frustum in enumerate(self._frustums(rig))
        ]
        self._context.wait_for_frame(self._context.render(requests, [self._read]))
        size = 2 * rig.width_px, rig.height_px
        return np.asarray(cv2.resize(self._light, size, interpolation=cv2.INTER_AREA))

    def free(self) -> None:
        """Release what belongs to the context before it."""
        self._sky.clear()
        self._lamps.clear()
        del self._surfaces, self._lights, self._resources, self._scene, self._read, self._target
        del self._context

    def _sky_light(self, data: bytes) -> list[Any]:
        """Let a cube of radiance shine on the scene; returns what must live as long."""
        mjrf = self._mjrf
        texture = self._context.create_texture(
            mjrf.TextureConfig(
                width=len(data),
                height=0,
                format=mjrf.PixelFormat.PIXEL_FORMAT_KTX,
                sampler_type=mjrf.SamplerType.TEXTURE_CUBE,
            )
        )
        upload = mjrf.TextureData()
        upload.set_image(data)
        texture.upload(upload)
        kind = mjrf.LightType.LIGHT_IMAGE
        params = mjrf.LightParams(type=kind, texture=texture, intensity=BRIGHTEST)
        light = self._context.create_light(params)
        self._scene.add_light(light)
        return [light, texture, upload, data]

    def _lamp(self, place: Array, candela: float) -> Any:
        """Let a lamp shine downwards and sideways."""
        light = self._context.create_light(
            self._mjrf.LightParams(
                type=self._mjrf.LightType.LIGHT_SPOT,
                color=[1, 1, 1],
                intensity=candela,
                cast_shadow=True,
                range=LAMP_RANGE_M,
                cutoff=LAMP_CUTOFF_DEG,
                softness=1.0,
                shadow_map_size=self._settings.shadow_size_px // 4,
            )
        )
        light.set_pose(place.astype(np.float32), np.array([0, 0, -1], np.float32))
        self._scene.add_light(light)
        return light

    def _frustums(self, rig: StereoRig) -> list[dict[str, Any]]:
        """Return place, direction and frustum of both cameras, with the rig's principal point."""
        T, near = self._world.T_world_cam, self._settings.near_m
        left, right = (x / rig.f_px for x in (-rig.cx_px - 0.5, rig.width_px - 0.5 - rig.cx_px))
        top, bottom = (y / rig.f_px for y in (rig.cy_px + 0.5, rig.cy_px + 0.5 - rig.height_px))
        return [
            {
                "pos": (T[:3, 3] + k * rig.baseline_m * T[:3, 0]).astype(np.float32),
                "forward": T[:3, 2].astype(np.float32),
                "up": -T[:3, 1].astype(np.float32),
                "frustum_center": near * (left + right) / 2,
                "frustum_width": near * (right - left) / 2,
                "frustum_bottom": near * bottom,
                "frustum_top": near * top,
                "frustum_near": near,
                "frustum_far": self._settings.far_m,
            }
            for k in (0, 1)
        ]


def sample_grid(samples: int) -> tuple[int, int]:
    """Return columns and rows of the samples of a pixel: as many as fit, more rows than columns.

    The ground recedes along the rows, so that they need the samples first.
    """
    across = math.isqrt(max(samples, 1))
    return across, max(samples, 1) // across
