"""`driftyard gate power`: false alarm rate and power of the gate, by simulation."""

from pathlib import Path

from trials.cli import console
from trials.cli.options import option
from trials.gate.alternatives import TESTS
from trials.studies.gate_power import CASES, resampled, simulate


def gate_power(
    repetitions: int = option(200, "Number for each case.", min=20),
    seed: int = option(0, "Random seed of all draws.", min=0),
    result: list[Path] = option(
        [], "Also draw from a JSON result of `gate check`; may be repeated.", metavar="FILE"
    ),
    tests: bool = option(False, "Also print the rates of other statistical tests."),
) -> None:
    """Simulate how often the gate raises a false alarm, and how often it finds +10 % of drift.

    A false alarm is a regression for a candidate whose drift grew by exactly the tolerance.
    """
    cases = [*CASES, *(resampled(path) for path in result)]
    with console.counting_bar("simulating", 2 * repetitions * len(cases)) as count:
        found = simulate(cases, repetitions, seed, TESTS if tests else {}, count)
    header = ("case", "seeds", "false alarms, %", "10 % found, %", "promised, %")
    rows = [
        (x.case.name, str(x.case.seeds), x.alarms, x.found, f"{100 * x.case.power:.0f}")
        for x in found
    ]
    console.out.print(f"{repetitions} repetitions (95 % interval)")
    console.print_table(header, rows)
    if tests:
        console.out.print("other tests: false alarms / found, %")
        console.print_table(("case", *TESTS), [(x.case.name, *x.others) for x in found])
