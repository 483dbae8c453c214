"""The two ways to an off-screen GL, each in a process of its own, draw the same world alike.

Measured with Mesa 22.3: every picture and label is the same to the bit.
"""

import ctypes
import multiprocessing
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.gl

YARD = """<mujoco><asset>
<texture name="t" type="2d" builtin="checker" rgb1=".2 .3 .4" rgb2=".6 .6 .5"
 width="64" height="64" mark="random" random="0.3"/>
<material name="t" texture="t" texrepeat="4 4" texuniform="true"/></asset><worldbody>
<light pos="1 -1 4" dir="0 0.3 -1" castshadow="true"/>
<geom type="plane" size="5 5 1" material="t"/>
<geom name="post" type="cylinder" pos="1.5 0.2 0.3" size="0.1 0.3" material="t"/>
<geom name="ball" type="sphere" pos="1.2 -0.3 0.2" size="0.2" rgba="0.8 0.3 0.2 1"/>
</worldbody></mujoco>"""
SETTINGS = {"rig": {"width_px": 160, "height_px": 120, "tilt_deg": 15}}
MEAN_GREY, PIXEL_GREY = 0.1, 12.0
"""Drivers may place a sample at an outline or blend two mipmaps a little differently."""
OUTLINE_SHARE = 2e-3
"""Of pixels that may show the other side of an outline."""


def drawn(path: Path, backend: str) -> dict[str, np.ndarray] | None:
    """Both pictures and all labels, drawn again after a picture too large for the buffer."""
    if backend == "osmesa" and not any(map(loads, ("libOSMesa.so.8", "libOSMesa.so"))):
        return None
    import mujoco

    from sim.batch import build
    from sim.camera.render import StereoRenderer
    from sim.preview.cameras import render_world_map
    from sim.settings import RecordSettings
    from sim.world.world import build_world

    settings = RecordSettings.model_validate(SETTINGS)
    world = build_world(build(str(path), settings), settings)
    mujoco.mj_step(world.model, world.data, 500)
    world.place_bodies()
    with StereoRenderer(world, settings.render) as renderer:
        first = renderer.render_images()
        top_down = render_world_map(world, renderer).image
        left, right = renderer.render_images()
        labels = vars(renderer.render_geometry())
    np.testing.assert_array_equal(first, (left, right))
    bound = {name for name in ("egl", "osmesa") if f"mujoco.{name}" in sys.modules}
    assert bound == {backend}
    return {"left": left, "right": right, "map": top_down, **labels}


def loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def test_osmesa_renders_like_egl(tmp_path, monkeypatch):
    (tmp_path / "yard.xml").write_text(YARD)
    views = []
    for backend in ("egl", "osmesa"):
        monkeypatch.setenv("MUJOCO_GL", backend)
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            views.append(pool.submit(drawn, tmp_path / "yard.xml", backend).result())
    egl, osmesa = views
    if osmesa is None:
        pytest.skip("there is no OSMesa")
    assert egl["left"].std() > 10
    assert len(np.unique(egl["geoms_left"])) >= 3
    for name in ("left", "right", "map"):
        different = np.abs(egl[name].astype(float) - osmesa[name])
        assert different.mean() <= MEAN_GREY
        assert (different > PIXEL_GREY).mean() <= OUTLINE_SHARE
    for name in ("geoms_left", "geoms_right"):
        assert (egl[name] != osmesa[name]).mean() <= OUTLINE_SHARE
    for name in ("depth_left_m", "depth_right_m"):
        alike = np.isclose(egl[name], osmesa[name], rtol=1e-4, equal_nan=True)
        assert (~alike).mean() <= OUTLINE_SHARE
