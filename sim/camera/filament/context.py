"""Filament's context: what it needs, and why it cannot be had."""

import ctypes
import os
import re
from collections.abc import Generator
from contextlib import contextmanager
from tempfile import TemporaryFile
from typing import IO, Any

from sim.graphics import GraphicsError

VULKAN = "libvulkan.so.1"
WHEEL = 'pip install "driftyard[filament]"'
DRIVER = "apt-get install libvulkan1 mesa-vulkan-drivers"
VERSION = 1 << 22 | 1 << 12
"""Vulkan 1.1, which Filament asks for: selection by the address of a GPU needs it."""
SELECTED = re.compile(r"^Selected physical device '(.+)' from", re.MULTILINE)
"""What Filament says when it has chosen a device: the last of those of the best type."""
NAME_BYTES = 20, 256
"""Place and length of a device's name in VkPhysicalDeviceProperties."""


def open_filament() -> tuple[str, Any, Any]:
    """Import MuJoCo's module and create a context, on a GPU if Vulkan has one, else in software.

    Returns:
        The name of the device of Vulkan that Filament takes, the module `mujoco.mjrf` and its
        context.

    Raises:
        GraphicsError: If the wheel, Vulkan or a device is missing; names the package that helps.
    """
    device, *others = vulkan_devices()
    try:
        import mujoco.studio  # noqa: F401  # tells Filament where its materials are
        from mujoco import mjrf
    except ImportError as error:
        reason = " ".join(str(error).split())
        raise GraphicsError(f"no Filament: {reason}; {WHEEL}") from None
    api = mjrf.GraphicsApi.GRAPHICS_API_VULKAN
    with _captured() as said:
        context = mjrf.Context(mjrf.ContextConfig(graphics_api=api))
        said.seek(0)
        chosen = SELECTED.search(said.read()) if others else None
        return chosen[1] if chosen else device, mjrf, context


def vulkan_devices() -> list[str]:
    """Return the names of Vulkan's devices; Filament ends the process if there is none.

    Raises:
        GraphicsError: If there is none; names the package that helps.
    """
    try:
        vulkan = ctypes.CDLL(VULKAN)
    except OSError:
        raise GraphicsError(f"no Filament: {VULKAN} is missing; {DRIVER}") from None
    instance, count = ctypes.c_void_p(), ctypes.c_uint32()
    about = (ctypes.c_uint64 * 6)(0, 0, 0, 0, 0, VERSION << 32)  # VkApplicationInfo
    # VkInstanceCreateInfo without layers and extensions
    info = (ctypes.c_uint64 * 8)(1, 0, 0, ctypes.addressof(about))
    names: list[str] = []
    if not vulkan.vkCreateInstance(info, None, ctypes.byref(instance)):
        vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
        devices = (ctypes.c_void_p * count.value)()
        vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), devices)
        for device in devices:
            properties = ctypes.create_string_buffer(4096)
            vulkan.vkGetPhysicalDeviceProperties(ctypes.c_void_p(device), properties)
            first, length = NAME_BYTES
            names.append(properties.raw[first : first + length].split(b"\0")[0].decode())
        vulkan.vkDestroyInstance(instance, None)
    if not names:
        raise GraphicsError(f"no Filament: Vulkan has no device; {DRIVER}")
    return names


@contextmanager
def _captured() -> Generator[IO[str]]:
    """Keep what Filament writes from the standard output, where a command's result belongs."""
    kept = os.dup(1)
    with TemporaryFile("w+", errors="replace") as said:
        os.dup2(said.fileno(), 1)
        try:
            yield said
        finally:
            os.dup2(kept, 1)
            os.close(kept)
