"""The part of the command drive that holds static against dynamic planning."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trials.gym.studies.planning import PlannedTrial, Planning


def drive_planned(
    title: str,
    options: Mapping[str, Any],
    sources: Sequence[str],
    plannings: "Sequence[Planning]",
    layouts: range,
    runs: int,
    out: Path | None,
    ideal: bool,
) -> None:
    """Drive the same trials by every way of planning, and print a table.

    Args:
        title: Of the table.
        options: Of RoverNav.
        sources: Of localization.
        plannings: static, dynamic or both.
        layouts: Seeds of the worlds.
        runs: Pairs of start and goal in each.
        out: JSON lines, one for each trial.
        ideal: Depth by rays in place of cameras.

    Raises:
        DriftyardError: If an option is refused or a world has no free place.
    """
    from rich.table import Table

    from trials.cli import console
    from trials.gym.studies.planning import MEASURES, run_planned
    from trials.gym.studies.trial_protocol import summary
    from vo.contract.files import write_text

    trials: list[PlannedTrial] = []
    with console.counting_bar("worlds", len(layouts) * len(sources)) as count:
        for source in sources:
            asked = {**options, "localization": source}
            for of_world in run_planned(asked, plannings, layouts, runs, ideal):
                trials += of_world
                count(of_world)
    trials.sort(key=lambda t: (sources.index(t.localization), t.layout, t.run))
    if out:
        write_text(out, "".join(json.dumps(asdict(t)) + "\n" for t in trials))
    columns = {
        f"{planning}, {source}": summary(
            [t for t in trials if (t.planning, t.localization) == (planning, source)], MEASURES
        )
        for source in sources
        for planning in plannings
    }
    table = Table(title, *columns)
    for name in next(iter(columns.values())):
        table.add_row(name, *(column[name] for column in columns.values()))
    console.out.print(table)
