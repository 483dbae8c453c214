"""The command line; `main` turns every error that input can cause into one line and status 2."""

import sys
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool

import typer

from trials.cli.datasets import generate, scenes, verify
from trials.cli.demo import demo
from trials.cli.doctor import doctor
from trials.cli.drive import drive
from trials.cli.experiment import experiment
from trials.cli.explain import explain
from trials.cli.gate import gate
from trials.cli.preview import preview
from trials.cli.route import route
from trials.cli.runs import report, run, score
from trials.cli.stress import stress
from vo.contract.errors import DriftyardError

BAD_INPUT, INTERRUPTED = 2, 130

COMMANDS: dict[Callable[..., None], str] = {
    scenes: "driftyard scenes",
    preview: "driftyard preview brick_court --out preview.png",
    generate: "driftyard generate brick_court --out court --seed 7 --set drive.distance_m=20",
    verify: "driftyard verify court",
    run: "driftyard run court --out court.txt --estimator corner_flow",
    score: "driftyard score court court.txt --json",
    report: "driftyard report court court.txt --out court.html",
    gate: "driftyard gate --baseline baseline.json --estimator my_vo:MyOdometry",
    drive: "driftyard drive office --localization truth,wheels,vo --worlds 10",
    route: "driftyard route --out routing",
    explain: "driftyard explain --scene brick_court --seeds 3",
    experiment: "driftyard experiment E1,E3",
    stress: "driftyard stress exposure --estimator corner_flow",
    doctor: "driftyard doctor",
    demo: "driftyard demo",
}
"""Every command with the example that its help shows."""

app = typer.Typer(
    help="A proving ground for stereo visual odometry.",
    epilog="Example: driftyard demo",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for command, example in COMMANDS.items():
    app.command(epilog=f"Example: {example}")(command)


def main() -> None:
    """Run the command line and exit."""
    guard(lambda: app(prog_name="driftyard"))


def guard(command: Callable[[], object]) -> None:
    """Run a command; what a user got wrong ends in one line and exit status 2."""
    try:
        command()
    except DriftyardError as error:
        _fail(str(error))
    except OSError as error:  # a full disk, a folder without permission: not a bug either
        if error.filename is None:
            raise
        _fail(f"{error.filename}: {error.strerror}")
    except BrokenProcessPool:
        _fail("a worker was killed (out of memory?): run this again")
    except SystemExit as exit:
        if exit.code == INTERRUPTED:
            print("driftyard: interrupted", file=sys.stderr)
        raise


def _fail(message: str) -> None:
    print(f"driftyard: error: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(BAD_INPUT)


if __name__ == "__main__":
    main()
