"""What objects show of themselves: text in a terminal, HTML in a notebook, tables of pandas."""

from collections.abc import Sequence
from html import escape
from types import ModuleType

from vo.contract.errors import DriftyardError


def text_display(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """Lay out a heading and a line for each name and value."""
    width = max((len(name) for name, _ in rows), default=0)
    return "\n".join([title, *(f"  {name:{width}}  {value}" for name, value in rows)])


def html_display(title: str, rows: Sequence[Sequence[str]], below: str = "") -> str:
    """Lay out a heading, rows of text whose first cell names the others, and markup below.

    The colours are those of the page, so that it is legible on light and on dark ones.
    """
    cells = "".join(
        f"<tr><th style='text-align: left'>{escape(name)}</th>"
        + "".join(f"<td style='text-align: right'>{escape(x)}</td>" for x in values)
        + "</tr>"
        for name, *values in rows
    )
    return f"<div><strong>{escape(title)}</strong><table>{cells}</table>{below}</div>"


def import_pandas() -> ModuleType:
    """Return pandas, which only tables need.

    Raises:
        DriftyardError: If it is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise DriftyardError("pandas is not installed; pip install pandas") from None
    return pd
