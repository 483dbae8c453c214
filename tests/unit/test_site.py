"""The site: every page is in its navigation, every public name in its reference."""

import re
from collections.abc import Iterator
from typing import Any

import yaml
from terminal import ROOT

import driftyard as dy

DOCS = ROOT / "docs"
SITE = yaml.safe_load((ROOT / "mkdocs.yml").read_text("utf-8"))
MADE = {"changelog.md", "commands.md", "contributing.md"}
"""Pages that docs/site.py makes."""


def pages(part: Any) -> Iterator[str]:
    """Give the pages of a part of the navigation."""
    if isinstance(part, str):
        yield part
    else:
        for inner in part.values() if isinstance(part, dict) else part:
            yield from pages(inner)


def test_navigation_has_every_page_once():
    listed = list(pages(SITE["nav"]))
    assert len(set(listed)) == len(listed)
    written = {str(x.relative_to(DOCS)) for x in DOCS.glob("**/*.md")}
    notebooks = {str(x.relative_to(DOCS).with_suffix(".md")) for x in DOCS.glob("**/*.ipynb")}
    unlisted = {x for x in written if re.match(r"decisions/0", x)}  # decisions/README.md links them
    assert set(listed) == written - unlisted | notebooks | MADE


def test_reference_has_every_public_name_once():
    text = "".join(x.read_text("utf-8") for x in sorted(DOCS.glob("reference/*.md")))
    named = re.findall(r"^::: driftyard\.(\w+)", text, re.MULTILINE)
    assert sorted(named) == sorted({*dy.__all__, "torch"} - {"__version__"})
