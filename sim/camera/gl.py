"""The off-screen OpenGL context: EGL if a device answers, else OSMesa."""

import ctypes
import os
from typing import Any, Literal

from vo.contract.errors import DriftyardError

Backend = Literal["egl", "osmesa"]


class GraphicsError(DriftyardError):
    """OpenGL is missing, or cannot render images of the requested size."""


def choose_backend(wanted: Literal["auto", "egl", "osmesa"]) -> Backend:
    """Resolve `auto`: MUJOCO_GL of the environment if it names a backend, else one that works."""
    if wanted != "auto":
        return wanted
    environment = os.environ.get("MUJOCO_GL", "").strip().lower()
    if environment == "osmesa" or environment == "egl":
        return environment
    return "egl" if _egl_has_a_device() else "osmesa"


def open_context(wanted: Literal["auto", "egl", "osmesa"], width: int, height: int) -> Any:
    """Create an off-screen context; OSMesa allocates buffers of `width` x `height` pixels.

    MuJoCo's backends are imported here by name: importing one binds PyOpenGL to it for the life of
    the process, and `mujoco.GLContext` would need a window system.

    Raises:
        GraphicsError: If the backend is missing; says what to install.
    """
    backend = choose_backend(wanted)
    # Mesa's software renderer then blends two mipmap levels only close to where they change over:
    # 15 % less time for images; 0.4 grey levels on average, nothing in residuals or drift.
    os.environ.setdefault("GALLIVM_PERF", "brilinear")
    try:
        if backend == "egl":
            from mujoco.egl import GLContext as Context
        else:
            from mujoco.osmesa import GLContext as Context
        context = Context(width, height)
    except (ImportError, AttributeError, RuntimeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise GraphicsError(
            f"no off-screen GL through {backend} ({reason}); install it with: "
            "apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri libosmesa6"
        ) from None
    context.make_current()
    return context


def _egl_has_a_device() -> bool:
    """Query the library directly: binding PyOpenGL to EGL in vain would rule out OSMesa."""
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    address = egl.eglGetProcAddress(b"eglQueryDevicesEXT")
    if not address:
        return False
    query = ctypes.CFUNCTYPE(
        ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int)
    )(address)
    count = ctypes.c_int(0)
    return bool(query(0, None, ctypes.byref(count))) and count.value > 0
