"""The renderer: stereo images and label buffers in one pass each, and views from other cameras."""

from copy import copy
from dataclasses import dataclass
from typing import Any, Self

import cv2
import mujoco
import numpy as np

from scenes.scene import COLLISION_GROUP, IMAGE_GROUP, LABEL_GROUP
from sim.camera.filament.engine import FilamentImages
from sim.camera.frustum import aim, in_frustum
from sim.camera.gl import Framebuffer, decode_buffers, open_context
from sim.camera.sky import SkyBands, allows_sky_last
from sim.graphics import GraphicsError, explain_fault
from sim.imaging.raw_lens import Views
from sim.settings import RenderSettings
from sim.world.drawn import drawn_objects, max_drawn, reflecting_materials
from sim.world.rig import CAMERA
from sim.world.world import World
from vo.contract.arrays import Array, Image, Indices
from vo.contract.remarks import remark
from vo.contract.rig import StereoRig

SPARE_GEOMS = 100
"""Number of shapes in MuJoCo's scene beyond those of the world."""
DRAWN = mujoco.mjtCatBit.mjCAT_STATIC | mujoco.mjtCatBit.mjCAT_DYNAMIC
"""Categories that are drawn: all but decorations, such as the rays of range finders."""
NO_GEOM = -1
BOTH_GROUPS = (0, 1, 2)
"""Geom groups in images and labels alike: the rover, and a user's own world."""


@dataclass(frozen=True)
class GeometryBuffers:
    """Depth and objects of both cameras at one instant, exact at the pixel centres.

    Depths are (H, W) float32 planar metres, NaN without a surface; objects are (H, W) numbers of
    `DrawnObjects`, which of geoms are their ids, or NO_GEOM.
    """

    depth_left_m: Array
    depth_right_m: Array
    geoms_left: Indices
    geoms_right: Indices


class StereoRenderer:
    """Off-screen renderer of a world: a context manager that alone owns OpenGL in its process.

    With `render.engine` filament, that engine renders the images, and OpenGL all the rest.
    Images may be multisampled. Depth and geom ids are rendered separately, without samples,
    textures, light or shadows, so that they hold exactly at pixel centres (a resolved depth is that
    of some sample off the centre: a median 0.13 % wrong on paving). Geoms out of view are culled.
    """

    def __init__(self, world: World, settings: RenderSettings, color: bool = False) -> None:
        """Store what to render, RGB if `color`; the OpenGL context is created on entering.

        In the world, only MuJoCo's quality settings are changed.
        """
        self._world = world
        self._settings = settings
        self._color = color
        self._width, self._height = world.render_rig.width_px, world.render_rig.height_px
        views = world.lens.views
        self._view_px = views.rig.width_px if views else 0
        self._gl: Any = None
        self._filament: FilamentImages | None = None
        self._image_option = _showing(*BOTH_GROUPS, IMAGE_GROUP)
        self._label_option = _showing(*BOTH_GROUPS, LABEL_GROUP)
        self._drawn = drawn_objects(world)
        if mirrors := reflecting_materials(world.model):
            name = world.scene.source or world.scene.name
            remark(f"{name}: reflections are not rendered (material {', '.join(mirrors)})")

    def __enter__(self) -> Self:
        model, settings = self._world.model, self._settings
        model.vis.map.znear = settings.near_m / model.stat.extent
        model.vis.map.zfar = settings.far_m / model.stat.extent
        width, height = (max(x, self._view_px) for x in (self._width, self._height))
        model.vis.global_.offwidth, model.vis.global_.offheight = 2 * width, height
        model.vis.quality.offsamples = settings.samples
        model.vis.quality.shadowsize = settings.shadow_size_px
        self._gl = open_context(settings.backend, 2 * width, height)
        try:
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
            self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
            self._image_framebuffer = Framebuffer(self._context, settings.samples)
            self._label_framebuffer = Framebuffer(self._context, 0)
            self._sky = SkyBands(self._context)
        except Exception as error:  # a driver may lack any function
            self._gl.free()
            size = f"{2 * self._width}x{self._height} px"
            raise GraphicsError(f"OpenGL cannot render {size}: {explain_fault(error)}") from None
        self._scene = mujoco.MjvScene(model, maxgeom=max_drawn(model) + SPARE_GEOMS)
        self._rect = mujoco.MjrRect(0, 0, 2 * self._width, self._height)
        if settings.engine == "filament":
            self._filament = FilamentImages(self._world, settings, self._color, self._image_option)
        self._rgba = np.empty((self._height, 2 * self._width, 4), np.uint8)
        self._codes, self._zbuffer = np.empty((0, 0), np.uint32), np.empty((0, 0), np.float32)
        return self

    def __exit__(self, *error: object) -> None:
        if self._filament:
            self._filament.free()
            self._filament = None
        self._gl.make_current()
        self._image_framebuffer.free()
        self._label_framebuffer.free()
        self._sky.free()
        self._context.free()
        self._gl.free()
        self._gl = None

    @property
    def gl_strings(self) -> dict[str, str]:
        """Vendor, renderer and version of the OpenGL driver, and the device of Filament's."""
        from OpenGL import GL  # binds to the backend chosen on entering

        names = {"vendor": GL.GL_VENDOR, "renderer": GL.GL_RENDERER, "version": GL.GL_VERSION}
        found = {name: GL.glGetString(code).decode() for name, code in names.items()}
        return found | ({"filament": self._filament.device} if self._filament else {})

    def render_images(self) -> tuple[Array, Array]:
        """Render left and right (H, W) grey or (H, W, 3) RGB image of the world as placed.

        They are uint8 of the classic engine, and linear light, float32, of Filament and of a wide
        lens, whose raw light they are.
        """
        if self._world.lens.views:
            return self._render_raw_light(self._world.lens.views)
        if self._filament:
            return self._filament.render()
        self._update_stereo(self._image_option)
        sky_last = allows_sky_last(self._scene)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = not sky_last
        with self._image_framebuffer as framebuffer:
            self._draw(self._rect)
            for band in self._sky.expected if sky_last else []:
                self._draw_sky(*band)
            framebuffer.read_colour(self._rgba)
            for band in self._sky.missing(self._rgba) if sky_last else []:
                self._draw_sky(*band)
                framebuffer.read_colour(self._rgba, *band)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = True
        return self._split(self._coloured(self._rgba))

    def _draw_sky(self, low: int, high: int) -> None:
        self._sky.prepare(self._scene, low, high)
        self._draw(self._rect)

    def _render_raw_light(self, views: Views) -> tuple[Array, Array]:
        size = self._view_px
        rect, rgba = mujoco.MjrRect(0, 0, 2 * size, size), np.empty((size, 2 * size, 4), np.uint8)
        stacks: list[tuple[Image, Image]] = []
        for R in views.R_cam_views:
            self._update_stereo(self._image_option, views.rig, R)
            with self._image_framebuffer as framebuffer:
                self._draw(rect)
                framebuffer.read_colour(rgba)
            stacks.append(self._split(self._coloured(rgba)))
        left, right = (np.concatenate(x) for x in zip(*stacks, strict=True))
        return self._world.lens.raw_light(0, left), self._world.lens.raw_light(1, right)

    def _coloured(self, rgba: Image) -> Image:
        form = cv2.COLOR_RGBA2RGB if self._color else cv2.COLOR_RGBA2GRAY
        return np.asarray(cv2.cvtColor(rgba, form), np.uint8)

    def render_geometry(self) -> GeometryBuffers:
        """Render depth and objects of both cameras at the world's present state."""
        return self._geometry(self._label_option)

    def render_whole_geometry(self, pinhole: GeometryBuffers) -> GeometryBuffers:
        """Render that of the stacked views (V N, N) of a wide lens; of another, it is `pinhole`."""
        if not (views := self._world.lens.views):
            return pinhole
        found = [self._geometry(self._label_option, views.rig, R) for R in views.R_cam_views]
        stacks = zip(*(vars(x).values() for x in found), strict=True)
        return GeometryBuffers(*(np.concatenate(x) for x in stacks))

    def render_drawn_geometry(self) -> GeometryBuffers:
        """Render as `render_geometry` what images draw, which must be the same."""
        return self._geometry(self._image_option)

    def render_layers(self) -> list[tuple[Image, Image]]:
        """Render three times left and right (H, W, 4), without samples, as pixels' centres show it.

        What images draw; the same with all that can have a label hidden; the background alone.
        """
        hidden = copy(self._image_option)
        for kind in ("geom", "site", "joint", "tendon", "actuator", "flex", "skin"):
            getattr(hidden, f"{kind}group")[:] = 0
        layers: list[tuple[Image, Image]] = []
        for option in (self._image_option, hidden, None):
            if option:
                self._update_stereo(option)
            else:
                self._scene.ngeom = 0
            with self._label_framebuffer as framebuffer:
                self._draw(self._rect)
                framebuffer.read_colour(self._rgba)
            layers.append(self._split(self._rgba))
        return layers

    def _geometry(
        self, option: mujoco.MjvOption, rig: StereoRig | None = None, R: Array | None = None
    ) -> GeometryBuffers:
        rig = rig or self._world.render_rig
        self._update_stereo(option, rig, R)
        shape = rig.height_px, 2 * rig.width_px
        if self._codes.shape != shape:
            self._codes, self._zbuffer = np.empty(shape, np.uint32), np.empty(shape, np.float32)
        flags = [int(mujoco.mjtRndFlag.mjRND_SEGMENT), int(mujoco.mjtRndFlag.mjRND_IDCOLOR)]
        self._scene.flags[flags] = True
        with self._label_framebuffer as framebuffer:
            self._draw(mujoco.MjrRect(0, 0, *shape[::-1]))
            framebuffer.read_colour(self._codes.view(np.uint8).reshape(*shape, 4))
            framebuffer.read_depth(self._zbuffer)
        self._scene.flags[flags] = False
        view, extent = self._world.model.vis.map, self._world.model.stat.extent
        near, far = np.float32(view.znear * extent), np.float32(view.zfar * extent)
        ids = self._drawn.numbers(self._scene, NO_GEOM)
        depths, geoms = decode_buffers(self._zbuffer, self._codes, ids, near, far)
        return GeometryBuffers(*depths, *geoms)

    def render_view(
        self,
        camera: mujoco.MjvCamera,
        width_px: int,
        height_px: int,
        orthographic_m: float | None = None,
    ) -> Image:
        """Render one (H, W, 3) RGB image from any camera.

        An orthographic view has a vertical extent in metres; None is perspective.
        """
        context = self._context
        if width_px > context.offWidth or height_px > context.offHeight:
            size = max(width_px, context.offWidth), max(height_px, context.offHeight)
            mujoco.mjr_resizeOffscreen(*size, context)
        view = self._world.model.vis.global_
        perspective_fovy_deg = view.fovy
        if orthographic_m is not None:
            camera.orthographic, view.fovy = 1, orthographic_m
        self._update(camera, self._image_option, mujoco.mjtStereo.mjSTEREO_NONE)
        view.fovy = perspective_fovy_deg
        rgb = np.empty((height_px, width_px, 3), np.uint8)
        rect = mujoco.MjrRect(0, 0, width_px, height_px)
        self._draw(rect)
        mujoco.mjr_readPixels(rgb, None, rect, context)
        return np.asarray(cv2.flip(rgb, 0), np.uint8)

    def _update_stereo(
        self, option: mujoco.MjvOption, rig: StereoRig | None = None, R: Array | None = None
    ) -> None:
        """Update MuJoCo's scene with the geoms in a rig's views, which R (3, 3) turns both."""
        rig = rig or self._world.render_rig
        model, data = self._world.model, self._world.data
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        camera.fixedcamid = model.camera(CAMERA).id
        groups = model.geom_group.copy()
        model.geom_group[~in_frustum(model, data, rig, R)] = COLLISION_GROUP
        try:
            self._update(camera, option, mujoco.mjtStereo.mjSTEREO_SIDEBYSIDE)
        finally:
            model.geom_group[:] = groups
        if R is not None:
            aim(self._scene, self._world.T_world_cam, rig, R)

    def _update(
        self, camera: mujoco.MjvCamera, option: mujoco.MjvOption, stereo: mujoco.mjtStereo
    ) -> None:
        model, data = self._world.model, self._world.data
        mujoco.mjv_updateScene(model, data, option, None, camera, int(DRAWN), self._scene)
        if self._scene.ngeom >= self._scene.maxgeom:
            raise GraphicsError(f"the world has more than {self._scene.maxgeom} shapes to draw")
        self._scene.stereo = stereo
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = self._settings.shadow_size_px > 0

    def _draw(self, rect: mujoco.MjrRect) -> None:
        self._gl.make_current()
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        mujoco.mjr_render(rect, self._scene, self._context)

    def _split(self, both: Array) -> tuple[Array, Array]:
        """Split (H, 2W, ...), bottom row first, into two upright, contiguous images."""
        left, right = np.split(both[::-1], 2, axis=1)
        return np.ascontiguousarray(left), np.ascontiguousarray(right)


def _showing(*groups: int) -> mujoco.MjvOption:
    option = mujoco.MjvOption()
    option.geomgroup[:] = 0
    option.geomgroup[list(groups)] = 1
    option.flags[mujoco.mjtVisFlag.mjVIS_RANGEFINDER] = 0
    return option
