"""Tables of a notebook: what an object shows as HTML."""

from collections.abc import Sequence
from html import escape


def html_table(title: str, rows: Sequence[Sequence[str]], below: str = "") -> str:
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
