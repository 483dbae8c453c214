"""Choice of an estimator: a registered name, a class as `module:Class`, or a program."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vo.contract.errors import SettingsError
from vo.contract.estimator import Estimate, Estimator
from vo.contract.rig import StereoRig
from vo.contract.settings import Settings, resolve
from vo.recordings.pairing import ALL_FRAMES, FrameSelection

if TYPE_CHECKING:
    from trials.estimators.plugins.command import Command
    from vo.runner import Run

Factory = Callable[[StereoRig, Path | None, Sequence[str]], tuple[Estimator, Settings]]


@dataclass(frozen=True)
class Named:
    """An estimator that runs in this process, and its settings: a TOML file, and `key=value` each.

    The name is a key of ESTIMATORS, or `module:Class`; of a plug-in class that is given itself, it
    is only its name in tables.
    """

    name: str = "driftyard"
    config: Path | None = None
    overrides: tuple[str, ...] = ()
    plugin: Callable[..., Estimator] | None = None

    @property
    def is_own(self) -> bool:
        """Whether it is one of ESTIMATORS, which never raise on image content."""
        return self.plugin is None and self.name in ESTIMATORS


def _odometry(
    preset: str, rig: StereoRig, config: Path | None, overrides: Sequence[str]
) -> tuple[Estimator, Settings]:
    from vo.config import THESIS, OdometrySettings

    base = THESIS.model_dump(exclude_defaults=True) if preset == "thesis" else {}
    settings = resolve(OdometrySettings, config, overrides, base)
    from vo.odometry import StereoOdometry  # loads gtsam and numba, after the settings are accepted
    from vo.precompile import compile_ahead

    compile_ahead()
    return StereoOdometry(rig, settings), settings


def _corner_flow(
    rig: StereoRig, config: Path | None, overrides: Sequence[str]
) -> tuple[Estimator, Settings]:
    from trials.estimators.baselines.corner_flow import CornerFlow, CornerFlowSettings

    settings = resolve(CornerFlowSettings, config, overrides)
    return CornerFlow(rig, settings), settings


ESTIMATORS: dict[str, Factory] = {
    "driftyard": partial(_odometry, "driftyard"),
    "thesis": partial(_odometry, "thesis"),
    "corner_flow": _corner_flow,
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
        estimator, settings = ESTIMATORS[name](rig, config, overrides)
        return estimator, settings.model_dump(mode="json")
    if plugin is None and ":" not in name:
        valid = ", ".join(sorted(ESTIMATORS))
        raise SettingsError(f"unknown estimator {name}; valid: {valid}, or module:Class")
    from trials.estimators.plugins.classes import build

    return build(name, rig, config, overrides, plugin)


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
