"""Options that commands share, as frozen dataclasses that `expand` turns into parameters."""

import functools
from collections.abc import Callable
from contextlib import ExitStack
from copy import copy
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, get_args, get_origin, get_type_hints

import typer

from sim.camera_names import DEFAULT_CAMERA
from trials.cli.completion import BY_PARAMETER, keys_of

if TYPE_CHECKING:
    from driftyard import Dataset as OpenDataset
    from sim.settings import RecordSettings
    from trials.estimators.choice import Named
    from trials.estimators.plugins.command import Command
    from vo.recordings.pairing import FrameSelection

SceneName = Annotated[
    str,
    typer.Argument(
        help="Registered scene (`driftyard scenes` lists them), MJCF file, or module:function."
    ),
]
Dataset = Annotated[
    Path,
    typer.Argument(
        help="Recording: folder of driftyard, EuRoC, TUM-VI, KITTI or TartanAir, or bag of ROS, "
        "RUN.bag or RUN.bag@left=TOPIC,right=TOPIC."
    ),
]
Trajectories = Annotated[
    list[Path],
    typer.Argument(metavar="FILE...", help="Trajectory files: TUM, EuRoC or KITTI format."),
]
Seed = Annotated[int, typer.Option(min=0, help="Random seed of scene, route and noise.")]
Scenes = Annotated[str, typer.Option(metavar="A,B,C", help="Names of scenes, or all.")]
Disturb = Annotated[
    str,
    typer.Option(
        metavar="NAME[=STRENGTH],...",
        help="Disturbances that `driftyard scenes` lists, such as blur,brick_bump=0.5.",
    ),
]
Camera = Annotated[
    str,
    typer.Option(
        metavar="NAME|FILE.toml",
        help="Camera: machine_vision, ideal, stoc, webcam, d435_infra, zed, or a TOML file of "
        "recording settings; other options take precedence.",
    ),
]
Distance = Annotated[float, typer.Option(min=1.2, help="Length of each drive, m.")]


def option(default: Any, text: str, *names: str, **rules: Any) -> Any:
    """Describe an option: default value of a parameter or dataclass field; `...` if required.

    The help names quantity and unit. Names are those on the command line if they are not that of
    the parameter, rules as of `typer.Option`.
    """
    return _described(default, typer.Option(*names, help=text, **rules))


def argument(default: Any, text: str, **rules: Any) -> Any:
    """Describe a positional argument; otherwise as `option`."""
    return _described(default, typer.Argument(help=text, **rules))


def changes(kind: str, name: str = "--set") -> Any:
    """Describe an option that changes settings of a kind; without a name, that of the field."""
    text = f"Change a setting of `driftyard settings {kind}`; may be repeated."
    names = filter(None, [name])
    return option([], text, *names, metavar="KEY=VALUE", autocompletion=keys_of(kind))


def _described(default: Any, shown: Any) -> Any:
    metadata = {"typer": shown}
    if default is ...:
        return field(metadata=metadata)
    if isinstance(default, list):
        return field(default_factory=default.copy, metadata=metadata)
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class RecordingOptions:
    """Settings of a recording."""

    PANEL: ClassVar[str] = "Recording"
    seed: int | None = option(None, "Random seed of scene, route and noise.", show_default="0")
    overrides: list[str] = changes("recording")
    config: Path | None = option(None, "TOML file of recording settings.", metavar="FILE")
    camera: Camera = DEFAULT_CAMERA
    disturb: Disturb = ""

    def settings(self, scene: str) -> "RecordSettings":
        """Resolve the settings of a recording of a scene, as `recording_settings`."""
        from trials.execution.recording_settings import recording_settings

        return recording_settings(
            scene, self.seed, self.overrides, self.config, self.disturb, self.camera
        )


@dataclass(frozen=True)
class EstimatorOptions:
    """An estimator that runs in this process, and its settings."""

    PANEL: ClassVar[str] = "Estimator"
    estimator: str | None = option(
        None,
        "driftyard, thesis, corner_flow, a name of `systems list`, or module:Class.",
        metavar="NAME",
        show_default="driftyard",
    )
    overrides: list[str] = changes("estimator")
    config: Path | None = option(None, "TOML file of estimator settings.", metavar="FILE")

    @property
    def named(self) -> "Named":
        """The estimator and its settings."""
        from trials.estimators.choice import Named

        return Named(self.estimator or "driftyard", self.config, tuple(self.overrides))


@dataclass(frozen=True)
class AnyEstimatorOptions(EstimatorOptions):
    """An estimator of any kind: in this process, or a program."""

    command: str | None = option(
        None,
        "Program instead: words with {dataset} and {out}. It writes the trajectory of the left "
        "camera, TUM format.",
        metavar="CMD",
    )
    timeout: float = option(3600.0, "Longest run time of the program, s.", min=0, metavar="SECONDS")
    label: str = option("", "Name of the program in tables.", show_default="its file name")

    @property
    def choice(self) -> "Named | Command":
        """The estimator or program; SettingsError if there are options of both."""
        if self.command is None:
            return self.named
        from trials.estimators.plugins.command import Command
        from vo.contract.errors import SettingsError

        if self.estimator or self.overrides or self.config:
            raise SettingsError("--command: takes no --estimator, --set or --config")
        return Command(self.command, self.timeout, self.label)


@dataclass(frozen=True)
class FrameOptions:
    """Frames of a recording that are used."""

    PANEL: ClassVar[str] = "Frames"
    first: int = option(0, "Index of the first frame, from 0.", min=0)
    last: int | None = option(None, "Index of the last frame.", show_default="last of all", min=0)
    every: int = option(1, "Use each k-th frame only.", min=1, metavar="K")
    skip_missing: bool = option(
        False, "Leave out frames whose images are missing, an error otherwise.", "--skip-missing"
    )
    pair_tolerance: float | None = option(
        None,
        "Largest difference of the times of left and right, ms.",
        show_default="3, or a quarter of the frame period",
        metavar="MS",
    )

    def open(self, folder: Path) -> "OpenDataset":
        """Open the selected frames of a dataset."""
        import driftyard

        return driftyard.open(
            folder,
            first=self.first,
            last=self.last,
            every=self.every,
            skip_missing=self.skip_missing,
            pair_tolerance_ms=self.pair_tolerance,
        )

    @property
    def selection(self) -> "FrameSelection":
        """The selection of frames."""
        from vo.recordings.pairing import FrameSelection

        return FrameSelection(
            self.first, self.last, self.every, self.skip_missing, self.pair_tolerance
        )


@dataclass(frozen=True)
class ViewerOptions:
    """Target of a view: window, file or address."""

    PANEL: ClassVar[str] = "Viewer"
    save: Path | None = option(
        None, "Write a file for `rerun FILE.rrd` instead of opening a window.", metavar="FILE.rrd"
    )
    connect: str | None = option(
        None, "Address of a viewer, as rerun+http://127.0.0.1:9876/proxy.", metavar="URL"
    )

    @property
    def to(self) -> Path | str | None:
        """The target of `driftyard.view`; SettingsError if there are two."""
        from vo.contract.errors import SettingsError

        if self.save and self.connect:
            raise SettingsError("--save and --connect: a view goes to one of both")
        if self.connect is not None and "://" not in self.connect:
            raise SettingsError(f"--connect {self.connect}: expected an address with ://")
        return self.connect or self.save


@dataclass(frozen=True)
class LiveViewOptions(ViewerOptions):
    """A view of what goes on."""

    view: bool = option(False, "Show each frame in Rerun's viewer as it is estimated.", "--view")

    @property
    def live(self) -> Path | str | bool:
        """The value of `view` of `driftyard.run`: --save and --connect imply --view."""
        to = self.to
        return self.view if to is None else to


def expand(function: Callable[..., None]) -> Callable[..., None]:
    """Write the parameters of a command as Typer reads them.

    A parameter that is a dataclass becomes one parameter for each field, in a panel of its own if
    the class has a PANEL; the function still receives an instance. What has a
    method `using` is a context around the function.
    """
    hints = get_type_hints(function, include_extras=True)
    models: dict[str, Any] = {name: hint for name, hint in hints.items() if is_dataclass(hint)}
    parameters: list[Parameter] = []
    for x in signature(function).parameters.values():
        if x.name in models:
            model = models[x.name]
            kinds = get_type_hints(model, include_extras=True)
            panel = getattr(model, "PANEL", None)
            parameters += [_parameter(f.name, kinds[f.name], f, panel) for f in fields(model)]
        else:
            parameters.append(_parameter(x.name, hints[x.name], x.default, None))

    @functools.wraps(function)
    def call(**values: Any) -> None:
        for name, model in models.items():
            values[name] = model(**{f.name: values.pop(f.name) for f in fields(model)})
        with ExitStack() as stack:
            for value in values.values():
                if hasattr(value, "using"):
                    stack.enter_context(value.using())
            function(**values)

    del call.__wrapped__  # its parameters are others
    call.__annotations__ = {x.name: x.annotation for x in parameters}
    call.__dict__["__signature__"] = Signature(parameters)
    return call


def _parameter(name: str, kind: Any, default: Any, panel: str | None) -> Parameter:
    """Make a parameter of an annotated type, from a default value or a described one."""
    if isinstance(default, Field) and "typer" in default.metadata:
        kind = Annotated[kind, default.metadata["typer"]]
    if get_origin(kind) is Annotated:
        base, shown = get_args(kind)
        shown = copy(shown)
        shown.rich_help_panel = panel
        shown.autocompletion = shown.autocompletion or BY_PARAMETER.get(name)
        kind = Annotated[base, shown]
    if isinstance(default, Field):
        if default.default_factory is not MISSING:
            default = default.default_factory()
        else:
            default = Parameter.empty if default.default is MISSING else default.default
    return Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=kind)
