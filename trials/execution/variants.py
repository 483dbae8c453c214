"""Variants of estimators that are compared: parsed from the command line, repeated by seed."""

import shlex
from collections.abc import Sequence
from dataclasses import replace

from trials.estimators.choice import accepts, check_settings
from trials.estimators.systems.environments import SYSTEMS
from trials.execution.jobs import Variant
from vo.contract.errors import SettingsError


def named_variant(words: str, option: str = "--against") -> Variant:
    """Parse an estimator and its settings, separated as in a shell.

    The label is the name of a class, or all words for an estimator that has a name.

    Raises:
        SettingsError: If a quotation is not closed; names the option.
    """
    try:
        name, *overrides = shlex.split(words) or [""]
    except ValueError as error:
        raise SettingsError(f"{option} {words}: {error}") from None
    return Variant(name.rpartition(":")[2] if ":" in name else words, name, tuple(overrides))


def parse_estimators(texts: Sequence[str], option: str = "--estimator") -> list[Variant]:
    """Parse texts, each names `a,b`, or one estimator and its settings, `NAME KEY=VALUE ...`.

    A name without its settings is the label where no other variant has the same one.

    Raises:
        SettingsError: If there is no such estimator, or it refuses a setting.
    """
    words = [x for text in texts for x in ([text] if " " in text.strip() else text.split(","))]
    found = list(dict.fromkeys(named_variant(x.strip(), option) for x in words if x.strip()))
    if not found:
        raise SettingsError(f"{option}: names no estimator")
    names = [x.estimator for x in found]
    for x in found:
        check_settings(x.estimator, x.overrides)
    return [
        replace(x, label=x.estimator)
        if ":" not in x.estimator and names.count(x.estimator) == 1
        else x
        for x in found
    ]


def repeated(variant: Variant, count: int) -> tuple[Variant, ...]:
    """Repeat a variant: one for each seed of RANSAC, or for each run of a system that varies.

    What has neither a setting `seed` nor results that vary from run to run is not repeated.
    """
    if any(x.startswith("seed=") for x in variant.overrides):
        return (variant,)
    if accepts(variant.estimator, (*variant.overrides, "seed=1")):
        return tuple(
            replace(variant, overrides=(*variant.overrides, f"seed={k}")) for k in range(count)
        )
    system = SYSTEMS.get(variant.estimator)
    if system is None or system.is_deterministic:
        return (variant,)
    return tuple(replace(variant, repeat=k) for k in range(count))
