"""Tables for the terminal, for Markdown and as CSV."""

import csv
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from rich.table import Table

from vo.contract.files import replacing

NUMBER = re.compile(r"[+-]?\d|[-–]$|nan$")
"""Start of a cell with a number, or the whole cell where there is none."""


def text_table(
    header: Sequence[str], rows: Iterable[Sequence[str]], title: str | None = None
) -> Table:
    """Lay out rows of text: the first column aligned left, all others right."""
    made = Table(*header, title=title, title_justify="left")
    for column in made.columns[1:]:
        column.justify = "right"
    for row in rows:
        made.add_row(*row)
    return made


def markdown_table(
    header: Sequence[str], rows: Sequence[Sequence[str]], align_numbers: bool = False
) -> str:
    """Lay out rows of text as Markdown; columns of numbers can be aligned right."""
    numeric = numeric_columns(rows) if align_numbers else [False] * len(header)
    rule = ["---:" if right else "---" for right in numeric]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, rule, *rows))


def latex_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay out rows of text as LaTeX, with the rules of booktabs."""
    lines = [" & ".join(map(_latex, cells)) + r" \\" for cells in (header, *rows)]
    columns = "l" + "r" * (len(header) - 1)
    body = [lines[0], r"\midrule", *lines[1:]]
    return "\n".join(
        [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", *body, r"\bottomrule", r"\end{tabular}"]
    )


def _latex(text: str) -> str:
    for letter in "&%_#$":
        text = text.replace(letter, "\\" + letter)
    return text.replace("°", r"$^\circ$").replace("–", "--")


def numeric_columns(rows: Sequence[Sequence[str]]) -> list[bool]:
    """Return for each column whether every cell is a number or has none."""
    return [all(map(NUMBER.match, cells)) for cells in zip(*rows, strict=True)]


def write_csv(out: Path, header: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
    """Write rows as CSV in one step."""
    with replacing(out) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(header)
        table.writerows(rows)
