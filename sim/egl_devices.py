"""Devices that EGL can render with, and what chooses them for MuJoCo and for Vulkan.

The library is asked directly: binding PyOpenGL to EGL in vain would rule out OSMesa.
"""

import ctypes
import os
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from sim.graphics import LIBRARIES

EXTENSIONS, DRM_FILE, RENDER_NODE, CUDA = 0x3055, 0x3233, 0x3377, 0x323A
"""Numbers of EGL: EGL_EXTENSIONS, EGL_DRM_DEVICE_FILE_EXT, EGL_DRM_RENDER_NODE_FILE_EXT and
EGL_CUDA_DEVICE_NV."""
MAX_DEVICES = 64


@dataclass(frozen=True)
class EglDevice:
    """A device of EGL.

    Attributes:
        number: Its place in the list of EGL.
        file: Its device file; empty for none, as of software.
        cuda: Its number for CUDA; None for none.
        is_software: Whether the processor renders.
    """

    number: int
    file: str
    cuda: int | None
    is_software: bool

    @property
    def is_accessible(self) -> bool:
        """Whether this process may open its device file."""
        return not self.file or os.access(self.file, os.R_OK | os.W_OK)


def list_devices() -> list[EglDevice]:
    """List the devices of EGL; none if the library is missing or cannot list them."""
    query = _function("eglQueryDevicesEXT", ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    found, count = (ctypes.c_void_p * MAX_DEVICES)(), ctypes.c_int(0)
    if query is None or not query(MAX_DEVICES, found, ctypes.byref(count)):
        return []
    return [_describe(number, found[number]) for number in range(count.value)]


def _describe(number: int, device: int | None) -> EglDevice:
    text = _function(
        "eglQueryDeviceStringEXT", ctypes.c_void_p, ctypes.c_int, gives=ctypes.c_char_p
    )
    words = ((text(device, EXTENSIONS) if text else b"") or b"").decode().split()

    def file(extension: str, name: int) -> str:
        return ((text(device, name) or b"").decode()) if text and extension in words else ""

    cuda, ask = ctypes.c_ssize_t(), None
    if "EGL_NV_device_cuda" in words:
        ask = _function("eglQueryDeviceAttribEXT", ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p)
    return EglDevice(
        number,
        file("EGL_EXT_device_drm_render_node", RENDER_NODE) or file("EGL_EXT_device_drm", DRM_FILE),
        cuda.value if ask and ask(device, CUDA, ctypes.byref(cuda)) else None,
        "EGL_MESA_device_software" in words,
    )


def _function(name: str, *takes: type, gives: type = ctypes.c_uint) -> "ctypes._FuncPointer | None":
    """Return a function of EGL's extensions; None if it is missing."""
    for library in LIBRARIES["egl"]:
        with suppress(OSError, AttributeError):
            find = ctypes.CDLL(library).eglGetProcAddress
            find.restype, find.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
            address = find(name.encode())
            return ctypes.CFUNCTYPE(gives, *takes)(address) if address else None
    return None


def mujoco_numbers(devices: Sequence[EglDevice], visible: str) -> list[int | None]:
    """Return what MUJOCO_EGL_DEVICE_ID takes for each device; None if it cannot be chosen.

    It is the number for CUDA, or the place in CUDA_VISIBLE_DEVICES, given as `visible`, if drivers
    state the former; else the place in the list of EGL, as MuJoCo reads it.
    """
    words = [x.strip() for x in visible.split(",") if x.strip()]
    order = [int(x) for x in words] if all(x.isdecimal() for x in words) else []
    if not set(order) <= {x.cuda for x in devices}:
        order = [*range(len(order))]  # in a container, which numbers its own anew
    return [
        x.number
        if x.cuda is None
        else (order.index(x.cuda) if x.cuda in order else None)
        if order
        else x.cuda
        for x in devices
    ]


def gpu_files() -> dict[int, str]:
    """Return the device files of GPUs that are accessible, by what MUJOCO_EGL_DEVICE_ID takes."""
    devices = list_devices()
    numbers = mujoco_numbers(devices, os.environ.get("CUDA_VISIBLE_DEVICES", ""))
    pairs = zip(devices, numbers, strict=True)
    return {n: x.file for x, n in pairs if n is not None and not x.is_software and x.is_accessible}


def vulkan_variables(file: str, system: Path = Path("/sys")) -> dict[str, str]:
    """Return the environment in which Vulkan lists the GPU of a device file alone.

    Mesa's layer of selection, of Debian's mesa-vulkan-drivers, hides all other devices, of any
    driver. An order of the devices, as by VK_LOADER_DEVICE_SELECT, would not choose: of equal ones,
    Filament takes the last. It is empty if the GPU has no address on the PCI bus.
    """
    device = (system / "class/drm" / Path(file).name / "device").resolve()
    if not re.fullmatch(r"[0-9a-f]{4}:[0-9a-f]{2}:[0-9a-f]{2}\.[0-7]", device.name):
        return {}
    address = device.name.replace(":", "_").replace(".", "_")
    return {"DRI_PRIME": f"pci-{address}", "MESA_VK_DEVICE_SELECT_FORCE_DEFAULT_DEVICE": "1"}
