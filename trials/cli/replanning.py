"""`driftyard replanning`: time of D* Lite and of A* after changes of a grid."""

import numpy as np

from trials.cli import console
from trials.cli.options import option
from trials.report.tables import text_table
from trials.studies.replanning import CHANGES, measure


def replanning(
    side: int = option(500, "Side of the grid, cells.", min=100),
    changes: int = option(200, "Number of changes of each kind.", min=10),
    seed: int = option(0, "Random seed of grids and changes."),
) -> None:
    """Compare replanning with planning from scratch, and check that both find the same cost."""
    rows: list[tuple[str, ...]] = []
    for name, change in CHANGES.items():
        with console.counting_bar(name, 2 * changes) as count:
            timings = measure(change, side, 2 * changes, np.random.default_rng(seed), count)
        for what, some in (("closed", timings[::2]), ("reopened", timings[1::2])):
            replan_ms, plan_ms, expanded = np.median(some, axis=0)
            ratio, low = np.quantile(some[:, 1] / some[:, 0], (0.5, 0.05))
            figures = (f"{replan_ms:.3f}", f"{plan_ms:.1f}", f"{ratio:.0f}", f"{low:.1f}")
            rows.append((f"{name} {what}", *figures, f"{expanded:.0f}"))
    header = ("change", "D* Lite, ms", "A*, ms", "ratio", "worst 5 %", "expanded")
    title = f"warehouse, {side} x {side} cells; medians over {changes} changes"
    console.out.print(text_table(header, rows, title))
