"""The sky drawn afterwards, in bands, against MuJoCo's drawing at once: no byte differs."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sim.camera.render
from sim.batch import build
from sim.camera.render import StereoRenderer
from sim.camera.sky import in_bands
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


def open_yard(tmp_path, samples, color, text=YARD):
    (tmp_path / "yard.xml").write_text(text)
    settings = RecordSettings.model_validate(
        {
            "rig": {"tilt_deg": 5.0},
            "drive": {"distance_m": 0.2},
            "render": {"samples": samples},
        }
    )
    world = build_world(build(str(tmp_path / "yard.xml"), settings), settings)
    return world, StereoRenderer(world, settings.render, color)


def painted(tmp_path, samples, color, text=YARD):
    _, opened = open_yard(tmp_path, samples, color, text)
    with opened as renderer:
        return renderer.render_images()


@pytest.mark.parametrize("samples", [0, 4])
@pytest.mark.parametrize("color", [False, True])
def test_sky_in_bands_equals_the_whole_sky(tmp_path, monkeypatch, samples, color):
    ours = painted(tmp_path, samples, color)
    without = painted(tmp_path, samples, color, YARD.replace("skybox", "cube"))
    monkeypatch.setattr(sim.camera.render, "allows_sky_last", lambda scene: False)
    at_once = painted(tmp_path, samples, color)
    for side in (0, 1):
        np.testing.assert_array_equal(ours[side], at_once[side])
        shown = (ours[side] != without[side]).reshape(len(ours[side]), -1).any(axis=1)
        assert 0.1 < shown.mean() < 0.9


def test_sky_of_the_frame_before_changes_no_byte(tmp_path, monkeypatch):
    """The camera nods by more than the margin, stays, and looks up, where all rows are sky."""
    world, opened = open_yard(tmp_path, 4, False)
    frames = []
    with opened as renderer:
        straight = world.data.cam_xmat.copy()
        for pitch in (0, 0.2, 0.2, -0.3, 1.4, 0):
            nod = Rotation.from_euler("x", pitch).as_matrix()
            world.data.cam_xmat[:] = (straight.reshape(-1, 3, 3) @ nod).reshape(-1, 9)
            ours = renderer.render_images()
            with monkeypatch.context() as patch:
                patch.setattr(sim.camera.render, "allows_sky_last", lambda scene: False)
                at_once = renderer.render_images()
            np.testing.assert_array_equal(ours, at_once)
            frames.append(ours)
    np.testing.assert_array_equal(frames[1], frames[2])
    np.testing.assert_array_equal(frames[0], frames[5])
    assert (np.array(frames[4]) != frames[0]).mean() > 0.5


def test_few_bands_contain_all_rows():
    assert in_bands(np.array([], int)) == []
    assert in_bands(np.array([3, 20, 90, 91, 199])) == [(3, 21), (90, 92), (199, 200)]
