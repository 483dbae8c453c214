"""Settings: frozen models from defaults, a TOML file and `--set a.b=c`; unknown keys are errors."""

import difflib
import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from vo.contract.errors import SettingsError
from vo.contract.files import read_lines


class Settings(BaseModel):
    """Base of every settings model: immutable, and an unknown key is an error.

    The docstring of a field is its description.

    Example:
        >>> class Gains(dy.Settings):
        ...     gain: float = 1.0
        >>> Gains(gain=2).gain
        2.0
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )

    renamed: ClassVar[Mapping[str, str]] = {}
    """Earlier names: key, group or `key=value` below this model to its new name; for a setting
    that was removed, a sentence that says why."""


S = TypeVar("S", bound=Settings)


def resolve(
    model: type[S],
    toml: Path | None = None,
    overrides: Sequence[str] = (),
    base: Mapping[str, Any] | None = None,
) -> S:
    """Build `model` from its defaults, `base`, a TOML file, then `key.path=value` overrides.

    `base` has values by `key.path` that differ from the model's own defaults.

    Raises:
        SettingsError: If the file is unreadable, or a key or value is not accepted; the
            message names the key and the valid ones.
    """
    values: dict[str, Any] = {}
    for key, value in (base or {}).items():
        _place(values, key, value)
    if toml:
        _merge(values, _read_toml(toml))
    for key, value in parse_overrides(overrides).items():
        _place(values, key, value)
    return validated(model, values)


def given_values(toml: Path | None = None, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """Return what a TOML file and overrides set, by `key.path`; raises as `resolve`."""
    values = _read_toml(toml) if toml else {}
    for key, value in parse_overrides(overrides).items():
        _place(values, key, value)
    return flattened(values)


def flattened(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested tables, whose keys may be a `key.path` too, as values by `key.path`."""
    nested: dict[str, Any] = {}
    for key, value in values.items():
        _place(nested, key, value)
    return {leaf: value_at(nested, leaf) for key in nested for leaf in _leaves(key, nested[key])}


def overrides_of(values: Mapping[str, Any]) -> tuple[str, ...]:
    """Write values, nested or by `key.path`, as the `key=value` that `parse_overrides` reads.

    Raises:
        SettingsError: If a value is none of a setting: None, or no text, number or list.
    """
    words: list[str] = []
    for key, value in flattened(values).items():
        plain = value.tolist() if hasattr(value, "tolist") else value  # of NumPy's numbers
        try:
            words.append(f"{key}={json.dumps(plain, ensure_ascii=False)}")
        except (TypeError, ValueError):
            plain = None
        if plain is None:
            raise SettingsError(f"settings: {key} is {value!r}; expected a text, number or list")
    return tuple(words)


def value_at(values: Mapping[str, Any], key: str) -> Any:
    """Return the value of nested tables at a `key.path`; KeyError if there is none."""
    for name in key.split("."):
        values = values[name]
    return values


def parse_overrides(overrides: Sequence[str], option: str = "--set") -> dict[str, Any]:
    """Parse `key=value` each; values as TOML writes them, anything else is a string.

    Raises:
        SettingsError: If an equals sign is missing; names the option.
    """
    values: dict[str, Any] = {}
    for override in overrides:
        key, equals, text = override.partition("=")
        if not equals:
            raise SettingsError(
                f"{option} {override}: expected key=value, for example rig.tilt_deg=20"
            )
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            value = text.strip()
        values[key.strip()] = value
    return values


def amended(settings: S, values: Mapping[str, Any]) -> S:
    """Return settings with some values, by `key.path`, replaced.

    Raises:
        SettingsError: If a key or value is not accepted.
    """
    content = settings.model_dump(exclude_unset=True)
    for key, value in values.items():
        _place(content, key, value)
    return validated(type(settings), content)


def with_defaults(settings: S, defaults: Mapping[str, Any]) -> S:
    """Return settings with other defaults, by `key.path`, for what was not set explicitly.

    Raises:
        SettingsError: If the settings are not accepted together.
    """
    content: dict[str, Any] = {}
    for key, value in defaults.items():
        _place(content, key, value)
    _merge(content, settings.model_dump(exclude_unset=True))
    return validated(type(settings), content)


def validated(model: type[S], content: Mapping[str, Any]) -> S:
    """Build settings from nested tables.

    Raises:
        SettingsError: If a key or value is not accepted; names the key and the valid ones.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise SettingsError(_explain(model, error)) from None


def keys(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Yield the dotted key of every setting of a model, groups resolved."""
    for name, field in model.model_fields.items():
        if group := group_of(field.annotation):
            yield from keys(group, f"{prefix}{name}.")
        else:
            yield prefix + name


def group_of(annotation: Any) -> type[BaseModel] | None:
    """Model of a group of settings; None for a single setting."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return None


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads("\n".join(read_lines(path, SettingsError)))
    except tomllib.TOMLDecodeError as error:
        raise SettingsError(f"{path}: not valid TOML ({error})") from None


def _place(values: dict[str, Any], key: str, value: Any) -> None:
    *parents, last = key.split(".")
    table: Any = values
    for name in parents:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise SettingsError(f"--set {key}: {name} is a value, not a group")
    table[last] = value


def _merge(values: dict[str, Any], over: Mapping[str, Any]) -> None:
    """Merge nested tables into others in place, leaf by leaf."""
    for key, value in over.items():
        if isinstance(value, dict) and isinstance(values.get(key), dict):
            _merge(values[key], value)
        else:
            values[key] = value


def _explain(model: type[BaseModel], error: ValidationError) -> str:
    first = error.errors()[0]
    key, value = ".".join(str(part) for part in first["loc"]), first["input"]
    if not key:  # a rule over several settings
        return f"setting {complaint(error)}"
    if first["type"] != "extra_forbidden":
        if first["type"] in ("model_type", "dict_type"):
            return f"setting {key}: is a group, got {value!r}; set {key}.NAME"
        now = _current_name(model, given := f"{key}={value}")
        hint = f"; {value} is now {now.partition('=')[2]}" if now != given else ""
        return f"setting {key}: {complaint(error)}{hint}"
    leaf = next(_leaves(key, value))
    if (now := _current_name(model, leaf)) != leaf:
        state = f"was removed: {now}" if " " in now else f"is now {now}"
        return f"setting {leaf} {state}"
    near = difflib.get_close_matches(key, list(keys(model)), n=3, cutoff=0.75)
    similar = f"; did you mean {' or '.join(near)}?" if near else ""
    valid = ", ".join(sorted(_model_at(model, first["loc"][:-1]).model_fields))
    return f"unknown setting {key}; valid here: {valid}{similar}"


def _current_name(model: type[BaseModel], name: str) -> str:
    """Follow the earlier names of models to today's; the name itself if it is none of them."""
    path = name.split(".") if "=" not in name else [*name.partition("=")[0].split(".")]
    end = name[len(".".join(path)) :]
    for depth in range(len(path)):
        known: Mapping[str, str] = getattr(_model_at(model, path[:depth]), "renamed", {})
        for length in range(len(path), depth, -1):
            rest = ".".join(path[length:])
            old = ".".join(path[depth:length]) + ("" if rest else end)
            if (new := known.get(old)) is not None:
                if " " in new:
                    return new
                above = ".".join(path[:depth])
                return _current_name(model, ".".join(x for x in (above, new, rest) if x))
    return name


def _model_at(model: type[BaseModel], path: Sequence[int | str]) -> type[BaseModel]:
    for name in path:
        field = model.model_fields.get(str(name))
        model = (field and group_of(field.annotation)) or BaseModel
    return model


def _leaves(key: str, value: Any) -> Iterator[str]:
    if not isinstance(value, dict) or not value:
        yield key
    else:
        for name, part in value.items():
            yield from _leaves(f"{key}.{name}", part)


def complaint(error: ValidationError) -> str:
    """Return why the first refused value is refused; a rule of our own states it in full."""
    first = error.errors()[0]
    if first["type"] == "value_error":
        return first["msg"].removeprefix("Value error, ")
    return f"{first['msg'].lower()}, got {first['input']!r}"
