"""`driftyard route signals`: the phase that lets an urgent vehicle through, by rules."""

from trials.cli import console
from trials.cli.options import option
from trials.routing.phases import (
    EIGHT_PHASES,
    SIDES,
    movement_of,
    phase_name,
    read_phases,
    selection_table,
)
from vo.contract.errors import SettingsError

EIGHT = ",".join(map(phase_name, EIGHT_PHASES))


def route_signals(
    phases: str = option(EIGHT, "Phases of the signal in their order.", metavar="A+B,..."),
    present: str | None = option(None, "Show one present phase only.", metavar="A+B"),
    origin: str | None = option(
        None, "Show one side from which the vehicle comes only.", "--from", metavar="SIDE"
    ),
) -> None:
    """Print the phases that the rules select with low and with high congestion.

    Rows are the sides from which and to which the vehicle drives, with its movement, columns the
    present phases. An asterisk marks a present phase that is extended.
    """
    known = read_phases(phases)
    names = [phase_name(x) for x in known]
    if present is not None and present not in names:
        raise SettingsError(f"--present {present}: expected one of {', '.join(names)}")
    if origin is not None and origin not in SIDES:
        raise SettingsError(f"--from {origin}: expected one of {', '.join(SIDES)}")
    columns = [k for k, name in enumerate(names) if present in (None, name)]
    low, high = (selection_table(known, is_congested) for is_congested in (False, True))
    for title, table in (("high congestion", high), ("low congestion", low)):
        rows = [
            (f"{a} to {b}, {movement_of(a, b)}", *(choices[k].text for k in columns))
            for (a, b), choices in table.items()
            if origin in (None, a)
        ]
        console.print_table((title, *(names[k] for k in columns)), rows)
        console.out.print()
    cells = [pair for way in low for pair in zip(low[way], high[way], strict=True)]
    same = sum(a == b for a, b in cells)
    share = f"{100 * same / len(cells):.1f} %"
    console.out.print(f"both select the same in {same} of {len(cells)} cells, {share}")
