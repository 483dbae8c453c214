"""`driftyard doctor`: what works on this machine, and what to install."""

import importlib.metadata
import multiprocessing
import os
import platform
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from types import MappingProxyType
from typing import Literal

import typer
from rich.markup import escape
from rich.table import Table

from sim.egl_devices import list_devices, mujoco_numbers, vulkan_variables
from sim.graphics import VARIABLES, GraphicsError, explain_fault
from trials.cli import console
from trials.cli.options import option
from trials.execution.cluster import usable_cores
from vo.contract.arrays import Image

Wanted = Literal["auto", "egl", "osmesa", "filament"]
BACKENDS: tuple[Wanted, ...] = ("egl", "osmesa")
FILAMENT: Wanted = "filament"
PACKAGES = ("mujoco", "gtsam", "numpy", "opencv-python-headless", "numba", "scipy")
TEST_SCENE = """
<mujoco>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="box" size=".3 .3 .3" rgba="1 .5 .1 1"/>
    <camera name="left" pos="0 -2 1" xyaxes="1 0 0 0 .4 .9"/>
  </worldbody>
</mujoco>
"""
SIDE_PX = 64


def doctor(
    devices: bool = option(
        False, "List only the devices, and which of them EGL and Filament render with.", "--devices"
    ),
) -> None:
    """Check which OpenGL drivers and engines render and which packages are installed.

    Each driver is tried without the environment's variables, then the one that they choose. The
    exit status is 1 if that does not render, or with --devices if no device does. Filament, over
    Vulkan, is only needed where render.engine chooses it.
    """
    if devices:
        _doctor_devices()
        return
    table = Table(box=None, show_header=False)
    table.add_row("machine", f"{platform.platform()}, {usable_cores()} usable cores")
    table.add_row("python", platform.python_version())
    table.add_row("driftyard", _version("driftyard", install="pip install -e ."))
    for package in PACKAGES:
        table.add_row(package, _version(package))
    working: dict[str, tuple[bool, str]] = {
        backend: _render_in_process(backend, VARIABLES) for backend in BACKENDS
    }
    given = [f"{name}={os.environ[name]}" for name in VARIABLES if name in os.environ]
    if given:
        working[escape(" ".join(given))] = _render_in_process("auto", ())
    filament = _render_in_process(FILAMENT, ())
    for label, (renders, words) in {**working, FILAMENT: filament}.items():
        table.add_row(label, f"[green]renders[/]: {words}" if renders else f"[red]no[/]: {words}")
    console.out.print(table)
    used = list(working.values())[-1:] if given else working.values()
    if not any(renders for renders, _ in used):
        console.out.print("OpenGL does not render: generate and preview will not work.")
        raise typer.Exit(1)


def _doctor_devices() -> None:
    """Render with each device in turn: by its number in MUJOCO_EGL_DEVICE_ID, and over Vulkan.

    Filament renders with a GPU that is chosen by its address, and without GPUs with what it takes.
    """
    found = list_devices()
    if not found:
        console.out.print("EGL lists no device: its library is missing, or it has no driver.")
        raise typer.Exit(1)
    rows: list[tuple[str, ...]] = []
    rendering: list[bool] = []
    numbers = mujoco_numbers(found, os.environ.get("CUDA_VISIBLE_DEVICES", ""))
    for number, device in zip(numbers, found, strict=True):
        renders, words = False, "CUDA_VISIBLE_DEVICES leaves it out"
        if number is not None:
            variables = {"MUJOCO_EGL_DEVICE_ID": str(number)}
            renders, words = _render_in_process("egl", VARIABLES, variables)
        rendering.append(renders)
        kind = "processor" if device.is_software else device.file or "GPU"
        chosen, vulkan = vulkan_variables(device.file), "not chosen"
        if chosen or all(x.is_software for x in found):
            drawn, vulkan = _render_in_process(FILAMENT, (), chosen)
            vulkan = vulkan if drawn else f"no: {vulkan}"
        cuda = "–" if device.cuda is None else str(device.cuda)
        rows.append(
            (
                "–" if number is None else str(number),
                kind,
                cuda,
                "renders" if renders else "no",
                words,
                vulkan,
            )
        )
    console.print_table(("number", "device", "CUDA", "", "driver", "Filament, over Vulkan"), rows)
    if not any(rendering):
        console.out.print("No device renders: generate and preview need OSMesa.")
        raise typer.Exit(1)


def _version(package: str, install: str = "") -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return f"[red]missing[/]; {install or f'pip install {package}'}"


def _render_in_process(
    backend: Wanted, without: Sequence[str], variables: Mapping[str, str] = MappingProxyType({})
) -> tuple[bool, str]:
    """Render in a process of its own, as OpenGL binds to a process and a bad driver may crash it.

    It is without some variables of the environment, and has others.
    """
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, spawn, _change_variables, (without, dict(variables))) as pool:
        try:
            renders, words = pool.submit(render_test_scene, backend).result()
        except BrokenProcessPool:
            return False, "the driver crashed"
    return renders, escape(words)


def _change_variables(without: Sequence[str], variables: Mapping[str, str]) -> None:
    for name in without:
        os.environ.pop(name, None)
    os.environ.update(variables)


def render_test_scene(backend: Wanted) -> tuple[bool, str]:
    """Render a lit orange box; return whether its pixels show it, and the driver or the error."""
    try:
        return _render_filament() if backend == "filament" else _render_box(backend)
    except GraphicsError as error:
        return False, str(error)
    except Exception as error:  # each import, and each call of the driver, may fail
        return False, explain_fault(error)


def _render_filament() -> tuple[bool, str]:
    import mujoco
    import numpy as np

    from sim.camera.filament.context import open_filament

    device, mjrf, context = open_filament()
    model = mujoco.MjModel.from_xml_string(TEST_SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene, resources = context.create_scene(mjrf.SceneParams()), mjrf.ModelResources(context, model)
    parts = mjrf.ModelLights(scene, resources), mjrf.ModelRenderables(scene, resources)
    for part in parts:
        part.update(data)
    colour = mjrf.PixelFormat.PIXEL_FORMAT_RGB8
    size = {"width": SIDE_PX, "height": SIDE_PX}
    target = context.create_render_target(mjrf.RenderTargetConfig(**size, color_format=colour))
    read = mjrf.ReadRequest(target=target)
    rgb = np.zeros((SIDE_PX, SIDE_PX, 3), np.uint8)
    read.set_buffer(rgb)
    towards = {"pos": [0, -2, 1], "forward": [0, 0.9, -0.4], "up": [0, 0.4, 0.9]}
    frustum = {"frustum_width": 0.05, "frustum_bottom": -0.05, "frustum_top": 0.05}
    camera = mjrf.Camera(**towards, **frustum, frustum_near=0.1, frustum_far=10)
    viewport = mjrf.Rect(0, 0, SIDE_PX, SIDE_PX)
    view = mjrf.RenderRequest(scene=scene, camera=camera, viewport=viewport, target=target)
    context.wait_for_frame(context.render([view], [read]))
    return _shows_box(rgb), device


def _render_box(backend: Literal["auto", "egl", "osmesa"]) -> tuple[bool, str]:
    import mujoco
    import numpy as np

    from sim.camera.gl import open_context

    context = open_context(backend, SIDE_PX, SIDE_PX)
    try:
        model = mujoco.MjModel.from_xml_string(TEST_SCENE)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        scene, camera = mujoco.MjvScene(model, 10), mujoco.MjvCamera()
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
        mujoco.mjv_updateScene(
            model, data, mujoco.MjvOption(), None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene
        )
        painter = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, painter)
        rectangle = mujoco.MjrRect(0, 0, SIDE_PX, SIDE_PX)
        rgb = np.zeros((SIDE_PX, SIDE_PX, 3), np.uint8)
        mujoco.mjr_render(rectangle, scene, painter)
        mujoco.mjr_readPixels(rgb, None, rectangle, painter)
        from OpenGL import GL  # binds to the backend of the context

        name = GL.glGetString(GL.GL_RENDERER).decode()
    finally:
        context.free()
    return _shows_box(rgb), name


def _shows_box(rgb: Image) -> bool:
    """The box is orange: red is well above blue in some pixels, and not in all."""
    orange = rgb[..., 0].astype(int) - rgb[..., 2] > 40
    return bool(orange.any() and not orange.all())
