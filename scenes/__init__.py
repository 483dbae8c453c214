"""The registry of scenes: builders of worlds to drive through, without physics and rendering."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
from pydantic import ValidationError

from scenes import (
    asphalt,
    brick_court,
    corridor,
    crowded,
    custom,
    dusk,
    lab_circle,
    long_haul,
    meadow,
    office,
    ramp,
    sandbox,
    sill,
    stop_and_go,
    street,
    turntable,
    warehouse,
)
from scenes.scene import Scene
from vo.contract.errors import SettingsError
from vo.contract.remarks import remark
from vo.contract.settings import Settings, complaint


def _remark(text: str) -> None:
    with suppress(Exception):  # one that is raised in MuJoCo ends the process
        remark(f"MuJoCo warns: {text}")


if mujoco.get_mju_user_warning() is None:  # it would write to MUJOCO_LOG.TXT in the user's folder
    mujoco.set_mju_user_warning(_remark)


@dataclass(frozen=True)
class SceneBuilder:
    """Builder of a scene from a generator and its options, and what the scene tests.

    The defaults are its recording settings, as `key.path` to value; the user's take precedence.
    """

    tests: str
    options: type[Settings]
    build: Callable[[np.random.Generator, Any], Scene]
    defaults: Mapping[str, float | str] = field(default_factory=dict[str, float | str])


def _builder(scene: ModuleType, defaults: Mapping[str, float | str] | None = None) -> SceneBuilder:
    return SceneBuilder(scene.TESTS, scene.Options, scene.build, defaults or {})


SCENES: dict[str, SceneBuilder] = {
    "asphalt": _builder(asphalt),
    "brick_court": _builder(brick_court),
    "corridor": _builder(corridor, {"rig.tilt_deg": 8.0}),
    "crowded": _builder(crowded, {"rig.tilt_deg": 10.0}),
    "dusk": _builder(
        dusk,
        {
            "rig.tilt_deg": 18.0,
            "sensor.auto_exposure": True,
            "sensor.target_grey": 80.0,
            "sensor.full_well": 15000.0,
            "sensor.read_noise": 3.0,
            "exposure.time_ms": 10.0,
        },
    ),
    "lab_circle": _builder(
        lab_circle,
        {
            "drive.carrier": "handheld",
            "drive.speed_mps": 0.5,
            "rig.height_m": 1.25,
            "rig.tilt_deg": 12.0,
        },
    ),
    "long_haul": _builder(long_haul, {"rig.tilt_deg": 15.0}),
    "meadow": _builder(meadow, {"rig.tilt_deg": 15.0}),
    "office": _builder(office),
    "ramp": _builder(ramp, {"rig.tilt_deg": 18.0}),
    "sandbox": _builder(sandbox, {"rig.tilt_deg": 22.0, "rig.baseline_m": 0.07}),
    "sill": _builder(sill, {"rig.tilt_deg": 18.0}),
    "stop_and_go": _builder(
        stop_and_go, {"rig.tilt_deg": 8.0, "drive.stop_every_m": 0.9, "drive.stop_s": 4.0}
    ),
    "street": _builder(street, {"rig.tilt_deg": 12.0, "render.far_m": 250.0}),
    "turntable": _builder(
        turntable,
        {"rig.tilt_deg": 15.0, "drive.turn_rate_max_deg_s": 120.0, "exposure.time_ms": 18.0},
    ),
    "warehouse": _builder(warehouse, {"rig.tilt_deg": 15.0}),
}


def find_scene(name: str) -> SceneBuilder:
    """Find a builder by its name; an MJCF file or a `module:function` is a custom scene.

    Raises:
        SettingsError: If there is no such scene.
    """
    if custom.is_custom(name):
        return SceneBuilder(custom.TESTS, Settings, lambda *_: custom.load_scene(name))
    if name not in SCENES:
        if name and Path(name).suffix != ".py" and Path(name).exists():
            raise SettingsError(f"{name}: expected an MJCF file, whose name ends in .xml or .mjcf")
        function = f"{Path(name).stem}:FUNCTION" if name.endswith(".py") else "module:function"
        valid = ", ".join([*sorted(SCENES), f"an MJCF file, or {function}"])
        raise SettingsError(f"unknown scene {name}; valid: {valid}")
    return SCENES[name]


def build_scene(name: str, rng: np.random.Generator, options: Mapping[str, object]) -> Scene:
    """Build the scene `name`; the same generator state and options give the same scene.

    It carries the defaults of its recording settings.

    Raises:
        SettingsError: If there is no such scene or option, or a value is refused.
    """
    builder = find_scene(name)
    return replace(builder.build(rng, scene_options(name, options)), defaults=builder.defaults)


def scene_options(name: str, options: Mapping[str, object]) -> Settings:
    """Check the options of the scene `name`.

    Raises:
        SettingsError: If there is no such scene or option, or a value is refused.
    """
    model = find_scene(name).options
    try:
        return model.model_validate(dict(options))
    except ValidationError as error:
        raise SettingsError(_explain(name, model, error)) from None


def _explain(name: str, model: type[Settings], error: ValidationError) -> str:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        valid = ", ".join(sorted(model.model_fields))
        return f"scene {name}: unknown option {key}; valid: {valid}"
    return f"scene {name}: option {key}: {complaint(error)}"
