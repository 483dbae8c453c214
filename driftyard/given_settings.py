"""Settings as users give them: values by name, or a TOML file."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vo.contract.settings import overrides_of

GivenSettings = Mapping[str, Any] | str | os.PathLike[str] | None
"""Values, nested or by `key.path`; the path of a TOML file; None for the defaults."""


def sources_of(settings: GivenSettings) -> tuple[Path | None, tuple[str, ...]]:
    """Return the TOML file and the `key=value` overrides, of which settings consist.

    Raises:
        SettingsError: If a value is none of a setting.
    """
    if settings is None:
        return None, ()
    if isinstance(settings, Mapping):
        return None, overrides_of(settings)
    return Path(settings), ()
