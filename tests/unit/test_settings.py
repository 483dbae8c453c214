"""Recording settings, random streams and encoders."""

import numpy as np
import pytest

from sim.camera.gl import choose_backend
from sim.sensors.wheel_encoders import Encoders, ticks
from sim.settings import RecordSettings
from sim.world.random_streams import stream
from vo.contract.errors import SettingsError
from vo.contract.settings import resolve


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("rig.baseline_m=0", "rig.baseline_m"),
        ("rig.tilt_deg=80", "rig.tilt_deg"),
        ("rig.tilt=20", "unknown setting rig.tilt; valid here: baseline_m, color"),
        ("drive.speed_mps=nan", "drive.speed_mps"),
        ("render.backend=vulkan", "render.backend"),
        ("seed=-1", "seed"),
    ],
)
def test_settings_are_refused_by_name(override, message):
    with pytest.raises(SettingsError, match=message):
        resolve(RecordSettings, overrides=[override])


def test_scene_options_pass_through():
    settings = resolve(RecordSettings, overrides=["scene.bond=running", "scene.gap_mm=3.5"])
    assert settings.scene == {"bond": "running", "gap_mm": 3.5}


def test_streams_repeat_and_do_not_disturb_each_other():
    assert stream(4, "scene").random() == stream(4, "scene").random()
    values = {stream(seed, name).random() for seed in (4, 5) for name in ("scene", "noise")}
    assert len(values) == 4


def test_ticks_round_down_in_both_directions():
    turns = np.array([0.0, 0.009, 0.011, -0.001, 1.0])
    np.testing.assert_array_equal(ticks(turns * 2 * np.pi + 1e-12, 100), [0, 0, 1, -1, 100])


def test_encoder_readings_fall_on_the_next_physics_step():
    encoders = Encoders(ticks_per_turn=100, rate_hz=100)
    steps = []
    for _ in range(4):
        steps.append(encoders.next_step(timestep_s=0.004))
        encoders.read(steps[-1], np.zeros(2))
    assert steps == [0, 3, 5, 8]


def test_the_environment_chooses_the_backend_only_if_asked(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert choose_backend("auto") == "osmesa"
    assert choose_backend("egl") == "egl"
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    assert choose_backend("auto") in ("egl", "osmesa")
