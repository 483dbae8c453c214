"""Commands in the documentation have the names and the options of the real command line."""

import re
import shlex
import tomllib
from itertools import chain, pairwise

import pytest
import typer
from documented import NOTEBOOKS, PAGES, blocks, commands
from terminal import ROOT

from sim.settings import RecordSettings
from trials.cli.doctor import BACKENDS, FILAMENT, PACKAGES
from trials.cli.registry import COMMANDS, load
from trials.gate.reports import HEADER
from vo.config import OdometrySettings
from vo.contract.settings import keys

OTHERS = {"git", "kubectl", "ssh", "docker", "dask", "apt-get", "rerun", "export", "unset", "["}
"""Programs that are not of this project, whose options are not checked."""
LANGUAGES = {"python", "sh", "text", "json", "toml", "xml", "yaml"}
INLINE = re.compile(r"`(driftyard [^`\n]+)`")
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
KEYS = {*keys(RecordSettings), *keys(OdometrySettings)}
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
SETTING = ("--set", "--record", "--vary")

every_page = pytest.mark.parametrize(
    "page", [*PAGES, *NOTEBOOKS], ids=lambda page: str(page.relative_to(ROOT))
)


@every_page
def test_blocks_name_their_language(page):
    assert [x.line for x in blocks(page) if x.language not in LANGUAGES] == []


@every_page
def test_commands_of_blocks_exist_with_their_options(page):
    for block in blocks(page):
        if block.language == "sh":
            found = list(commands(block.text))
        else:  # of a notebook
            shell = re.findall(r"^!(.*)$", block.text, re.MULTILINE)
            found = list(chain.from_iterable(map(commands, shell)))
        for words in found:
            check(words, bool(block.not_run))


@every_page
def test_commands_in_the_text_exist_with_their_options(page):
    """An inline command may leave out arguments; its name and its options are checked."""
    for code in INLINE.findall(page.read_text("utf-8")):
        words = re.split(r"\s", code)[1:]
        if words[0] == "COMMAND" or words[0].startswith("--"):
            continue
        name = command_name(words)
        assert name, f"`{code}`: no such command"
        given = {x.partition("=")[0] for x in words if x.startswith("--")}
        options = {x for parameter in load(name).params for x in [*parameter.opts, "--help"]}
        assert given <= options, f"`{code}`"


def check(words: list[str], is_not_run: bool) -> None:
    program, *rest = words
    if program == "driftyard":
        check_driftyard(rest)
    elif program == "make":
        assert {x for x in rest if "=" not in x} <= TARGETS, words
    elif program == "python":
        assert rest[0] == "-c" or (ROOT / rest[0]).is_file(), words
    elif program == "pip":
        named = re.findall(r"driftyard\[([\w,]+)\]", " ".join(rest))
        assert all(x in EXTRAS for group in named for x in group.split(",")), words
    else:
        assert program in OTHERS, words
        assert is_not_run or program in ("rerun", "export", "unset", "git", "["), words


def check_driftyard(words: list[str]) -> None:
    """Parse a command as the command line does, without running it."""
    if words in (["--version"], ["--help"]):
        return
    name = command_name(words)
    assert name, f"driftyard {shlex.join(words)}: no such command"
    try:
        command = load(name)
        context = command.make_context(name, words[len(name.split()) :])
    except typer.Exit:  # of --help
        return
    except Exception as error:  # of the library that is inside Typer
        pytest.fail(f"driftyard {shlex.join(words)}: {error}")
    if ":" in str(context.params.get("estimator", "")):
        return  # the settings are those of a plug-in
    for option, value in pairwise(words):
        if option in SETTING:
            key = value.partition("=")[0]
            assert key in KEYS or key.startswith("scene."), f"{option} {value}: no such setting"


def command_name(words: list[str]) -> str:
    """Return the name of the command that words begin with: of one or two of them."""
    return next((x for x in (" ".join(words[:2]), words[0]) if x in COMMANDS), "")


def test_check_finds_what_does_not_exist():
    for words in (
        ["driftyard", "record", "office"],
        ["driftyard", "generate", "office", "--sed", "3"],
        ["driftyard", "generate", "office", "--set", "rig.width=3"],
        ["driftyard", "generate", "office", "--count", "many"],
        ["make", "tests"],
        ["pip", "install", "driftyard[all]"],
        ["docker", "build"],
    ):
        with pytest.raises((AssertionError, pytest.fail.Exception)):
            check(words, is_not_run=False)


def test_output_of_doctor_has_the_rows_of_the_command():
    (shown,) = [x.text for x in blocks(ROOT / "docs/headless.md") if x.language == "text"]
    rows = [line.split()[0] for line in shown.splitlines()]
    assert rows == ["machine", "python", "driftyard", *PACKAGES, *BACKENDS, FILAMENT]


def test_output_of_the_gate_has_the_columns_of_the_command():
    shown = next(x.text for x in blocks(ROOT / "docs/gate.md") if x.language == "text")
    assert shown.splitlines()[0].split() == " ".join(HEADER).split()
