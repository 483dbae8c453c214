"""What works in a clone: the demo, the targets of make, and the setup."""

import os
import re
import subprocess
from importlib import import_module

import pytest
from gym_worlds import write_yard
from terminal import ROOT, driftyard

from trials.cli.registry import PANELS

PACKAGES = ("driftyard", "scenes", "sim", "vo", "trials")


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a git checkout")
def test_no_file_of_the_packages_is_ignored_by_git():
    """It would be in no clone. Results are ignored."""
    ignored = git("ls-files", "--others", "--ignored", "--exclude-standard", *PACKAGES)
    assert [x for x in ignored if "/__pycache__/" not in x] == []
    results = ["demo/report.html", "build/cache"]
    assert git("check-ignore", *results) == results


def git(*words: str) -> list[str]:
    command = ["git", *words]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.splitlines()


@pytest.mark.gl
@pytest.mark.slow
def test_demo_records_estimates_and_reports(tmp_path, monkeypatch):
    """In a yard, which is built in no time."""
    monkeypatch.setattr(import_module("trials.cli.demo"), "SCENE", write_yard(tmp_path).name)
    result = driftyard("demo", "--distance", "0.2", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    page = tmp_path / "demo" / "report.html"
    assert result.stdout.splitlines()[-1] == page.resolve().as_uri()
    assert page.read_text().count("<svg") > 2


def test_make_help_lists_all_targets():
    result = make("help")
    named = {line.split()[1] for line in result.stdout.splitlines()}
    studies = {"bench", "accuracy", "scenes", "label-accuracy", "response", "bump", "replanning"}
    studies |= {"routing", "traffic", "cloud", "gate", "gate-power", "experiments", "explain"}
    pages = {"docs", "docs-serve", "notebooks"}
    assert named == {"demo", "check", "test", "lint", "clean", "help", *pages, *studies}
    makefile = (ROOT / "Makefile").read_text()
    phony = set(re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)[1].split())
    assert phony == named | {"unit", "suite"}  # which are parts of check and test


def test_make_targets_call_existing_commands():
    known = {name for panel in PANELS.values() for name in panel}
    for target in ("demo", "bench", "label-accuracy", "gate", "gate-power", "explain"):
        command = make("--dry-run", target).stdout.replace("\\\n", "").splitlines()[-1]
        words = command.partition("bin/driftyard ")[2].split()
        assert words[0] in known, command
        assert words[0] != "gate" or " ".join(words[:2]) in known, command


def make(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["make", "--no-print-directory", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=30,
    )


def test_setup_says_what_to_do_without_python(tmp_path):
    result = subprocess.run(
        ["sh", ROOT / ".ci/setup", "nowhere"],
        cwd=tmp_path,
        env={**os.environ, "PYTHON": "python-that-is-not-there"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 1
    assert "sudo apt-get install python3" in result.stderr
    assert not (tmp_path / "nowhere").exists()
