"""Settings of a recording from a scene's defaults, a file, overrides and disturbances."""

from collections.abc import Sequence
from pathlib import Path

from scenes import SCENES, find_scene
from scenes.custom import is_custom
from sim.camera_names import DEFAULT_CAMERA
from sim.cameras import camera_values
from sim.disturbances import disturbed, disturbed_values, parse_disturbances
from sim.settings import RecordSettings
from vo.contract.errors import SettingsError
from vo.contract.settings import given_values, resolve


def recording_settings(
    scene: str,
    seed: int | None = None,
    overrides: Sequence[str] = (),
    config: Path | None = None,
    disturb: str = "",
    camera: str = DEFAULT_CAMERA,
) -> RecordSettings:
    """Resolve the settings of a recording of a registered scene, MJCF file or `module:function`.

    A seed takes precedence over that of other sources. Disturbances are `name=strength,...`. The
    settings of a camera, as of `camera_values`, take precedence over a scene's defaults alone.

    Raises:
        SettingsError: If there is no such scene, camera or disturbance, or a key or value is not
            accepted.
    """
    wanted = parse_disturbances(disturb)
    seeded = [] if seed is None else [f"seed={seed}"]
    stated = {*given_values(config, overrides), *disturbed_values(wanted)}
    base = {**find_scene(scene).defaults, **camera_values(camera, stated)}
    return disturbed(resolve(RecordSettings, config, [*overrides, *seeded], base), wanted)


def parse_scenes(names: str, option: str = "--scenes") -> list[str]:
    """Split `a,b,c` into scenes; `all` stands for all registered ones.

    Raises:
        SettingsError: If none is named, or one is neither registered nor an MJCF file nor
            `module:function`; names the option.
    """
    chosen = list(SCENES) if names == "all" else [name for name in names.split(",") if name]
    valid = f"valid: all, {', '.join(SCENES)}"
    if not chosen:
        raise SettingsError(f"{option}: names no scene; {valid}")
    for name in chosen:
        if name not in SCENES and not is_custom(name):
            raise SettingsError(f"{option}: unknown {name}; {valid}")
    return chosen
