"""Tables of text for the terminal."""

from collections.abc import Iterable, Sequence

from rich.table import Table


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
