"""Sections `Example:` of docstrings as Griffe parses them, which supports `Examples:` only."""

from typing import Any

import griffe


class Examples(griffe.Extension):
    """Gives the section the name that is rendered as code."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rename the section in the docstring of an object."""
        if obj.docstring:
            obj.docstring.value = obj.docstring.value.replace("\nExample:\n", "\nExamples:\n")
