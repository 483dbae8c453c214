"""Cameras by name: TOML files of recording settings, which a user's own camera may be, too."""

from collections.abc import Container
from pathlib import Path
from typing import Any

from sim.camera_names import CAMERAS
from sim.settings import RecordSettings
from vo.contract.errors import SettingsError
from vo.contract.settings import given_values, resolve

EXPOSURE_TIME, AUTO_EXPOSURE = "exposure.time_ms", "sensor.auto_exposure"


def camera_values(camera: str, stated: Container[str] = ()) -> dict[str, Any]:
    """Return the settings, by `key.path`, of one of CAMERAS or of a TOML file.

    They are defaults for what is not `stated`, keys of settings and disturbances. A stated exposure
    time holds for every image: it turns off the automatic exposure of the camera.

    Raises:
        SettingsError: If there is no such camera, or a key or value of the file is not accepted.
    """
    if camera not in CAMERAS and not camera.endswith(".toml"):
        valid = ", ".join(CAMERAS)
        raise SettingsError(f"unknown camera {camera}; valid: {valid}, or a TOML file of settings")
    file = Path(camera)
    if camera in CAMERAS:
        file = Path(__file__).parent / "imaging" / "cameras" / f"{camera}.toml"
    values = given_values(file)
    try:
        resolve(RecordSettings, base=values)
    except SettingsError as error:
        raise SettingsError(f"{file}: {error}") from None
    if values.get(AUTO_EXPOSURE) and EXPOSURE_TIME in stated:
        values[AUTO_EXPOSURE] = False
    return values
