"""The command line; `main` turns every error that input can cause into one line and status 2."""

import sys
import warnings
from collections.abc import Callable, Sequence
from typing import NoReturn

import typer

from driftyard import __version__
from driftyard.failures import as_driftyard_error
from trials.cli.registry import COMMANDS, LazyGroup
from vo.contract.errors import SettingsError
from vo.contract.remarks import print_remarks

BAD_INPUT, INTERRUPTED = 2, 130
OLD_NAMES = {
    ("gate", "--bless"): "`driftyard gate update`",
    ("gate", "--plan"): "`driftyard gate plan PERCENT`",
    ("drive", "--option"): "`driftyard drive --trial`",
    ("stress", "--most"): "`driftyard stress --max`",
}
"""Command and its earlier option to what replaces it."""

app = typer.Typer(
    cls=LazyGroup,
    epilog="Example: driftyard demo",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _print_version(is_asked: bool) -> None:
    if is_asked:
        print(f"driftyard {__version__}")
        raise typer.Exit


@app.callback()
def driftyard(
    version: bool = typer.Option(
        False,
        "--version",
        help="Print the version and exit.",
        callback=_print_version,
        is_eager=True,
    ),
) -> None:
    """A proving ground for stereo visual odometry."""


def main() -> None:
    """Run the command line and exit."""

    def run() -> None:
        refuse_old_names(sys.argv[1:])
        app(prog_name="driftyard")

    guard(run)


def guard(command: Callable[[], object]) -> None:
    """Run a command; errors of the input end in one line and exit status 2, remarks are lines."""
    try:
        with warnings.catch_warnings():
            print_remarks()
            command()
    except Exception as error:
        if _was_interrupted(error):
            _stop()
        if (stated := as_driftyard_error(error)) is None:
            raise
        _fail(str(stated))
    except SystemExit as exit:
        if exit.code == INTERRUPTED:
            _stop()
        raise


def _was_interrupted(error: BaseException | None) -> bool:
    """Whether an interruption caused it: Numba and Python's C code turn it into SystemErrors."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__
    return error is not None


def _stop() -> NoReturn:
    print("driftyard: interrupted", file=sys.stderr)
    sys.exit(INTERRUPTED)


def _fail(message: str) -> NoReturn:
    print(f"driftyard: error: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(BAD_INPUT)


def refuse_old_names(words: Sequence[str]) -> None:
    """Raise SettingsError for an earlier command or option in the words after `driftyard`."""
    command, *rest = words or [""]
    for word in rest:
        name = word.partition("=")[0]
        if (new := OLD_NAMES.get((command, name))) is not None:
            raise SettingsError(f"`driftyard {command} {name}` is now {new}")
    if command == "gate" and rest and rest[0] != "--help" and f"gate {rest[0]}" not in COMMANDS:
        raise SettingsError("`driftyard gate` is now `driftyard gate check`")
