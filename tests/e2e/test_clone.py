"""A clone holds everything: no file that a command needs was left uncommitted."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from terminal import ROOT

from trials.cli.registry import PANELS

pytestmark = [
    pytest.mark.gl,
    pytest.mark.slow,
    pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a git checkout"),
]


@pytest.fixture(scope="module")
def clone(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("clone") / "driftyard"
    subprocess.run(["git", "clone", "--quiet", ROOT, folder], check=True, timeout=60)
    take_machine_code(folder)
    return folder


def take_machine_code(clone: Path) -> None:
    """Copy machine code, which is known by what it was made from, not by age or place."""
    for package in ("driftyard", "scenes", "sim", "vo", "trials"):
        for file in (ROOT / package).rglob("__pycache__/*.nb?"):
            copied = clone / file.relative_to(ROOT)
            copied.parent.mkdir(exist_ok=True)
            shutil.copy(file, copied)


def in_clone(clone: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run Python on the clone's packages, with the dependencies of this environment."""
    return subprocess.run(
        [sys.executable, *words],
        cwd=clone,
        env={**os.environ, "PYTHONPATH": str(clone)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def test_the_packages_are_the_clones_own(clone):
    code = "import scenes, sim, vo, trials; print(*(m.__file__ for m in (scenes, sim, vo, trials)))"
    result = in_clone(clone, "-c", code)
    assert result.returncode == 0, result.stderr
    assert all(path.startswith(str(clone)) for path in result.stdout.split())


def test_demo_runs_from_a_clone(clone):
    result = in_clone(clone, "-m", "trials.cli", "demo", "--distance", "0.3")
    assert result.returncode == 0, result.stderr
    page = clone / "demo" / "report.html"
    assert result.stdout.splitlines()[-1] == page.resolve().as_uri()
    assert page.read_text().count("<svg") > 2
    status = subprocess.run(
        ["git", "status", "--porcelain"], cwd=clone, capture_output=True, text=True, check=True
    )
    assert status.stdout == ""  # results are ignored by git


def test_make_help_lists_all_targets(clone):
    result = make(clone, "help")
    named = {line.split()[1] for line in result.stdout.splitlines()}
    studies = {"bench", "accuracy", "scenes", "label-accuracy", "response", "bump", "replanning"}
    studies |= {"routing", "gate", "gate-power", "experiments", "explain"}
    pages = {"docs", "docs-serve", "notebooks"}
    assert named == {"demo", "check", "test", "lint", "clean", "help", *pages, *studies}
    makefile = (clone / "Makefile").read_text()
    phony = set(re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)[1].split())
    assert phony == named | {"unit", "suite"}  # which are parts of check and test


def test_make_targets_call_existing_commands(clone):
    known = {name for panel in PANELS.values() for name in panel}
    for target in ("demo", "bench", "label-accuracy", "gate", "gate-power", "explain"):
        command = make(clone, "--dry-run", target).stdout.replace("\\\n", "").splitlines()[-1]
        words = command.partition("bin/driftyard ")[2].split()
        assert words[0] in known, command
        assert words[0] != "gate" or " ".join(words[:2]) in known, command


def make(clone: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["make", "--no-print-directory", *words],
        cwd=clone,
        capture_output=True,
        text=True,
        check=True,
        timeout=30,
    )


def test_setup_says_what_to_do_without_python(clone):
    result = subprocess.run(
        ["sh", ".ci/setup", "nowhere"],
        cwd=clone,
        env={**os.environ, "PYTHON": "python-that-is-not-there"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 1
    assert "sudo apt-get install python3" in result.stderr
    assert not (clone / "nowhere").exists()
