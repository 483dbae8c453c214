"""Cameras by name: settings in files, below those that a user gives."""

import pytest
from terminal import driftyard

import driftyard as dy
from sim.cameras import CAMERAS, camera_overrides, camera_values
from sim.settings import RecordSettings
from trials.cli.accuracy import DriveOptions
from trials.cli.options import RecordingOptions
from trials.execution.recording_settings import recording_settings
from trials.gym.env.settings import NavSettings
from vo.contract.errors import SettingsError
from vo.contract.settings import resolve


@pytest.mark.parametrize("name", CAMERAS)
def test_camera_settings_are_valid_alone(name):
    values = camera_values(name)
    built = resolve(RecordSettings, base=values)
    assert (built == RecordSettings()) == (name == "ideal")
    assert resolve(RecordSettings, overrides=camera_overrides(name)) == built


def test_camera_yields_to_config_and_overrides_but_not_scene(tmp_path):
    config = tmp_path / "mine.toml"
    config.write_text("[sensor]\nread_noise = 7.0\n")
    found = recording_settings("dusk", None, ["rig.rate_hz=5"], config, camera="stoc")
    camera = camera_values("stoc")
    assert found.sensor.full_well == camera["sensor.full_well"]
    assert found.rig.baseline_m == camera["rig.baseline_m"]
    assert (found.sensor.read_noise, found.rig.rate_hz, found.rig.tilt_deg) == (7.0, 5.0, 18.0)


def test_ideal_camera_leaves_a_scene_as_it_is():
    assert recording_settings("dusk", camera="ideal") == recording_settings("dusk")


def test_camera_of_a_file_is_one_of_settings(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("sensor.full_well = 9000.0\n[rig]\nhfov_deg = 60.0\n[exposure]\ntime_ms = 3\n")
    options = RecordingOptions(camera=str(file), overrides=["exposure.time_ms=4"])
    found = options.settings("office")
    assert (found.sensor.full_well, found.rig.hfov_deg, found.exposure.time_ms) == (9000, 60, 4)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("sensor.red = 1\n", "unknown setting sensor.red"),
        ("sensor = 1\n", "setting sensor: is a group"),
        ("sensor.full_well = -1\n", "setting sensor.full_well"),
        ("[sensor\n", "not valid TOML"),
    ],
)
def test_camera_of_a_wrong_file_is_refused_by_name(tmp_path, text, problem):
    file = tmp_path / "wrong.toml"
    file.write_text(text)
    with pytest.raises(SettingsError, match=problem) as error:
        camera_values(str(file))
    assert str(error.value).startswith(f"{file}: ")


def test_unknown_camera_lists_the_valid_ones(tmp_path):
    with pytest.raises(SettingsError, match="unknown camera zeb; valid: ideal, machine_vision,"):
        camera_values("zeb")
    with pytest.raises(SettingsError, match=r"none\.toml"):
        camera_values(str(tmp_path / "none.toml"))


def test_environments_and_studies_take_a_camera():
    full_well = camera_values("machine_vision")["sensor.full_well"]
    trial = NavSettings(scene="office", camera="machine_vision").recorded(0)
    assert (trial.sensor.full_well, trial.rig.rate_hz) == (full_well, 15.0)
    trial = NavSettings(camera="stoc", settings={"sensor.full_well": 5.0}).recorded(0)
    assert (trial.sensor.full_well, trial.rig.baseline_m) == (5.0, 0.09)
    drives = DriveOptions(camera="webcam", overrides=["sensor.read_noise=1"]).recordings(["office"])
    found = recording_settings("office", 0, drives[0].overrides)
    assert (found.sensor.read_noise, found.rig.color) == (1.0, True)


def test_scenes_command_and_help_list_the_cameras(tmp_path):
    listed = driftyard("scenes", cwd=tmp_path).stdout
    helped = driftyard("generate", "--help", cwd=tmp_path).stdout
    for name in CAMERAS:
        assert name in listed
        assert name in helped
    assert set(dy.cameras()) == set(CAMERAS)
