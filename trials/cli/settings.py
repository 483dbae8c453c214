"""`driftyard settings`: every setting with type, default, unit, range and description."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import annotated_types
import typer
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from sim.settings import RecordSettings
from trials.cli import console
from trials.cli.options import argument, option
from trials.gym.env.settings import NavSettings
from trials.navigation.settings import NavigatorSettings
from vo.config import OdometrySettings
from vo.contract.errors import SettingsError
from vo.contract.files import write_text
from vo.contract.settings import group_of


class Kind(StrEnum):
    """Kinds of settings that can be listed."""

    ESTIMATOR = "estimator"
    RECORDING = "recording"
    NAVIGATION = "navigation"
    NAVIGATOR = "navigator"


MODELS: dict[Kind, tuple[type[BaseModel], str]] = {
    Kind.ESTIMATOR: (
        OdometrySettings,
        "Estimator `driftyard`, and `thesis` with other defaults: "
        "`driftyard run --set KEY=VALUE`, or a TOML file with `--config`.",
    ),
    Kind.RECORDING: (
        RecordSettings,
        "Recordings: `driftyard generate --set KEY=VALUE`, or a TOML file with `--config`. "
        "These are the defaults of `--camera ideal`; other cameras, `machine_vision` by default, "
        "and scenes have their own.",
    ),
    Kind.NAVIGATION: (
        NavSettings,
        "Navigation trials: `driftyard drive --trial KEY=VALUE`, or keywords of `gymnasium.make`.",
    ),
    Kind.NAVIGATOR: (
        NavigatorSettings,
        "The navigator that drives the trials: argument of `NavigatorPolicy`.",
    ),
}
"""Kind to its model, and where its settings are given."""

UNITS = {
    "px": "px", "m": "m", "mm": "mm", "deg": "°", "rad": "rad", "s": "s", "ms": "ms", "us": "µs",
    "hz": "Hz", "mps": "m/s", "mps2": "m/s²", "radps": "rad/s", "degps": "°/s", "rad_s": "rad/s",
    "grey": "grey levels", "percent": "%", "frames": "frames", "keyframes": "keyframes", "kg": "kg",
    "n": "N", "g": "g", "dps": "°/s", "ratio": "ratio", "share": "ratio", "scale": "factor",
}  # fmt: skip
"""Suffix of a key to its unit."""
BOUNDS = (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤"))


@dataclass(frozen=True)
class Row:
    """One setting: dotted key, type or choices, default as TOML, unit, allowed range and text."""

    key: str
    type: str
    default: str
    unit: str
    range: str
    description: str


def settings(
    kind: Kind | None = argument(None, "Kind of settings; all kinds by default."),
    prefix: str = argument("", "List only keys that begin like this, such as matching."),
    as_json: bool = option(False, "Print as JSON.", "--json"),
    markdown: Path | None = option(None, "Write a Markdown page.", metavar="FILE"),
) -> None:
    """List settings with type, default, unit, range and description."""
    kinds = [kind] if kind else list(Kind)
    found = {x: [r for r in rows(MODELS[x][0]) if r.key.startswith(prefix)] for x in kinds}
    if not any(found.values()):
        raise SettingsError(f"no setting begins with {prefix}; `driftyard settings` lists all")
    if markdown:
        write_text(markdown, page(found))
        console.out.print(f"{markdown}")
    elif as_json:
        content = {x.value: [asdict(r) for r in some] for x, some in found.items()}
        typer.echo(json.dumps(content, indent=1, ensure_ascii=False))
    else:
        for x, some in found.items():
            if some:
                _print(x, some)


def rows(model: type[BaseModel], prefix: str = "", base: BaseModel | None = None) -> Iterator[Row]:
    """List the settings of a model, groups resolved; an instance may replace the defaults."""
    for name, field in model.model_fields.items():
        group, default = group_of(field.annotation), _default(field)
        if base is not None:
            default = getattr(base, name)
        if group is not None:
            inner = default if isinstance(default, BaseModel) else None
            yield from rows(group, f"{prefix}{name}.", inner)
            continue
        shown = " ".join((field.description or "").split())
        yield Row(
            prefix + name, _type(field.annotation), _toml(default), _unit(name), _range(field),
            shown[:1].upper() + shown[1:],
        )  # fmt: skip


def page(found: dict[Kind, list[Row]]) -> str:
    """Markdown page of all settings."""
    lines = [
        "# Settings", "",
        "This page is generated: `driftyard settings --markdown docs/settings.md`. The same is "
        "printed by `driftyard settings [KIND] [PREFIX]`. Units follow from the suffix of a key.",
    ]  # fmt: skip
    for kind, some in found.items():
        lines += ["", f"## {kind.value.capitalize()}", "", MODELS[kind][1], "", *table(some)]
    return "\n".join(lines) + "\n"


def table(some: Iterable[Row]) -> Iterator[str]:
    """Lines of a Markdown table of settings."""
    yield "| Key | Type | Default | Unit | Range | Description |"
    yield "|---" * 6 + "|"
    for x in some:
        cells = (f"`{x.key}`", x.type, f"`{x.default}`" if x.default else "", x.unit, x.range)
        text = (cell.replace("|", "\\|") for cell in (*cells, x.description))
        yield f"| {' | '.join(text)} |"


def _print(kind: Kind, some: Sequence[Row]) -> None:
    """Print two lines a setting, which fit a narrow terminal."""
    console.out.print(f"[bold]{kind.value}[/]: {MODELS[kind][1]}")
    for x in some:
        unit = f" {x.unit}" if x.unit else ""
        bounds = f"; {x.range}" if x.range else ""
        console.out.print(f"[bold cyan]{x.key}[/] = {x.default or 'none'}", end="", highlight=False)
        console.out.print(f"  ({x.type}{unit}{bounds})", markup=False, style="dim")
        if x.description:
            console.wrapped.print(f"    {x.description}", markup=False)
    console.out.print()


def _default(field: FieldInfo) -> Any:
    default = field.get_default(call_default_factory=True)
    return None if default is PydanticUndefined else default


def _type(annotation: Any) -> str:
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return " | ".join(map(str, parts))
    if origin in (Union, UnionType):
        return " | ".join("none" if x is type(None) else _type(x) for x in parts)
    if origin is Annotated:
        return _type(parts[0])
    if origin in (tuple, list):
        return f"list of {_type(parts[0])}"
    if origin is not None:
        return "table"
    name = str(annotation.__name__)
    return {"str": "text", "bool": "true | false", "Path": "file"}.get(name, name)


def _toml(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(_toml(x) for x in value)}]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {_toml(x)}" for key, x in value.items()) + "}"
    return json.dumps(value) if isinstance(value, bool | str) else str(value)


def _unit(name: str) -> str:
    for suffix in sorted(UNITS, key=len, reverse=True):
        if name.endswith(f"_{suffix}"):
            return UNITS[suffix]
    return ""


def _range(field: FieldInfo) -> str:
    found = {
        word: f"{sign} {getattr(rule, word):g}"
        for rule in field.metadata
        for word, sign in BOUNDS
        if isinstance(rule, annotated_types.BaseMetadata) and hasattr(rule, word)
    }
    return ", ".join(found.values())
