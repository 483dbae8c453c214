"""Settings: frozen models from defaults, a TOML file and `--set a.b=c`, unknown keys refused."""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from vo.contract.errors import SettingsError


class Settings(BaseModel):
    """Base of every settings model: immutable, and an unknown key is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


S = TypeVar("S", bound=Settings)


def resolve(
    model: type[S],
    toml: Path | None = None,
    overrides: Sequence[str] = (),
    base: Mapping[str, Any] | None = None,
) -> S:
    """Build `model` from its defaults, `base`, a TOML file, then `key.path=value` overrides.

    Args:
        model: What to build.
        toml: File of settings.
        overrides: As on the command line.
        base: Values by `key.path` that differ from the model's own defaults.

    Raises:
        SettingsError: If the file is unreadable, or a key or value is not accepted; the
            message names the key and the valid ones.
    """
    values: dict[str, Any] = {}
    for key, value in (base or {}).items():
        _place(values, key, value)
    if toml:
        _merge(values, _read_toml(toml))
    for override in overrides:
        key, equals, text = override.partition("=")
        if not equals:
            raise SettingsError(
                f"--set {override}: expected key=value, for example rig.tilt_deg=20"
            )
        _assign(values, key.strip(), text.strip())
    return validated(model, values)


def amended(settings: S, values: Mapping[str, Any]) -> S:
    """Return settings with some values, by `key.path`, replaced.

    Raises:
        SettingsError: If a key or value is not accepted.
    """
    content = settings.model_dump()
    for key, value in values.items():
        _place(content, key, value)
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


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path}: not valid TOML ({error})") from None


def _assign(values: dict[str, Any], key: str, text: str) -> None:
    try:  # numbers, booleans and lists as TOML writes them; anything else is a string
        _place(values, key, tomllib.loads(f"value = {text}")["value"])
    except tomllib.TOMLDecodeError:
        _place(values, key, text)


def _place(values: dict[str, Any], key: str, value: Any) -> None:
    *parents, last = key.split(".")
    table: Any = values
    for name in parents:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            raise SettingsError(f"--set {key}: {name} is a value, not a group")
    table[last] = value


def _merge(values: dict[str, Any], over: Mapping[str, Any]) -> None:
    """Lay nested tables over others in place, leaf by leaf."""
    for key, value in over.items():
        if isinstance(value, dict) and isinstance(values.get(key), dict):
            _merge(values[key], value)
        else:
            values[key] = value


def _explain(model: type[BaseModel], error: ValidationError) -> str:
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"])
    if not key:  # a rule over several settings
        return f"setting {complaint(error)}"
    if first["type"] != "extra_forbidden":
        return f"setting {key}: {complaint(error)}"
    valid = ", ".join(sorted(_fields_at(model, first["loc"][:-1])))
    return f"unknown setting {key}; valid here: {valid}"


def complaint(error: ValidationError) -> str:
    """What is wrong with the first value that was refused; rules of our own say it all."""
    first = error.errors()[0]
    if first["type"] == "value_error":
        return first["msg"].removeprefix("Value error, ")
    return f"{first['msg'].lower()}, got {first['input']!r}"


def _fields_at(model: type[BaseModel], path: Sequence[int | str]) -> Mapping[str, Any]:
    for name in path:
        annotation = model.model_fields[str(name)].annotation
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return {}
        model = annotation
    return model.model_fields
