"""Off-screen OpenGL: a context, by EGL if a device answers, else OSMesa, and its framebuffers."""

import ctypes
import os
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, Self

import mujoco
import numpy as np

from sim.egl_devices import list_devices
from sim.graphics import (
    LIBRARIES,
    Backend,
    GraphicsError,
    check_variables,
    explain_fault,
    has_library,
)
from vo.contract.arrays import Array, Image, Indices
from vo.contract.compilation import compiled

_users: set[int] = set()
"""Processes that have opened a context: this one, and one that it was forked from."""


def choose_backend(wanted: Literal["auto", "egl", "osmesa"]) -> Backend:
    """Resolve `auto`: MUJOCO_GL of the environment if it names a backend, else one that works."""
    if wanted != "auto":
        return wanted
    environment = os.environ.get("MUJOCO_GL", "").strip().lower()
    if environment == "osmesa" or environment == "egl":
        return environment
    return "egl" if list_devices() else "osmesa"


def open_context(wanted: Literal["auto", "egl", "osmesa"], width: int, height: int) -> Any:
    """Create an off-screen context; OSMesa allocates buffers of `width` x `height` pixels.

    MuJoCo's backends are imported here by name: importing one binds PyOpenGL to it for the life of
    the process, and `mujoco.GLContext` would need a window system.

    Raises:
        GraphicsError: If the backend is missing or a variable of the environment cannot be used;
            says which, or what to install. Also in a process that was forked after OpenGL was used,
            where drivers wait for threads that are gone.
    """
    if _users - {os.getpid()}:
        raise GraphicsError(
            "no OpenGL in a process that was forked after it was used; start workers by spawn: "
            'make_vec(..., vector_kwargs={"context": "spawn"}), SubprocVecEnv(..., '
            'start_method="spawn"), DataLoader(..., multiprocessing_context="spawn")'
        )
    check_variables(wanted)
    backend = choose_backend(wanted)
    check_variables(backend)
    if not _users:
        _load_triton()
    # Mesa's software renderer then blends two mipmap levels only close to where they change over:
    # 15 % less time for images; 0.4 grey levels on average, nothing in residuals or drift.
    os.environ.setdefault("GALLIVM_PERF", "brilinear")
    try:
        if not has_library(backend):
            raise ImportError(f"{LIBRARIES[backend][0]} is missing")
        if backend == "egl":
            from mujoco.egl import GLContext as Context
        else:
            from mujoco.osmesa import GLContext as Context
        context = Context(width, height)
        context.make_current()
    except Exception as error:  # ImportError, AttributeError, OSError, GLError, RuntimeError ...
        raise GraphicsError(
            f"no off-screen OpenGL through {backend}: {explain_fault(error)}"
        ) from None
    _users.add(os.getpid())
    return context


def _load_triton() -> None:
    """Load the library of Triton, if it is installed, before Mesa loads the LLVM compiler.

    Triton holds an LLVM of its own, and PyTorch loads it with the first optimizer. Where Mesa's is
    in the process already, calls end up there, and the process crashes.
    """
    found = find_spec("triton")
    if found is not None and found.origin is not None:
        with suppress(OSError):  # a build without the library, or for another system
            ctypes.CDLL(str(Path(found.origin).parent / "_C/libtriton.so"))


class Framebuffer:
    """A framebuffer; inside its `with` block MuJoCo draws there instead of into its own.

    MuJoCo's buffer has a stencil, for mirrors, which no scene has; without it, a software renderer
    draws a multisampled frame in 14 % less time, bit for bit the same. One context with two
    framebuffers holds textures and meshes once.
    """

    def __init__(self, context: mujoco.MjrContext, samples: int) -> None:
        """Allocate colour and depth of the current context's size; `samples` 0, or as the context.

        Raises:
            GraphicsError: If the driver cannot.
        """
        from OpenGL import GL  # binds to the backend that is open

        self._gl = GL
        self._context = context
        self._samples = samples
        size = context.offWidth, context.offHeight
        self._buffers = GL.glGenRenderbuffers(2)
        self._frame = int(GL.glGenFramebuffers(1))
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._frame)
        for buffer, storage, attachment in zip(
            self._buffers,
            (GL.GL_RGBA8, GL.GL_DEPTH_COMPONENT32F),
            (GL.GL_COLOR_ATTACHMENT0, GL.GL_DEPTH_ATTACHMENT),
            strict=True,
        ):
            GL.glBindRenderbuffer(GL.GL_RENDERBUFFER, buffer)
            GL.glRenderbufferStorageMultisample(GL.GL_RENDERBUFFER, samples, storage, *size)
            GL.glFramebufferRenderbuffer(GL.GL_FRAMEBUFFER, attachment, GL.GL_RENDERBUFFER, buffer)
        if GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER) != GL.GL_FRAMEBUFFER_COMPLETE:
            raise GraphicsError(f"OpenGL has no frame buffer of {size[0]}x{size[1]} px")

    def __enter__(self) -> Self:
        self._own = self._context.offFBO, self._context.offSamples
        self._context.offFBO, self._context.offSamples = self._frame, self._samples
        return self

    def __exit__(self, *error: object) -> None:
        self._context.offFBO, self._context.offSamples = self._own

    def read_colour(self, rgba: Image, low: int = 0, high: int | None = None) -> None:
        """Copy rows `low` to `high - 1` of the image, the mean of the samples, to (H, W, 4) uint8.

        The bottom row is first. The driver stores RGBA, so that no conversion is needed.
        """
        gl = self._gl
        rows = rgba[low:high]
        height, width = rows.shape[:2]
        gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, self._frame)
        if self._samples:
            gl.glBindFramebuffer(gl.GL_DRAW_FRAMEBUFFER, self._context.offFBO_r)
            top, mask = low + height, gl.GL_COLOR_BUFFER_BIT
            gl.glBlitFramebuffer(0, low, width, top, 0, low, width, top, mask, gl.GL_NEAREST)
            gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, self._context.offFBO_r)
        gl.glReadPixels(0, low, width, height, gl.GL_RGBA, gl.GL_UNSIGNED_BYTE, rows)

    def read_depth(self, zbuffer: Array) -> None:
        """Copy the depth buffer, which must have no samples, into (H, W) float32."""
        gl = self._gl
        height, width = zbuffer.shape
        gl.glBindFramebuffer(gl.GL_READ_FRAMEBUFFER, self._frame)
        gl.glReadPixels(0, 0, width, height, gl.GL_DEPTH_COMPONENT, gl.GL_FLOAT, zbuffer)

    def free(self) -> None:
        """Release the memory; the context must be current."""
        self._gl.glDeleteFramebuffers(1, [self._frame])
        self._gl.glDeleteRenderbuffers(2, self._buffers)


@compiled(distinct=True, nogil=True)
def decode_buffers(
    zbuffer: Array, codes: Array, ids: Array, near_m: np.float32, far_m: np.float32
) -> tuple[Array, Indices]:
    """Split the buffers of both cameras and convert them to metres and ids, in one pass.

    The projection maps depth Z to s = a / Z - c with c = n / (f - n) and a = f n / (f - n), in
    OpenGL's single precision; cleared pixels (s = 0) have no depth. Depths (float32) and ids
    (int32) of left and right are (2, H, W), top row first.

    Args:
        zbuffer: (H, 2W) float32 s, 1 near, 0 far, bottom row first.
        codes: (H, 2W) uint32 number of the geom; the highest byte is ignored.
        ids: (N,) int32 id of each number.
        near_m: Near plane n.
        far_m: Far plane f.
    """
    height, width = zbuffer.shape[0], zbuffer.shape[1] // 2
    depth = np.empty((2, height, width), np.float32)
    geoms = np.empty((2, height, width), np.int32)
    c, a = near_m / (far_m - near_m), far_m * near_m / (far_m - near_m)
    for camera in range(2):
        first = np.uint64(camera * width)
        for v in range(height):
            y = height - 1 - v
            for u in range(np.uint64(width)):
                s = zbuffer[y, first + u]
                depth[camera, v, u] = a / (s + c) if s > 0 else np.float32(np.nan)
            for u in range(np.uint64(width)):
                geoms[camera, v, u] = ids[np.uint64(codes[y, first + u] & np.uint32(0xFFFFFF))]
    return depth, geoms
