"""Plug-in classes: imported by `module:Class`, built with the rig and their settings."""

import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from pydantic import BaseModel

from trials.estimators.plugins import PluginError
from vo.contract.errors import DriftyardError, SettingsError
from vo.contract.estimator import Estimator
from vo.contract.rig import StereoRig
from vo.contract.settings import Settings, resolve


def build(
    name: str, rig: StereoRig, config: Path | None = None, overrides: Sequence[str] = ()
) -> tuple[Estimator, dict[str, Any]]:
    """Build an estimator from its class.

    The class is called with the rig, and with an instance of its pydantic model `Settings` if it
    has one. The module may be in the working directory.

    Args:
        name: `module:Class`.
        rig: Camera of the sequence.
        config: TOML file of settings.
        overrides: Settings, `key=value` each.

    Returns:
        The estimator and its resolved settings, ready for JSON.

    Raises:
        SettingsError: If it cannot be imported, is not an estimator, or refuses a setting.
        PluginError: If its constructor fails.
    """
    made = _find(name)
    model = getattr(made, "Settings", None)
    words: list[Any] = [rig]
    settings: dict[str, Any] = {}
    if isinstance(model, type) and issubclass(model, BaseModel):
        if model.model_config.get("extra") != "forbid":
            raise SettingsError(
                f'estimator {name}: its Settings must refuse unknown keys (extra="forbid")'
            )
        chosen = resolve(cast("type[Settings]", model), config, overrides)
        words.append(chosen)
        settings = chosen.model_dump(mode="json")
    elif config or overrides:
        raise SettingsError(f"estimator {name}: has no Settings, so takes no --set and no --config")
    try:
        return made(*words), settings
    except DriftyardError:
        raise
    except Exception as error:
        raise PluginError(
            f"estimator {name}: cannot be built ({type(error).__name__}: {error})"
        ) from error


def _find(name: str) -> Any:
    module_name, _, class_name = name.partition(":")
    if "" not in sys.path:
        sys.path.insert(0, "")
    try:
        module = importlib.import_module(module_name)
    except (ImportError, ValueError, SyntaxError) as error:
        raise SettingsError(f"estimator {name}: cannot import {module_name} ({error})") from None
    found = getattr(module, class_name, None)
    if not callable(getattr(found, "track", None)):
        raise SettingsError(
            f"estimator {name}: {module_name} has no class {class_name or '?'} with a method track"
        )
    return found
