"""Cameras by name: settings in files, below those that a user gives."""

import pytest
from terminal import driftyard

import driftyard as dy
from scenes import SCENES, find_scene
from sim.camera_names import CAMERAS, DEFAULT_CAMERA
from sim.camera_settings import SensorSettings
from sim.cameras import camera_values
from sim.disturbances import disturbed, parse_disturbances
from sim.settings import RecordSettings, recorded_settings
from trials.cli.accuracy import DriveOptions
from trials.cli.gate import DesignOptions
from trials.cli.options import RecordingOptions
from trials.execution.jobs import Recording
from trials.execution.recording_settings import recording_settings
from trials.gate.baseline import Design
from trials.gym.env.settings import NavSettings
from vo.contract.errors import SettingsError
from vo.contract.settings import resolve


@pytest.mark.parametrize("name", CAMERAS)
def test_camera_settings_are_valid_alone(name):
    values = camera_values(name)
    built = resolve(RecordSettings, base=values)
    assert (built == RecordSettings()) == (name == "ideal")


def test_camera_yields_to_config_and_overrides_but_not_scene(tmp_path):
    config = tmp_path / "mine.toml"
    config.write_text("[sensor]\nread_noise = 7.0\n")
    found = recording_settings("dusk", None, ["rig.rate_hz=5"], config, camera="stoc")
    camera = camera_values("stoc")
    assert found.sensor.full_well == camera["sensor.full_well"]
    assert found.rig.baseline_m == camera["rig.baseline_m"]
    assert (found.sensor.read_noise, found.rig.rate_hz, found.rig.tilt_deg) == (7.0, 5.0, 18.0)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("disturb", ["", "blur=0.4,noise,drop"])
def test_ideal_camera_leaves_a_scene_as_it_is(scene, disturb):
    """It gives the settings of before there was a default camera."""
    own = resolve(RecordSettings, base=find_scene(scene).defaults)
    before = disturbed(own, parse_disturbances(disturb))
    assert recording_settings(scene, disturb=disturb, camera="ideal") == before
    trial = NavSettings(scene=scene, camera="ideal", disturb=disturb).recorded(0)
    assert (trial.sensor, trial.exposure) == (before.sensor, before.exposure)


def test_default_camera_is_that_of_recordings_trials_and_studies():
    """Sensor and exposure are all that it sets."""
    assert DEFAULT_CAMERA == "machine_vision"
    default = resolve(RecordSettings, base=camera_values(DEFAULT_CAMERA))
    wanted = default.sensor, default.exposure
    assert default.sensor.full_well > 0
    found = [
        recording_settings("office"),
        RecordingOptions().settings("office"),
        NavSettings(scene="office").recorded(0),
        recording_settings("office", camera=Recording("office", 0).camera),
        recording_settings("office", camera=DriveOptions().recordings(["office"])[0].camera),
    ]
    assert [(x.sensor, x.exposure) for x in found] == [wanted] * len(found)


def test_old_files_without_a_camera_are_of_the_ideal_one():
    """So are manifests, also without settings that came later, and baselines of the gate."""
    content = recording_settings("office", camera="ideal").model_dump(mode="json")
    assert recorded_settings(content).sensor == SensorSettings()
    assert recorded_settings({**content, "sensor": {}}).sensor == SensorSettings()
    assert Design.model_validate({"scenes": ["office"]}).camera == "ideal"
    assert DesignOptions(scenes="office").design.camera == DEFAULT_CAMERA


@pytest.mark.parametrize("scene", ["office", "dusk"])
def test_stated_exposure_time_turns_automatic_exposure_off(scene):
    config = {"exposure": {"time_ms": 12.0}}
    for found in (
        recording_settings(scene, None, ["exposure.time_ms=12"]),
        recording_settings(scene, disturb="blur=0.4"),
        NavSettings(scene=scene, settings={"exposure.time_ms": 12.0}).recorded(0),
        NavSettings(scene=scene, settings=config).recorded(0),
        NavSettings(scene=scene, disturb="blur=0.4,noise").recorded(0),
    ):
        assert (found.exposure.time_ms, found.sensor.auto_exposure) == (12.0, False)
        assert found.sensor.vignetting == camera_values(DEFAULT_CAMERA)["sensor.vignetting"]
    both = ["exposure.time_ms=12", "sensor.auto_exposure=true"]
    assert recording_settings(scene, None, both).sensor.auto_exposure
    assert recording_settings(scene, disturb="blur=0").sensor.auto_exposure


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
    found = recording_settings("office", 0, drives[0].overrides, camera=drives[0].camera)
    assert (found.sensor.read_noise, found.rig.color) == (1.0, True)


def test_scenes_command_and_help_list_the_cameras(tmp_path):
    listed = driftyard("scenes", cwd=tmp_path).stdout
    helped = driftyard("generate", "--help", cwd=tmp_path).stdout
    for name in CAMERAS:
        assert name in listed
        assert name in helped
    assert set(dy.cameras()) == set(CAMERAS)
