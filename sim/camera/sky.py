"""The sky, drawn afterwards and only where a picture still lacks it.

MuJoCo draws the sky behind all else, over the whole picture, and a software renderer asks every
sample whether something is before it: a sixth of a picture's time, however little sky there is.
Here MuJoCo draws without it. What is cleared has no alpha and what is drawn has, so the rows where
a sample still shows nothing are known for certain, down to cracks between two tiles. Then MuJoCo
draws the sky alone, into those rows: the same samples get the same colours.

MuJoCo cannot draw without clearing first, nor into some rows only. But two geoms that are nothing
but display lists can go along: clearing is discarded until the opaque one, which is drawn before
the sky, ends that and sets a scissor; the transparent one, drawn after it, takes it away.
"""

import mujoco
import numpy as np

from vo.contract.arrays import Image

GAP_PX = 32
"""Rows without sky between two bands that are worth a pass each."""
WIDE_PX = 1 << 15
"""Wider than any picture."""
OPAQUE = np.uint32(0xFF000000)


class SkyBands:
    """Draws the sky of one context's pictures into bands of rows."""

    def __init__(self, context: mujoco.MjrContext) -> None:
        """Reserve names for the two display lists; the context must be current."""
        from OpenGL import GL  # binds to the backend that is open

        self._gl = GL
        self._before = int(GL.glGenLists(2))  # pyright: ignore[reportArgumentType]
        self._base = context.baseMesh
        GL.glNewList(self._before + 1, GL.GL_COMPILE)
        GL.glDisable(GL.GL_SCISSOR_TEST)
        GL.glEndList()

    def prepare(self, scene: mujoco.MjvScene, low: int, high: int) -> None:
        """Make the next drawing of the scene add sky to rows `low` to `high - 1` from the bottom.

        Args:
            scene: Was drawn without sky; loses its geoms.
            low: First row.
            high: Behind the last row.
        """
        gl = self._gl
        gl.glNewList(self._before, gl.GL_COMPILE)
        gl.glDisable(gl.GL_RASTERIZER_DISCARD)
        gl.glEnable(gl.GL_SCISSOR_TEST)
        gl.glScissor(0, low, WIDE_PX, high - low)
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

    def free(self) -> None:
        """Release the lists; the context must be current."""
        self._gl.glDeleteLists(self._before, 2)


def can_follow(scene: mujoco.MjvScene) -> bool:
    """Whether the sky may be drawn last: nothing is to be seen through."""
    return not any(geom.transparent for geom in scene.geoms[: scene.ngeom])


def bare_bands(rgba: Image) -> list[tuple[int, int]]:
    """Bands of rows, (first, behind the last), of (H, W, 4) with samples that show nothing."""
    rows = np.flatnonzero(rgba.view(np.uint32).min(axis=(1, 2)) < OPAQUE)
    if not len(rows):
        return []
    bands = np.split(rows, np.flatnonzero(np.diff(rows) > GAP_PX) + 1)
    return [(int(band[0]), int(band[-1]) + 1) for band in bands]
