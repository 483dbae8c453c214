"""A whole study as one HTML page that needs no other file: verdicts first, then every figure."""

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from vo.contract.files import write_text

TEMPLATE = "study.html.j2"
FIGURE = re.compile(r"[+-]?\d|[-–]$|nan$")
"""What a cell with a figure, or with none to show, begins with."""
Mood = Literal["good", "mixed", "bad", "open"]


@dataclass(frozen=True)
class Part:
    """One question of a study and its answer.

    Attributes:
        id: Short; its anchor on the page.
        title: In a few words.
        claim: What is tested.
        source: Where the claim is from; may be empty.
        setup: What was done.
        verdict: In a word or three.
        mood: Colour of the verdict.
        sentence: The answer.
        figure: PNG file.
        caption: What it shows.
        data: CSV files behind the figure.
        columns: Headings of the table.
        rows: Its cells.
    """

    id: str
    title: str
    claim: str
    source: str
    setup: str
    verdict: str
    mood: Mood
    sentence: str
    figure: Path
    caption: str
    data: tuple[Path, ...]
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def write_study(title: str, introduction: str, parts: Sequence[Part], out: Path) -> None:
    """Write the page; figures and their data are inside it.

    Args:
        title: Of the page.
        introduction: A paragraph; here as in the parts, what is between backticks is code.
        parts: In the order of the page.
        out: File to write.
    """
    environment = Environment(
        loader=PackageLoader("trials.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["code"] = _with_code
    shown = [
        {
            **vars(part),
            "figure_uri": _uri(part.figure, "image/png"),
            "data": [(file.name, _uri(file, "text/csv")) for file in part.data],
            "align": _alignment(part),
        }
        for part in parts
    ]
    page = environment.get_template(TEMPLATE).render(
        title=title, introduction=introduction, parts=shown
    )
    write_text(out, page)


def _with_code(text: str) -> Markup:
    """Escape text, and mark up as code what is between backticks."""
    return Markup(re.sub(r"`([^`]*)`", r"<code>\1</code>", str(escape(text))))


def _alignment(part: Part) -> list[Markup]:
    """An attribute for each column: figures to the right, text to the left."""
    text = Markup(' class="text"')
    columns = [[row[k] for row in part.rows] for k in range(len(part.columns))]
    return [Markup() if all(map(FIGURE.match, cells)) else text for cells in columns]


def _uri(file: Path, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(file.read_bytes()).decode('ascii')}"
