"""The renderer: both eyes in one pass, colour and labels, and single pictures for people."""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import cv2
import mujoco
import numpy as np

from sim.gl import GLContext, GraphicsError, open_context
from sim.rig import CAMERA
from sim.rover import PREFIX
from sim.settings import RenderSettings
from sim.world import World
from vo.contract.arrays import Array, Image, Indices

SPARE_GEOMS = 100
"""Room for what MuJoCo adds to a scene, such as the reflections of a mirror."""

NO_GEOM = -1


@dataclass(frozen=True)
class StereoView:
    """What both eyes see at one instant.

    Attributes:
        left: (H, W) grey, or (H, W, 3) RGB, uint8.
        right: Like `left`.
        depth_left_m: (H, W) float32 planar depth at the pixel centres; NaN where nothing is hit.
        depth_right_m: Like `depth_left_m`, in the right eye.
    """

    left: Image
    right: Image
    depth_left_m: Array
    depth_right_m: Array


class StereoRenderer:
    """Renders a world off-screen; a context manager, and the only owner of GL in its process.

    Colour may be multisampled. Depth and segmentation never are: they come from a pass of their
    own without samples, textures, light or shadows, so that each holds exactly at pixel centres
    (a resolved depth is some sample's, off the centre: a median 0.13 % wrong on paving). Without
    multisampling one pass gives both.
    """

    def __init__(self, world: World, settings: RenderSettings, color: bool = False) -> None:
        """Remember what to render; the GL context is made on entering.

        Args:
            world: Is looked at, never changed, except for MuJoCo's picture quality settings.
            settings: Backend and quality.
            color: Whether `stereo` gives RGB instead of grey.
        """
        self._world = world
        self._settings = settings
        self._color = color
        self._width, self._height = world.rig.width_px, world.rig.height_px
        self._gl: GLContext | None = None

    def __enter__(self) -> Self:
        model, settings = self._world.model, self._settings
        model.vis.map.znear = settings.near_m / model.stat.extent
        model.vis.map.zfar = settings.far_m / model.stat.extent
        model.vis.global_.offwidth = 2 * self._width
        model.vis.global_.offheight = self._height
        self._gl = open_context(settings.backend, 2 * self._width, self._height)
        try:
            self._paint = _context(model, settings.samples, settings.shadow_size_px)
            self._label = _context(model, 0, 0) if settings.samples else self._paint
        except mujoco.FatalError as error:
            self._gl.free()
            raise GraphicsError(f"the GL refuses a picture of this size ({error})") from None
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + SPARE_GEOMS)
        self._rect = mujoco.MjrRect(0, 0, 2 * self._width, self._height)
        self._rgb = np.empty((self._height, 2 * self._width, 3), np.uint8)
        self._zbuffer = np.empty((self._height, 2 * self._width), np.float32)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        tb: TracebackType | None,
    ) -> None:
        assert self._gl is not None
        self._paint.free()
        if self._label is not self._paint:
            self._label.free()
        self._gl.free()
        self._gl = None

    @property
    def gl_strings(self) -> dict[str, str]:
        """Vendor, renderer and version, as the driver calls itself."""
        from OpenGL import GL  # binds to the backend chosen on entering

        names = {"vendor": GL.GL_VENDOR, "renderer": GL.GL_RENDERER, "version": GL.GL_VERSION}
        return {name: GL.glGetString(code).decode() for name, code in names.items()}

    def stereo(self, depth: bool = True) -> StereoView:
        """Render both eyes at the world's present state (see `World.place_bodies`).

        Args:
            depth: Whether to fill the depths; without, they are NaN throughout.
        """
        self._look_through_rig()
        one_pass = self._label is self._paint
        self._draw(self._paint, self._rect, self._rgb, self._zbuffer if one_pass else None)
        if depth and not one_pass:
            with _segmenting(self._scene):
                self._draw(self._label, self._rect, None, self._zbuffer)
        image = self._rgb if self._color else cv2.cvtColor(self._rgb, cv2.COLOR_RGB2GRAY)
        metres = self._metric_depth() if depth else np.full_like(self._zbuffer, np.nan)
        return StereoView(*self._eyes(np.asarray(image, np.uint8)), *self._eyes(metres))

    def segmentation(self) -> tuple[Indices, Indices]:
        """Return the (H, W) geom ids that the left and the right eye see; NO_GEOM for none."""
        self._look_through_rig()
        with _segmenting(self._scene):
            self._draw(self._label, self._rect, self._rgb, None)
        codes = self._rgb.astype(np.int64) @ np.array([1, 1 << 8, 1 << 16])
        ids = np.full(self._scene.ngeom + 1, NO_GEOM, dtype=np.int64)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                ids[geom.segid + 1] = geom.objid
        return self._eyes(ids[codes])

    def picture(
        self,
        camera: mujoco.MjvCamera,
        width_px: int,
        height_px: int,
        orthographic_m: float | None = None,
    ) -> Image:
        """Render one (H, W, 3) RGB picture from any camera, for people to look at.

        Args:
            camera: Free, tracking or fixed.
            width_px: W.
            height_px: H.
            orthographic_m: Vertical extent of an orthographic view; None for perspective.
        """
        if width_px > self._paint.offWidth or height_px > self._paint.offHeight:
            size = max(width_px, self._paint.offWidth), max(height_px, self._paint.offHeight)
            mujoco.mjr_resizeOffscreen(*size, self._paint)
        view = self._world.model.vis.global_
        perspective_fovy_deg = view.fovy
        if orthographic_m is not None:
            camera.orthographic, view.fovy = 1, orthographic_m
        self._update(camera, mujoco.mjtStereo.mjSTEREO_NONE)
        view.fovy = perspective_fovy_deg
        rgb = np.empty((height_px, width_px, 3), np.uint8)
        self._draw(self._paint, mujoco.MjrRect(0, 0, width_px, height_px), rgb, None)
        return np.asarray(cv2.flip(rgb, 0), np.uint8)

    def _look_through_rig(self) -> None:
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        camera.fixedcamid = self._world.model.camera(PREFIX + CAMERA).id
        self._update(camera, mujoco.mjtStereo.mjSTEREO_SIDEBYSIDE)

    def _update(self, camera: mujoco.MjvCamera, stereo: mujoco.mjtStereo) -> None:
        everything = mujoco.mjtCatBit.mjCAT_ALL
        world, option = self._world, mujoco.MjvOption()
        mujoco.mjv_updateScene(
            world.model, world.data, option, None, camera, everything, self._scene
        )
        self._scene.stereo = stereo
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = self._settings.shadow_size_px > 0

    def _draw(
        self,
        context: mujoco.MjrContext,
        rect: mujoco.MjrRect,
        rgb: Image | None,
        zbuffer: Array | None,
    ) -> None:
        assert self._gl is not None
        self._gl.make_current()
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, context)
        mujoco.mjr_render(rect, self._scene, context)
        mujoco.mjr_readPixels(rgb, zbuffer, rect, context)

    def _metric_depth(self) -> Array:
        """Convert the depth buffer (1 near, 0 far) to metres along the optical axis.

        The projection maps depth Z to s = a / Z - c with c = n / (f - n) and a = f n / (f - n),
        in OpenGL's own single precision; what is cleared (s = 0) has no depth.
        """
        visual, extent = self._world.model.vis, self._world.model.stat.extent
        near, far = np.float32(visual.map.znear * extent), np.float32(visual.map.zfar * extent)
        c, a = near / (far - near), far * near / (far - near)
        s = np.where(self._zbuffer > 0, self._zbuffer, np.float32(np.nan))
        return a / (s + c)

    def _eyes(self, both: Array) -> tuple[Array, Array]:
        """Cut (H, 2W, ...) with the bottom row first into two upright, contiguous images."""
        left, right = both[::-1, : self._width], both[::-1, self._width :]
        return np.ascontiguousarray(left), np.ascontiguousarray(right)


@contextmanager
def _segmenting(scene: mujoco.MjvScene) -> Generator[None]:
    """Draw flat geom numbers instead of surfaces while the block runs."""
    flags = (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR)
    for flag in flags:
        scene.flags[flag] = True
    try:
        yield
    finally:
        for flag in flags:
            scene.flags[flag] = False


def _context(model: mujoco.MjModel, samples: int, shadow_size_px: int) -> mujoco.MjrContext:
    """Upload the model into a render context with its own off-screen buffer."""
    model.vis.quality.offsamples = samples
    model.vis.quality.shadowsize = shadow_size_px
    context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
    context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
    return context
