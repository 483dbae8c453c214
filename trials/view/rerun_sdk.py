"""Names of the package rerun, which is imported when one is used: it is optional."""

from importlib import import_module
from typing import Any


def __getattr__(name: str) -> Any:
    return getattr(import_module("rerun"), name)
