"""Recording settings, random streams and encoders."""

import json
from typing import ClassVar, Literal

import numpy as np
import pytest

from scenes import find_scene
from sim.batch import DatasetTask
from sim.camera.gl import choose_backend
from sim.settings import DriveSettings, RecordSettings, RigSettings
from sim.world.random_streams import stream
from sim.world.rover import ticks
from sim.world.trip import SamplingClock
from trials.execution.recording_settings import recording_settings
from trials.gym.env.settings import NavSettings
from trials.navigation.settings import NavigatorSettings
from vo.config import OdometrySettings
from vo.contract.dataset import MANIFEST
from vo.contract.errors import DatasetError, SettingsError
from vo.contract.settings import Settings, amended, keys, resolve, with_defaults


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("rig.baseline_m=0", r"setting rig.baseline_m: .*greater than 0, got 0$"),
        ("rig=3", r"setting rig: is a group, got 3; set rig\.NAME$"),
        ("scene=3", r"setting scene: is a group, got 3; set scene\.NAME$"),
        ("rig.tilt_deg=80", "rig.tilt_deg"),
        (
            "rig.tilt=20",
            "unknown setting rig.tilt; valid here: baseline_m, .*did you mean rig.tilt_deg?",
        ),
        ("drive.speed_mps=nan", "drive.speed_mps"),
        ("render.backend=vulkan", "render.backend"),
        ("seed=-1", "seed"),
    ],
)
def test_resolve_wrong_setting_is_refused_by_name(override, message):
    with pytest.raises(SettingsError, match=message):
        resolve(RecordSettings, overrides=[override])


class Inner(Settings):
    renamed: ClassVar = {"most_px": "max_px", "mode=fast": "mode=quick", "gone": "it had no effect"}
    max_px: float = 1.0
    mode: Literal["quick", "slow"] = "quick"


class Outer(Settings):
    renamed: ClassVar = {"core": "inner", "depth_px": "inner.max_px"}
    inner: Inner = Inner()


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("inner.most_px=2", "setting inner.most_px is now inner.max_px"),
        ("core.max_px=2", "setting core.max_px is now inner.max_px"),
        ("core.most_px=2", "setting core.most_px is now inner.max_px"),
        ("depth_px=2", "setting depth_px is now inner.max_px"),
        ("inner.gone=2", "setting inner.gone was removed: it had no effect"),
        ("inner.mode=fast", "setting inner.mode: .*; fast is now quick"),
    ],
)
def test_resolve_old_name_names_the_new_one(override, message):
    with pytest.raises(SettingsError, match=message) as caught:
        resolve(Outer, overrides=[override])
    assert "\n" not in str(caught.value)


def test_resolve_old_name_in_toml_names_the_new_one(tmp_path):
    file = tmp_path / "old.toml"
    file.write_text("[core]\nmost_px = 2\n")
    with pytest.raises(SettingsError, match="is now inner"):
        resolve(Outer, file)


def test_renamed_leads_to_settings_that_exist():
    for model in (RecordSettings, OdometrySettings, NavSettings, NavigatorSettings):
        for key, new in _renamed(model):
            assert " " in new or new.partition("=")[0] in {*keys(model)}, (model, key, new)


def _renamed(model, prefix=""):
    for key, new in getattr(model, "renamed", {}).items():
        if " " in new or any(x.startswith(f"{prefix}{new}.") for x in keys(model)):
            continue  # removed, or a group
        yield key, prefix + new
    for name, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, Settings):
            for key, new in _renamed(field.annotation):
                yield f"{prefix}{name}.{key}", f"{prefix}{name}.{new}"


def test_resolve_scene_options_pass_through():
    settings = resolve(RecordSettings, overrides=["scene.bond=running", "scene.gap_mm=3.5"])
    assert settings.scene == {"bond": "running", "gap_mm": 3.5}


def test_settings_in_python_equal_those_of_the_command_line():
    """Whatever built them: a constructor, a copy or an amendment; what is set stays."""
    scene = find_scene("dusk").defaults
    for built, overrides in (
        (RecordSettings(), []),
        (RecordSettings(rig=RigSettings(width_px=320)), ["rig.width_px=320"]),
        (RecordSettings(rig=RigSettings(tilt_deg=25)), ["rig.tilt_deg=25"]),
        (RecordSettings().model_copy(update={"seed": 3}), ["seed=3"]),
        (amended(RecordSettings(), {"rig.rate_hz": 7}), ["rig.rate_hz=7"]),
    ):
        found = recording_settings("dusk", None, overrides, camera="ideal")
        assert with_defaults(built, scene) == found


def test_task_in_python_finds_its_dataset(tmp_path):
    settings = recording_settings("dusk", camera="ideal").model_dump(mode="json")
    content = {"schema_version": 1, "settings": settings, "scene": {"source": "dusk"}}
    (tmp_path / MANIFEST).write_text(json.dumps(content))
    assert DatasetTask("dusk", RecordSettings(), tmp_path).is_done
    with pytest.raises(DatasetError, match="exists with other settings"):
        _ = DatasetTask("dusk", RecordSettings(rig=RigSettings(tilt_deg=25)), tmp_path).is_done


def test_stream_of_seed_and_name_repeats():
    assert stream(4, "scene").random() == stream(4, "scene").random()
    values = {stream(seed, name).random() for seed in (4, 5) for name in ("scene", "noise")}
    assert len(values) == 4


def test_ticks_of_turns_round_down_in_both_directions():
    turns = np.array([0.0, 0.009, 0.011, -0.001, 1.0])
    np.testing.assert_array_equal(ticks(turns * 2 * np.pi + 1e-12, 100), [0, 0, 1, -1, 100])


def test_sampling_clock_is_due_at_the_next_physics_step():
    clock = SamplingClock(rate_hz=100, timestep_s=0.004)
    assert [step for step in range(-2, 10) if clock.due(step)] == [0, 3, 5, 8]
    assert not SamplingClock(rate_hz=0, timestep_s=0.004).due(100)


def test_choose_backend_auto_follows_the_environment(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    assert choose_backend("auto") == "osmesa"
    assert choose_backend("egl") == "egl"
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    assert choose_backend("auto") in ("egl", "osmesa")


def test_speed_beyond_the_rovers_wheels_says_why():
    with pytest.raises(ValueError, match=r"wheels turn at most 20 rad/s, which is 1 m/s"):
        DriveSettings(speed_mps=1.5)
    assert DriveSettings(speed_mps=1.5, carrier="handheld").speed_mps == 1.5
