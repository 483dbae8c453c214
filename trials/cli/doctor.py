"""`driftyard doctor`: what works on this machine, and what to install."""

import importlib.metadata
import multiprocessing
import os
import platform
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Literal

import typer
from rich.markup import escape
from rich.table import Table

from sim.graphics import VARIABLES, GraphicsError, explain_fault
from trials.cli import console
from trials.execution.cluster import usable_cores

Wanted = Literal["auto", "egl", "osmesa"]
BACKENDS: tuple[Wanted, ...] = ("egl", "osmesa")
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


def doctor() -> None:
    """Check which OpenGL drivers render and which packages are installed.

    Each driver is tried without the environment's variables, then the one that they choose. The
    exit status is 1 if that does not render.
    """
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
    for label, (renders, words) in working.items():
        table.add_row(label, f"[green]renders[/]: {words}" if renders else f"[red]no[/]: {words}")
    console.out.print(table)
    used = list(working.values())[-1:] if given else working.values()
    if not any(renders for renders, _ in used):
        console.out.print("OpenGL does not render: generate and preview will not work.")
        raise typer.Exit(1)


def _version(package: str, install: str = "") -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return f"[red]missing[/]; {install or f'pip install {package}'}"


def _render_in_process(backend: Wanted, without: Sequence[str]) -> tuple[bool, str]:
    """Render in a process of its own: OpenGL binds to a process, and a bad driver may crash it."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, spawn, _drop_variables, (without,)) as pool:
        try:
            renders, words = pool.submit(render_test_scene, backend).result()
        except BrokenProcessPool:
            return False, "the driver crashed"
    return renders, escape(words)


def _drop_variables(names: Sequence[str]) -> None:
    for name in names:
        os.environ.pop(name, None)


def render_test_scene(backend: Wanted) -> tuple[bool, str]:
    """Render a lit orange box; return whether its pixels show it, and the driver or the error."""
    try:
        return _render_box(backend)
    except GraphicsError as error:
        return False, str(error)
    except Exception as error:  # each import, and each call of the driver, may fail
        return False, explain_fault(error)


def _render_box(backend: Wanted) -> tuple[bool, str]:
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
    # The box is orange: red is well above blue in some pixels, and not in all.
    orange = rgb[..., 0].astype(int) - rgb[..., 2] > 40
    return bool(orange.any() and not orange.all()), name
