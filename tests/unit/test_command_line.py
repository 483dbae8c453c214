"""Commands: registry, expansion of dataclasses into options, and help texts."""

import shlex
from dataclasses import dataclass
from typing import Annotated, ClassVar

import pytest
import typer
from typer.testing import CliRunner

from trials.cli.main import app, guard
from trials.cli.options import expand, option
from trials.cli.registry import COMMANDS, GROUPS, load


@dataclass(frozen=True)
class Given:
    PANEL: ClassVar[str] = "Group"
    required: int = option(..., "A number.")
    words: list[str] = option([], "Words.", "--word")  # noqa: RUF009


def test_expand_dataclass_gives_options_and_an_instance():
    seen = []

    def command(name: Annotated[str, typer.Argument()], given: Given) -> None:
        seen.append((name, given))

    single = typer.Typer()
    single.command()(expand(command))
    runner = CliRunner()
    assert runner.invoke(single, ["a", "--required", "3", "--word", "x"]).exit_code == 0
    assert runner.invoke(single, ["b", "--required", "4"]).exit_code == 0
    assert seen == [("a", Given(3, ["x"])), ("b", Given(4, []))]
    assert runner.invoke(single, ["a"]).exit_code == 2
    assert "Group" in runner.invoke(single, ["--help"]).stdout


@pytest.mark.parametrize("name", [x for x in COMMANDS if x not in GROUPS])
def test_command_help_shows_its_example_and_every_option(name):
    command = load(name)
    assert COMMANDS[name].example in command.epilog
    words = shlex.split(COMMANDS[name].example)[1:]
    assert words[: len(name.split())] == name.split()
    context = command.make_context(name, words[len(name.split()) :], resilient_parsing=True)
    assert not context.args
    for parameter in command.params:
        assert parameter.help[:1].isupper() or parameter.name == "estimator", parameter.name


@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_help_of_command_shows_its_example_in_80_columns(name):
    result = CliRunner().invoke(app, [*name.split(), "--help"])
    assert result.exit_code == 0
    assert f"Example: driftyard {name}".rstrip() in result.stdout
    assert all(len(line) <= 80 for line in result.stdout.splitlines())


def test_help_lists_every_command():
    listed = CliRunner().invoke(app, ["--help"]).stdout
    assert all(f" {name} " in listed for name in COMMANDS if " " not in name)


def test_guard_interruption_inside_compiled_code_is_one_line(capsys):
    """Numba turns it into SystemErrors, one after the other, whose cause it is."""

    def command():
        inner = SystemError("_numba_unpickle returned a result with an exception set")
        inner.__cause__ = KeyboardInterrupt()
        raise SystemError("CPUDispatcher returned a result with an exception set") from inner

    with pytest.raises(SystemExit, match="130"):
        guard(command)
    assert capsys.readouterr().err == "driftyard: interrupted\n"


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        (["gener"], {"generate"}),
        (["gate", "pl"], {"plan"}),
        (["generate", "off"], {"office"}),
        (["generate", "office,cor"], {"office,corridor"}),
        (["generate", "--dis"], {"--disturb"}),
        (["generate", "--disturb", "blur,brick"], {"blur,brick_bump"}),
        (["generate", "--set", "drive.dist"], {"drive.distance_m="}),
        (["run", "ds", "--set", "matching.min_zn"], {"matching.min_zncc="}),
        (["run", "ds", "--estimator", "corner"], {"corner_flow"}),
        (["export", "ds", "--to", "kitti"], {"kitti", "kitti_stereo"}),
        (["stress", "--scene", "dus"], {"dusk"}),
    ],
)
def test_shell_completes_commands_and_values(words, completed):
    line = " ".join(["driftyard", *words])
    asked = {"_DRIFTYARD_COMPLETE": "complete_bash", "COMP_WORDS": line}
    asked["COMP_CWORD"] = str(len(words))
    done = CliRunner().invoke(app, prog_name="driftyard", env=asked)
    assert set(done.stdout.split()) == completed
