"""Estimators by name, and anyone's as `module:Class`."""

import importlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from vo.contract.errors import SettingsError
from vo.contract.estimator import Estimator
from vo.contract.rig import StereoRig
from vo.contract.settings import Settings, resolve

Factory = Callable[[StereoRig, Path | None, Sequence[str]], tuple[Estimator, Settings]]


def _driftyard(
    rig: StereoRig, config: Path | None, overrides: Sequence[str]
) -> tuple[Estimator, Settings]:
    from vo.config import OdometrySettings

    settings = resolve(OdometrySettings, config, overrides)
    from vo.odometry import StereoOdometry  # loads gtsam and numba: after the cheap mistakes

    return StereoOdometry(rig, settings), settings


def _corner_flow(
    rig: StereoRig, config: Path | None, overrides: Sequence[str]
) -> tuple[Estimator, Settings]:
    from trials.baselines.corner_flow import CornerFlow, CornerFlowSettings

    settings = resolve(CornerFlowSettings, config, overrides)
    return CornerFlow(rig, settings), settings


ESTIMATORS: dict[str, Factory] = {"driftyard": _driftyard, "corner_flow": _corner_flow}


def make_estimator(
    name: str, rig: StereoRig, config: Path | None = None, overrides: Sequence[str] = ()
) -> tuple[Estimator, Mapping[str, Any]]:
    """Build a fresh estimator.

    Args:
        name: A key of ESTIMATORS, or `module:Class` of a class that is called with the rig alone.
        rig: Of the sequence it will see.
        config: TOML file of settings.
        overrides: `key=value` each.

    Returns:
        The estimator and its resolved settings, ready for JSON.

    Raises:
        SettingsError: If there is no such estimator, or it refuses a setting.
    """
    if name in ESTIMATORS:
        estimator, settings = ESTIMATORS[name](rig, config, overrides)
        return estimator, settings.model_dump(mode="json")
    if ":" not in name:
        valid = ", ".join(sorted(ESTIMATORS))
        raise SettingsError(f"unknown estimator {name}; valid: {valid}, or module:Class")
    if config or overrides:
        raise SettingsError(f"estimator {name}: --set and --config are for driftyard's own")
    return _load(name)(rig), {}


def _load(name: str) -> Callable[[StereoRig], Estimator]:
    module_name, _, class_name = name.partition(":")
    try:
        module = importlib.import_module(module_name)
    except (ImportError, ValueError) as error:
        raise SettingsError(f"estimator {name}: cannot import {module_name} ({error})") from None
    found = getattr(module, class_name, None)
    if not callable(getattr(found, "track", None)):
        raise SettingsError(
            f"estimator {name}: {module_name} has no class {class_name or '?'} with a method track"
        )
    return cast("Callable[[StereoRig], Estimator]", found)
