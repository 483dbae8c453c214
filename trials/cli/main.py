"""The command line; `main` turns every error that input can cause into one line and status 2."""

import sys
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool

import typer

from trials.cli.old_names import refuse_old_names
from trials.cli.registry import LazyGroup
from vo.contract.errors import DriftyardError

BAD_INPUT, INTERRUPTED = 2, 130

app = typer.Typer(
    cls=LazyGroup,
    epilog="Example: driftyard demo",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.callback()
def driftyard() -> None:
    """A proving ground for stereo visual odometry."""


def main() -> None:
    """Run the command line and exit."""

    def run() -> None:
        refuse_old_names(sys.argv[1:])
        app(prog_name="driftyard")

    guard(run)


def guard(command: Callable[[], object]) -> None:
    """Run a command; errors of the input end in one line and exit status 2."""
    try:
        command()
    except DriftyardError as error:
        _fail(str(error))
    except OSError as error:  # a full disk or a folder without permission is no bug
        if error.filename is None:
            raise
        _fail(f"{error.filename}: {error.strerror}")
    except BrokenProcessPool:
        _fail("a worker process was killed (out of memory?); run the command again")
    except SystemExit as exit:
        if exit.code == INTERRUPTED:
            print("driftyard: interrupted", file=sys.stderr)
        raise


def _fail(message: str) -> None:
    print(f"driftyard: error: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(BAD_INPUT)
