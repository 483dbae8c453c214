"""Plug-in classes: imported by `module:Class`, built with the rig and settings, and guarded."""

import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydantic import BaseModel

from trials.estimators.plugins import PluginError, WorkerEndedError
from vo.contract.arrays import Array
from vo.contract.errors import DriftyardError, SettingsError
from vo.contract.estimator import Estimate, Estimator, Finalizing, FinalResult, Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame
from vo.contract.settings import Settings, resolve

MAX_FAILURES = 20
"""Largest number of consecutive frames on which an estimator may fail."""

RIGID = 1e-3
"""Largest difference of R R^T of a pose from the identity."""


def build(
    name: str,
    rig: StereoRig,
    config: Path | None = None,
    overrides: Sequence[str] = (),
    plugin: Callable[..., Estimator] | None = None,
) -> tuple[Estimator, dict[str, Any]]:
    """Build an estimator from its class: that of its name, unless it is given itself.

    The class is called with the rig, and with an instance of its pydantic model `Settings` if it
    has one. The module may be in the working directory. Arguments and result are those of
    `trials.estimators.choice.make_estimator`.

    Raises:
        SettingsError: If it cannot be imported, is not an estimator, or refuses a setting.
        PluginError: If its constructor fails.
    """
    made, settings = find(name, config, overrides, plugin)
    words = (rig,) if settings is None else (rig, settings)
    try:
        return made(*words), {} if settings is None else settings.model_dump(mode="json")
    except DriftyardError:
        raise
    except Exception as error:
        raise PluginError(
            f"estimator {name}: cannot be built ({type(error).__name__}: {error})"
        ) from error


def find(
    name: str,
    config: Path | None = None,
    overrides: Sequence[str] = (),
    plugin: Callable[..., Estimator] | None = None,
) -> tuple[Callable[..., Estimator], Settings | None]:
    """Return the class of an estimator, and its resolved settings if it has some.

    Raises:
        SettingsError: As of `build`.
    """
    made = plugin or _imported(name)
    model = getattr(made, "Settings", None)
    if isinstance(model, type) and issubclass(model, BaseModel):
        if model.model_config.get("extra") != "forbid":
            raise SettingsError(
                f'estimator {name}: its Settings must refuse unknown keys (extra="forbid")'
            )
        return made, resolve(cast("type[Settings]", model), config, overrides)
    if config or overrides:
        raise SettingsError(f"estimator {name}: has no Settings, so takes no --set and no --config")
    return made, None


def _imported(name: str) -> Any:
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


class Guarded:
    """Estimator that turns exceptions and invalid estimates of another one into lost frames.

    Attributes:
        complaint: Exception of `finalize`, as text; empty if there was none.
    """

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._consecutive = 0
        self.complaint = ""

    def track(self, frame: StereoFrame) -> Estimate:
        """Track a frame; an exception becomes the reason of a lost frame.

        Raises:
            PluginError: After more than MAX_FAILURES consecutive failures, or if the process of
                the estimator has ended.
        """
        try:
            estimate = _checked(self._estimator.track(frame), frame)
        except WorkerEndedError:
            raise
        except Exception as error:
            self._consecutive += 1
            reason = _described(error)
            if self._consecutive > MAX_FAILURES:
                raise PluginError(
                    f"the estimator failed on {self._consecutive} frames in a row, the last at "
                    f"{frame.timestamp_ns} ns: {reason}"
                ) from error
            return Estimate(frame.timestamp_ns, Status.LOST, None, reason)
        self._consecutive = 0
        return estimate

    def finalize(self) -> FinalResult:
        """Finalize the estimator; an empty result if it cannot or fails."""
        if not isinstance(self._estimator, Finalizing):
            return FinalResult()
        try:
            return self._estimator.finalize()
        except Exception as error:
            self.complaint = _described(error)
            return FinalResult()


def _checked(estimate: Any, frame: StereoFrame) -> Estimate:
    if not isinstance(estimate, Estimate):
        raise TypeError(f"track returned {type(estimate).__name__} instead of an Estimate")
    if estimate.timestamp_ns != frame.timestamp_ns:
        raise ValueError(f"the estimate is of {estimate.timestamp_ns} ns")
    if estimate.T_odom_cam is not None and not _is_rigid(estimate.T_odom_cam):
        raise ValueError("T_odom_cam is not a rigid 4x4 transform")
    return estimate


def _is_rigid(T: Array) -> bool:
    if np.shape(T) != (4, 4) or not np.isfinite(T).all():
        return False
    R = T[:3, :3]
    straight = np.allclose(R @ R.T, np.eye(3), atol=RIGID) and np.linalg.det(R) > 0
    return bool(straight and np.allclose(T[3], [0, 0, 0, 1]))


def _described(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
