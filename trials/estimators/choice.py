"""Choice of an estimator: by name, of this project or of another system, a class, or a program."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trials.estimators.systems.environments import SYSTEMS
from vo.contract.errors import SettingsError
from vo.contract.estimator import Estimate, Estimator
from vo.contract.rig import StereoRig
from vo.contract.settings import Settings, resolve
from vo.recordings.pairing import ALL_FRAMES, FrameSelection

if TYPE_CHECKING:
    from trials.estimators.baselines.corner_flow import CornerFlowSettings
    from trials.estimators.plugins.command import Command
    from vo.config import OdometrySettings
    from vo.runner import Run


@dataclass(frozen=True)
class Named:
    """An estimator that runs in this process, and its settings: a TOML file, and `key=value` each.

    The name is a key of ESTIMATORS or SYSTEMS, or `module:Class`; of a plug-in class that is given
    itself, it is only its name in tables.
    """

    name: str = "driftyard"
    config: Path | None = None
    overrides: tuple[str, ...] = ()
    plugin: Callable[..., Estimator] | None = None

    @property
    def is_own(self) -> bool:
        """Whether it is one of ESTIMATORS, which never raise on image content."""
        return self.plugin is None and self.name in ESTIMATORS


def _odometry_settings(
    preset: str, config: Path | None, overrides: Sequence[str]
) -> "OdometrySettings":
    from vo.config import THESIS, OdometrySettings

    base = THESIS.model_dump(exclude_defaults=True) if preset == "thesis" else {}
    return resolve(OdometrySettings, config, overrides, base)


def _odometry(rig: StereoRig, settings: "OdometrySettings") -> Estimator:
    from vo.odometry import StereoOdometry  # loads gtsam and numba, after the settings are accepted
    from vo.precompile import compile_ahead

    compile_ahead()
    return StereoOdometry(rig, settings)


def _corner_flow_settings(config: Path | None, overrides: Sequence[str]) -> "CornerFlowSettings":
    from trials.estimators.baselines.corner_flow import CornerFlowSettings

    return resolve(CornerFlowSettings, config, overrides)


def _corner_flow(rig: StereoRig, settings: "CornerFlowSettings") -> Estimator:
    from trials.estimators.baselines.corner_flow import CornerFlow

    return CornerFlow(rig, settings)


@dataclass(frozen=True)
class Own:
    """An estimator of this project: how its settings are resolved, and how it is built."""

    settings: Callable[[Path | None, Sequence[str]], Settings]
    build: Callable[[StereoRig, Any], Estimator]


ESTIMATORS = {
    "driftyard": Own(partial(_odometry_settings, "driftyard"), _odometry),
    "thesis": Own(partial(_odometry_settings, "thesis"), _odometry),
    "corner_flow": Own(_corner_flow_settings, _corner_flow),
}
COMPARED = ("driftyard", "corner_flow")
"""Estimators in tables of accuracy and speed: the default one, and a plain baseline."""


def make_estimator(
    name: str,
    rig: StereoRig,
    config: Path | None = None,
    overrides: Sequence[str] = (),
    plugin: Callable[..., Estimator] | None = None,
) -> tuple[Estimator, Mapping[str, Any]]:
    """Build an estimator of a sequence with this camera; other arguments as of `Named`.

    Returns:
        The estimator and its resolved settings, ready for JSON.

    Raises:
        SettingsError: If there is no such estimator, or it refuses a setting.
        PluginError: If a plug-in class cannot be built.
    """
    if plugin is None and name in ESTIMATORS:
        settings = ESTIMATORS[name].settings(config, overrides)
        return ESTIMATORS[name].build(rig, settings), settings.model_dump(mode="json")
    from trials.estimators.plugins.classes import build

    return build(name if plugin else _class_of(name), rig, config, overrides, plugin)


def check_settings(name: str, overrides: Sequence[str] = ()) -> None:
    """Check that there is an estimator, and that it accepts settings; it is not built.

    Raises:
        SettingsError: If there is none, or it refuses a setting.
    """
    if name in ESTIMATORS:
        ESTIMATORS[name].settings(None, overrides)
        return
    from trials.estimators.plugins.classes import find

    find(_class_of(name), None, overrides)


def _class_of(name: str) -> str:
    if name in SYSTEMS:
        return SYSTEMS[name].estimator
    if ":" not in name:
        valid = ", ".join([*sorted(ESTIMATORS), *SYSTEMS])
        raise SettingsError(f"unknown estimator {name}; valid: {valid}, or module:Class")
    return name


def accepts(name: str, overrides: Sequence[str]) -> bool:
    """Whether an estimator accepts settings."""
    try:
        check_settings(name, overrides)
    except SettingsError:
        return False
    return True


def estimate(
    choice: "Named | Command",
    dataset: Path,
    out: Path,
    progress: Callable[[Estimate], None] | None = None,
    frames: FrameSelection = ALL_FRAMES,
) -> "Run":
    """Run an estimator of any kind over a dataset and write what `vo.runner.write_run` writes.

    A frame on which a plug-in class raises is lost. Progress is called with the estimate of each
    frame, except for a program, whose output is kept in `<stem>.printed.txt` beside the result.
    What another one estimated before an error, an interruption or a kill is in the files of
    `vo.runner.UnfinishedRun`.

    Raises:
        DriftyardError: If dataset, estimator or settings are wrong, or a plug-in fails.
    """
    from trials.estimators.plugins import PluginError
    from trials.estimators.plugins.classes import Guarded
    from vo.recordings.readers import open_sequence
    from vo.runner import UnfinishedRun, companion, run, write_run

    sequence = open_sequence(dataset, frames)
    if not isinstance(choice, Named):
        from trials.estimators.plugins.command import run_command

        result = run_command(choice, dataset, sequence, companion(out, "printed.txt"))
        about = {"command": choice.template, "timeout_s": choice.timeout_s}
        write_run(out, result, choice.name, about, dataset)
        return result
    estimator, settings = make_estimator(
        choice.name, sequence.rig, choice.config, choice.overrides, choice.plugin
    )
    guarded = None if choice.is_own else Guarded(estimator)
    with UnfinishedRun(out) as unfinished:

        def add(found: Estimate, frame_ms: float) -> None:
            unfinished.add(found, frame_ms)
            if progress:
                progress(found)

        result = run(sequence, guarded or estimator, add)
        write_run(out, result, choice.name, settings, dataset)
    if guarded and guarded.complaint:
        raise PluginError(f"{out} is written, but finalize failed: {guarded.complaint}")
    return result
