"""Options that commands share, as frozen dataclasses that `expand` turns into parameters."""

import functools
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, get_args, get_type_hints

import typer

if TYPE_CHECKING:
    from sim.settings import RecordSettings
    from trials.estimators.choice import Named
    from trials.estimators.plugins.command import Command

SceneName = Annotated[
    str,
    typer.Argument(
        help="Registered scene (`driftyard scenes` lists them), MJCF file, or module:function."
    ),
]
Dataset = Annotated[Path, typer.Argument(help="Dataset folder: driftyard, EuRoC or KITTI.")]
Trajectories = Annotated[
    list[Path], typer.Argument(metavar="FILE...", help="Trajectory files, TUM format.")
]
Seed = Annotated[int, typer.Option(min=0, help="Random seed of scene, route and noise.")]
Scenes = Annotated[str, typer.Option(metavar="A,B,C", help="Names of scenes, or all.")]
Distance = Annotated[float, typer.Option(min=1.2, help="Length of each drive, m.")]


@dataclass(frozen=True)
class RecordingOptions:
    """Settings of a recording."""

    PANEL: ClassVar[str] = "Recording"
    seed: Annotated[
        int | None,
        typer.Option(help="Random seed of scene, route and noise.", show_default="0"),
    ] = None
    overrides: Annotated[
        list[str],
        typer.Option(
            "--set", metavar="KEY=VALUE",
            help="Change a setting of `driftyard settings recording`; may be repeated.",
        ),
    ] = field(default_factory=list[str])  # fmt: skip
    config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="TOML file of recording settings.")
    ] = None
    disturb: Annotated[
        str,
        typer.Option(
            metavar="NAME[=STRENGTH],...",
            help="Disturbances that `driftyard scenes` lists, such as blur,brick_bump=0.5.",
        ),
    ] = ""

    def settings(self, scene: str) -> "RecordSettings":
        """Resolve the settings of a recording of a scene.

        Raises:
            SettingsError: If scene, disturbance, key or value is not accepted.
        """
        from trials.execution.recording_settings import recording_settings

        return recording_settings(scene, self.seed, self.overrides, self.config, self.disturb)


@dataclass(frozen=True)
class EstimatorOptions:
    """An estimator that runs in this process, and its settings."""

    PANEL: ClassVar[str] = "Estimator"
    estimator: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", show_default="driftyard",
            help="driftyard, thesis, corner_flow, or module:Class of a plug-in.",
        ),
    ] = None  # fmt: skip
    overrides: Annotated[
        list[str],
        typer.Option(
            "--set", metavar="KEY=VALUE",
            help="Change a setting of `driftyard settings estimator`; may be repeated.",
        ),
    ] = field(default_factory=list[str])  # fmt: skip
    config: Annotated[
        Path | None, typer.Option(metavar="FILE", help="TOML file of estimator settings.")
    ] = None

    @property
    def named(self) -> "Named":
        """The estimator and its settings."""
        from trials.estimators.choice import Named

        return Named(self.estimator or "driftyard", self.config, tuple(self.overrides))


@dataclass(frozen=True)
class AnyEstimatorOptions(EstimatorOptions):
    """An estimator of any kind: in this process, or a program."""

    command: Annotated[
        str | None,
        typer.Option(
            metavar="CMD",
            help="Program instead of an estimator; its words include {dataset} and {out}. It "
            "writes the trajectory of the left camera, TUM format.",
        ),
    ] = None
    timeout: Annotated[
        float,
        typer.Option(min=0, metavar="SECONDS", help="Longest run time of the program, s."),
    ] = 3600.0
    label: Annotated[
        str,
        typer.Option(help="Name of the program in tables.", show_default="its file name"),
    ] = ""

    @property
    def choice(self) -> "Named | Command":
        """The estimator or program.

        Raises:
            SettingsError: If options of both are given, or the program lacks a placeholder.
        """
        if self.command is None:
            return self.named
        from trials.estimators.plugins.command import Command
        from vo.contract.errors import SettingsError

        if self.estimator or self.overrides or self.config:
            raise SettingsError("--command: takes no --estimator, --set or --config")
        return Command(self.command, self.timeout, self.label)


def expand(function: Callable[..., None]) -> Callable[..., None]:
    """Replace each parameter that is a dataclass by parameters for the fields of the dataclass.

    Typer then shows them as options, in a panel of their own if the class has a PANEL, and the
    function still receives instances.

    Args:
        function: Command; every parameter is annotated.
    """
    hints = get_type_hints(function, include_extras=True)
    models = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    parameters: list[Parameter] = []
    for parameter in signature(function).parameters.values():
        if parameter.name in models:
            parameters += _parameters_of(models[parameter.name])
        else:
            hint = hints[parameter.name]
            parameters.append(parameter.replace(annotation=hint, kind=Parameter.KEYWORD_ONLY))

    @functools.wraps(function)
    def call(**values: Any) -> None:
        for name, model in models.items():
            values[name] = model(**{x.name: values.pop(x.name) for x in fields(model)})
        function(**values)

    del call.__wrapped__  # pyright: ignore[reportAttributeAccessIssue], its parameters are others
    call.__annotations__ = {x.name: x.annotation for x in parameters}
    call.__dict__["__signature__"] = Signature(parameters)
    return call


def _parameters_of(model: Any) -> Iterator[Parameter]:
    hints = get_type_hints(model, include_extras=True)
    for x in fields(model):
        kind, shown = get_args(hints[x.name])
        panel = copy(shown)
        panel.rich_help_panel = getattr(model, "PANEL", None)
        yield Parameter(
            x.name, Parameter.KEYWORD_ONLY, default=_default(x), annotation=Annotated[kind, panel]
        )


def _default(option: "Field[Any]") -> Any:
    if option.default_factory is not MISSING:
        return option.default_factory()
    return Parameter.empty if option.default is MISSING else option.default
