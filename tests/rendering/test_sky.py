"""The sky drawn afterwards, in bands, against MuJoCo's drawing at once: no byte differs."""

import mujoco
import numpy as np
import pytest

import sim.camera.render
from sim.batch import build
from sim.camera.render import StereoRenderer
from sim.camera.sky import allows_sky_last, uncovered_bands
from sim.settings import RecordSettings
from sim.world.world import build_world

pytestmark = pytest.mark.gl

FENCE = "".join(
    f'<geom type="box" pos="2 {0.11 * k - 1.6:.3f} 0.5" size="0.02 0.0549 0.3"'
    f' euler="0 0 {k % 7}" rgba="0.{k % 9 + 1} 0.4 0.3 1"/>'
    for k in range(30)
)
YARD = f"""<mujoco><asset>
<texture name="sky" type="skybox" builtin="gradient" rgb1="0.9 0.7 0.5" rgb2="0.2 0.3 0.8"
 width="64" height="384"/></asset>
<worldbody><light pos="0 0 4"/><geom type="plane" size="3 3 1" rgba="0.6 0.5 0.4 1"/>
{FENCE}</worldbody></mujoco>"""
"""A fence of narrow gaps before the sky: samples without anything, far below the horizon too."""


def painted(tmp_path, samples, color):
    (tmp_path / "yard.xml").write_text(YARD)
    settings = RecordSettings.model_validate(
        {
            "rig": {"tilt_deg": 5.0},
            "drive": {"distance_m": 0.2},
            "render": {"samples": samples},
        }
    )
    world = build_world(build(str(tmp_path / "yard.xml"), settings), settings)
    with StereoRenderer(world, settings.render, color) as renderer:
        return renderer.render_images(), renderer.render_images(sky=False)


@pytest.mark.parametrize("samples", [0, 4])
@pytest.mark.parametrize("color", [False, True])
def test_sky_in_bands_equals_the_whole_sky(tmp_path, monkeypatch, samples, color):
    ours, without = painted(tmp_path, samples, color)
    monkeypatch.setattr(sim.camera.render, "allows_sky_last", lambda scene: False)
    at_once, _ = painted(tmp_path, samples, color)
    for side in (0, 1):
        np.testing.assert_array_equal(ours[side], at_once[side])
        shown = (ours[side] != without[side]).reshape(len(ours[side]), -1).any(axis=1)
        assert 0.1 < shown.mean() < 0.9


def test_uncovered_bands_contain_all_rows_in_few_bands():
    rgba = np.full((200, 6, 4), 255, np.uint8)
    assert uncovered_bands(rgba) == []
    for row in (3, 20, 90, 91, 199):
        rgba[row, row % 6, 3] = 191
    assert uncovered_bands(rgba) == [(3, 21), (90, 92), (199, 200)]


def test_transparent_geom_prevents_sky_last():
    scene = mujoco.MjvScene(mujoco.MjModel.from_xml_string("<mujoco/>"), maxgeom=3)
    scene.ngeom = 2
    for geom in scene.geoms[:2]:
        geom.transparent = 0
    assert allows_sky_last(scene)
    scene.geoms[1].transparent = 1
    assert not allows_sky_last(scene)
