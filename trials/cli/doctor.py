"""`driftyard doctor`: what works on this machine, and what to install."""

import importlib.metadata
import multiprocessing
import platform
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Literal

import typer
from rich.table import Table

from trials.cli import console
from trials.execution.parallel import usable_cores

BACKENDS: tuple[Literal["egl", "osmesa"], ...] = ("egl", "osmesa")
PACKAGES = ("mujoco", "gtsam", "numpy", "opencv-python-headless", "numba", "scipy")
INSTALL_GL = "apt-get install libegl1 libegl-mesa0 libgl1-mesa-dri libosmesa6"
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

    The exit status is 1 if no driver renders.
    """
    table = Table(box=None, show_header=False)
    table.add_row("machine", f"{platform.platform()}, {usable_cores()} usable cores")
    table.add_row("python", platform.python_version())
    table.add_row("driftyard", _version("driftyard", install="pip install -e ."))
    for package in PACKAGES:
        table.add_row(package, _version(package))
    working = {backend: _render_in_process(backend) for backend in BACKENDS}
    for backend, (renders, words) in working.items():
        table.add_row(backend, f"[green]renders[/]: {words}" if renders else f"[red]no[/]: {words}")
    console.out.print(table)
    if not any(renders for renders, _ in working.values()):
        console.out.print(
            f"No OpenGL driver renders: generate and preview will not work.\n{INSTALL_GL}"
        )
        raise typer.Exit(1)


def _version(package: str, install: str = "") -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return f"[red]missing[/]; {install or f'pip install {package}'}"


def _render_in_process(backend: Literal["egl", "osmesa"]) -> tuple[bool, str]:
    """Render in a process of its own: OpenGL binds to a process, and a bad driver may crash it."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        try:
            return pool.submit(render_test_scene, backend).result()
        except BrokenProcessPool:
            return False, "the driver crashed"


def render_test_scene(backend: Literal["egl", "osmesa"]) -> tuple[bool, str]:
    """Render a lit orange box; return whether its pixels show it, and the driver or the error."""
    import mujoco  # each import may fail on the machine that is checked
    import numpy as np

    from sim.camera.gl import GraphicsError, open_context

    try:
        context = open_context(backend, SIDE_PX, SIDE_PX)
    except GraphicsError as error:
        return False, str(error)
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
    except mujoco.FatalError as error:
        return False, str(error)
    finally:
        context.free()
    # The box is orange: red is well above blue in some pixels, and not in all.
    orange = rgb[..., 0].astype(int) - rgb[..., 2] > 40
    return bool(orange.any() and not orange.all()), name
