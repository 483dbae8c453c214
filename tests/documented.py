"""Blocks of code in the documentation, and the commands in them."""

import json
import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from terminal import ROOT

PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
NOTEBOOKS = sorted(ROOT.glob("docs/notebooks/*.ipynb"))
FENCE = re.compile(
    r"(?:<!-- (?P<mark>not run|needs): (?P<why>[^>]*?) -->\n)?"
    r"^```(?P<language>[^\n]*)\n(?P<text>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)
FILE = re.compile(r"`([\w.]+\.(?:py|xml|toml))`[^`\n]*\n\n\Z")


@dataclass(frozen=True)
class Block:
    """A fenced block: where it stands, its language, and what a comment before it says.

    Attributes:
        not_run: Why it cannot run here; empty if it can.
        needs: Module without which it is skipped; empty if there is none.
        file: The file that it is, which the line before it names; empty if it is none.
    """

    page: Path
    line: int
    language: str
    text: str
    not_run: str = ""
    needs: str = ""
    file: str = ""


def blocks(page: Path) -> list[Block]:
    """Return the blocks of a Markdown page, or the code cells of a notebook, in order."""
    if page.suffix == ".ipynb":
        cells = json.loads(page.read_text("utf-8"))["cells"]
        texts = [(x["cell_type"], "".join(x["source"])) for x in cells]
        return [_cell(page, k, text) for k, (kind, text) in enumerate(texts) if kind == "code"]
    text = page.read_text("utf-8")
    found = []
    for match in FENCE.finditer(text):
        mark, why = match["mark"], match["why"] or ""
        line = text.count("\n", 0, match.start("text")) + 1
        marks = (why if mark == "not run" else "", why if mark == "needs" else "")
        named = FILE.search(text[: match.start()])
        file = named[1] if named else ""
        found.append(Block(page, line, match["language"], match["text"], *marks, file))
    return found


def _cell(page: Path, k: int, text: str) -> Block:
    first, _, rest = text.partition("\n")
    if first.startswith("%%writefile "):
        return Block(page, k, "python", rest, file=first.split()[1])
    return Block(page, k, "python", text)


def commands(text: str) -> Iterator[list[str]]:
    """Give the commands of a shell block as words, without comments and redirections."""
    for line in text.replace("\\\n", " ").splitlines():
        words: list[str] = []
        lexer = shlex.shlex(line, posix=True, punctuation_chars="|&;>")
        lexer.whitespace_split = True
        for word in lexer:
            if word == ">":
                next(lexer)
                if words[-1:] == ["2"]:
                    words.pop()
            elif set(word) <= set("|&;"):
                yield words
                words = []
            else:
                words.append(word)
        if words:
            yield words
