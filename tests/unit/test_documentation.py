"""Links and paths in the documentation lead somewhere."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
SOURCE = re.compile(r"`((?:driftyard|scenes|sim|vo|trials|tests)/[\w/.]*)`")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_documentation_links_exist(page):
    links = [x for x in LINK.findall(page.read_text("utf-8")) if "://" not in x]
    missing = [x for x in links if not (page.parent / x).exists()]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_documentation_source_paths_exist(page):
    named = SOURCE.findall(page.read_text("utf-8"))
    missing = [x for x in named if not (ROOT / x).exists()]
    assert not missing
