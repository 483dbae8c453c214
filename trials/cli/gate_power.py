"""`driftyard gate power`: false alarm rate and power of the gate, by simulation."""

from pathlib import Path
from typing import Annotated

import typer

from trials.cli import console
from trials.gate.alternatives import TESTS
from trials.studies.gate_power import CASES, resampled, simulate


def gate_power(
    repetitions: Annotated[int, typer.Option(min=20, help="Number for each case.")] = 200,
    seed: Annotated[int, typer.Option(min=0, help="Random seed of all draws.")] = 0,
    result: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE", help="Also draw from a JSON result of `gate check`; may be repeated."
        ),
    ] = None,
    tests: Annotated[
        bool, typer.Option(help="Also print the rates of other statistical tests.")
    ] = False,
) -> None:
    """Simulate how often the gate raises a false alarm, and how often it finds +10 % of drift.

    A false alarm is a regression for a candidate whose drift grew by exactly the tolerance.
    """
    cases = [*CASES, *(resampled(path) for path in result or [])]
    with console.counting_bar("simulating", 2 * repetitions * len(cases)) as count:
        found = simulate(cases, repetitions, seed, TESTS if tests else {}, count)
    header = ("case", "seeds", "false alarms, %", "10 % found, %", "promised, %")
    rows = [(x.case.name, str(x.case.seeds), x.alarms, x.found, x.promised) for x in found]
    console.out.print(f"{repetitions} repetitions (95 % interval)")
    console.print_table(header, rows)
    if tests:
        console.out.print("other tests: false alarms / found, %")
        console.print_table(("case", *TESTS), [(x.case.name, *x.others) for x in found])
