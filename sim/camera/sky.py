"""The sky, drawn last and only in the rows that show it.

MuJoCo draws the sky behind everything, over the whole image: a sixth of an image's time with a
software renderer. Here MuJoCo first draws without sky; samples without alpha are uncovered, and
MuJoCo draws the sky alone in their rows, with the same colours. The rows of the frame before, and a
margin, have it before the image is read; where these were too few, the rest is drawn and read.
MuJoCo clears before each drawing and draws the whole image; two geoms that are display lists limit
both: clearing is discarded until the opaque one, drawn before the sky, ends that and sets a scissor
rectangle, which the transparent one, drawn after the sky, removes. Alpha remains as it was.
"""

import mujoco
import numpy as np

from vo.contract.arrays import Image, Indices

GAP_PX = 32
"""Rows without sky between two bands that are worth a separate pass."""
MARGIN_PX = 12
"""The horizon moves by less from frame to frame, as a rule."""
WIDE_PX = 1 << 15
"""Wider than any image."""
OPAQUE = np.uint32(0xFF000000)


class SkyBands:
    """Drawing of the sky of one context's images in bands of rows."""

    def __init__(self, context: mujoco.MjrContext) -> None:
        """Reserve names for the two display lists; the context must be current."""
        from OpenGL import GL  # binds to the backend that is open

        self._gl = GL
        self._before = int(GL.glGenLists(2))
        self._base = context.baseMesh
        self.expected: list[tuple[int, int]] = []
        """Bands of rows of the next image that probably show sky."""
        GL.glNewList(self._before + 1, GL.GL_COMPILE)
        GL.glDisable(GL.GL_SCISSOR_TEST)
        GL.glColorMask(True, True, True, True)
        GL.glEndList()

    def prepare(self, scene: mujoco.MjvScene, low: int, high: int) -> None:
        """Make the next drawing of the scene add sky to rows `low` to `high - 1` from the bottom.

        The scene, drawn without sky, loses its geoms.
        """
        gl = self._gl
        gl.glNewList(self._before, gl.GL_COMPILE)
        gl.glDisable(gl.GL_RASTERIZER_DISCARD)
        gl.glEnable(gl.GL_SCISSOR_TEST)
        gl.glScissor(0, low, WIDE_PX, high - low)
        gl.glColorMask(True, True, True, False)
        gl.glEndList()
        scene.ngeom = 2
        for after, geom in enumerate(scene.geoms[:2]):
            rgba = np.array([1, 1, 1, 0.5 if after else 1], np.float32)
            nowhere = np.zeros(3), np.zeros(3), np.eye(3).ravel()
            mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_MESH, *nowhere, rgba)
            geom.dataid = self._before + after - self._base
            geom.transparent = after
        scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = True
        gl.glEnable(gl.GL_RASTERIZER_DISCARD)

    def missing(self, rgba: Image) -> list[tuple[int, int]]:
        """Return bands of (H, W, 4) with uncovered samples that were not expected; expect anew."""
        is_missing = rgba.view(np.uint32)[..., 0].min(axis=1) < OPAQUE
        uncovered = np.flatnonzero(is_missing)
        for low, high in self.expected:
            is_missing[low:high] = False
        bands = in_bands(uncovered)
        self.expected = [(max(low - MARGIN_PX, 0), high + MARGIN_PX) for low, high in bands]
        return in_bands(np.flatnonzero(is_missing))

    def free(self) -> None:
        """Release the lists; the context must be current."""
        self._gl.glDeleteLists(self._before, 2)


def allows_sky_last(scene: mujoco.MjvScene) -> bool:
    """Whether the sky may be drawn last: no geom is transparent."""
    return not any(geom.transparent for geom in scene.geoms[: scene.ngeom])


def in_bands(rows: Indices) -> list[tuple[int, int]]:
    """Return bands of rows (first, after the last) that contain all of the sorted `rows`."""
    bands = np.split(rows, np.flatnonzero(np.diff(rows) > GAP_PX) + 1) if len(rows) else []
    return [(int(band[0]), int(band[-1]) + 1) for band in bands]
