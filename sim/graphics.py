"""The environment variables that choose an OpenGL driver, and the reason why OpenGL fails.

Nothing here imports MuJoCo or PyOpenGL: importing either reads these variables, and may fail.
"""

import ctypes
import glob
import os
import traceback
from typing import Literal

from vo.contract.errors import DriftyardError

Backend = Literal["egl", "osmesa"]
LIBRARIES: dict[Backend, tuple[str, ...]] = {
    "egl": ("libEGL.so.1", "libEGL.so"),
    "osmesa": ("libOSMesa.so.8", "libOSMesa.so"),
}
INSTALL = "apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri libosmesa6"
MUJOCO_VALUES = (
    *("", "egl", "osmesa", "glfw", "glx", "enable", "enabled", "on", "true", "1"),
    *("disable", "disabled", "off", "false", "0"),
)
"""Values of MUJOCO_GL that MuJoCo accepts on Linux; it refuses others when it is imported."""
VARIABLES = ("MUJOCO_GL", "PYOPENGL_PLATFORM", "MUJOCO_EGL_DEVICE_ID")
PREFIXES = ("MUJOCO_", "EGL_", "__EGL_", "LIBGL_", "MESA_", "GALLIUM_", "NVIDIA_")
"""Beginnings of the names of variables that change which driver is loaded."""
DEVICES = ("/dev/dri/render*", "/dev/nvidia[0-9]*", "/dev/nvidiactl")
SOURCES = ("/mujoco/egl/", "/mujoco/osmesa/", "/mujoco/rendering/", "/OpenGL/")
"""Parts of the paths of the modules in which OpenGL's errors arise."""


class GraphicsError(DriftyardError):
    """OpenGL is missing, or cannot render images of the requested size."""


def check_variables(wanted: Literal["auto", "egl", "osmesa"] = "auto") -> None:
    """Check MUJOCO_GL, PYOPENGL_PLATFORM and MUJOCO_EGL_DEVICE_ID for a backend.

    Raises:
        GraphicsError: If one of them cannot be used; names it and the valid values.
    """
    chosen, platform, device = (os.environ.get(name, "").strip() for name in VARIABLES)
    named = chosen.lower()
    if named not in MUJOCO_VALUES:
        raise GraphicsError(f"MUJOCO_GL={chosen}: no such backend; unset it, or set egl or osmesa")
    if named in LIBRARIES:
        if wanted not in ("auto", named):
            raise GraphicsError(
                f"MUJOCO_GL={chosen}: rules out the backend {wanted} of render.backend; unset it"
            )
        if not has_library(named):
            library = LIBRARIES[named][0]
            raise GraphicsError(f"MUJOCO_GL={chosen}: {library} is missing; unset it, or {INSTALL}")
    backends = list(LIBRARIES) if wanted == "auto" and named not in LIBRARIES else [named or wanted]
    if platform and platform not in backends:
        valid = " or ".join(backends)
        raise GraphicsError(f"PYOPENGL_PLATFORM={platform}: unset it, or set {valid}")
    if "MUJOCO_EGL_DEVICE_ID" in os.environ and not device.isdecimal():
        raise GraphicsError(
            f"MUJOCO_EGL_DEVICE_ID={device}: expected the number of a device, 0 or more; unset it"
        )


def has_library(backend: Backend) -> bool:
    """Whether the library of a backend can be loaded."""
    for name in LIBRARIES[backend]:
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False


def is_graphics_fault(error: BaseException) -> bool:
    """Whether an error arose in PyOpenGL or in MuJoCo's backends, which raise many types."""
    frames = traceback.extract_tb(error.__traceback__)
    return any(part in frame.filename for frame in frames for part in SOURCES)


def explain_fault(error: BaseException) -> str:
    """Name in one line what OpenGL's error may come from: a variable, a permission, a library."""
    try:
        check_variables()
    except GraphicsError as cause:
        return str(cause)
    reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
    if any(name in reason for name in VARIABLES):
        return reason
    given = [
        f"{name}={value}" for name, value in sorted(os.environ.items()) if name.startswith(PREFIXES)
    ]
    closed = [
        x for pattern in DEVICES for x in glob.glob(pattern) if not os.access(x, os.R_OK | os.W_OK)
    ]
    advice = [f"change or unset {', '.join(given)}"] if given else []
    advice += [f"ask for permission to read and write {', '.join(closed)}"] if closed else []
    return f"{reason}; {', or '.join([*advice, f'install it with: {INSTALL}'])}"
