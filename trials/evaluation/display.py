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

    The colours are those of the page, so that it is legible on light and on dark ones. Numbers end
    below each other; a column of texts starts so.
    """
    has_texts = all(len(row) == 2 for row in rows) and not all(is_number(x) for _, x in rows)
    side = "left" if has_texts else "right"
    cells = "".join(
        f"<tr><th style='text-align: left'>{escape(name)}</th>"
        + "".join(f"<td style='text-align: {side}'>{escape(x)}</td>" for x in values)
        + "</tr>"
        for name, *values in rows
    )
    table = f"<table style='margin: 4px 0 8px'>{cells}</table>"
    return f"<div><strong>{escape(title)}</strong>{table}{below}</div>"


def is_number(text: str) -> bool:
    """Whether a cell is a number, or the dash in the place of one."""
    return text == "–" or text.replace(".", "", 1).removeprefix("-").isdigit()


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
