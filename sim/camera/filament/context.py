"""Filament's context: what it needs, and why it cannot be had."""

import ctypes
import os
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any

from sim.graphics import GraphicsError

VULKAN = "libvulkan.so.1"
WHEEL = 'pip install "driftyard[filament]"'
DRIVER = "apt-get install libvulkan1 mesa-vulkan-drivers"
NAME_BYTES = 20, 256
"""Place and length of a device's name in VkPhysicalDeviceProperties."""


def open_filament() -> tuple[str, Any, Any]:
    """Import MuJoCo's module and create a context, on a GPU if Vulkan has one, else in software.

    Returns:
        The name of Vulkan's first device, the module `mujoco.mjrf` and its context.

    Raises:
        GraphicsError: If the wheel, Vulkan or a device is missing; names the package that helps.
    """
    device = vulkan_devices()[0]
    try:
        import mujoco.studio  # noqa: F401  # tells Filament where its materials are
        from mujoco import mjrf
    except ImportError as error:
        reason = " ".join(str(error).split())
        raise GraphicsError(f"no Filament: {reason}; {WHEEL}") from None
    api = mjrf.GraphicsApi.GRAPHICS_API_VULKAN
    with _quiet():
        return device, mjrf, mjrf.Context(mjrf.ContextConfig(graphics_api=api))


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
    info = (ctypes.c_uint64 * 8)(1)  # VkInstanceCreateInfo without layers and extensions
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
def _quiet() -> Generator[None]:
    """Drop what Filament writes to the standard output, where a command's result belongs."""
    kept, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nothing)
