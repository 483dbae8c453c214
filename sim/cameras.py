"""Cameras by name: TOML files of recording settings, which a user's own camera may be, too."""

from pathlib import Path
from typing import Any

from sim.settings import RecordSettings
from vo.contract.errors import SettingsError
from vo.contract.settings import given_values, overrides_of, resolve

CAMERAS = {
    "ideal": "perfect pinhole, apart from what a scene sets",
    "machine_vision": "industrial camera: global shutter, low noise, short exposure",
    "stoc": "Videre STOC, 9 cm: global shutter, noisy VGA imagers",
    "webcam": "pair of webcams: rolling shutter, long exposure, compression, colour",
    "d435_infra": "infrared pair of Intel RealSense D435: 5 cm, 87 degrees, global shutter",
    "zed": "Stereolabs ZED: 12 cm, 720p, rolling shutter, colour",
}
"""Name of each camera, and what it is; its file is `imaging/cameras/NAME.toml`."""


def camera_values(camera: str) -> dict[str, Any]:
    """Return the settings, by `key.path`, of one of CAMERAS or of a TOML file; "" has none.

    Raises:
        SettingsError: If there is no such camera, or a key or value of the file is not accepted.
    """
    if not camera:
        return {}
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
    return values


def camera_overrides(camera: str) -> tuple[str, ...]:
    """Return the settings of `camera_values` as `key=value` each."""
    return overrides_of(camera_values(camera))
