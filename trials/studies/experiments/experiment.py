"""An experiment: a claim, the jobs that test it, and what is found."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from trials.execution.jobs import Job, Recording, Results
from vo.contract.arrays import Array

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Verdict(StrEnum):
    """What became of a claim."""

    HOLDS = "holds"
    PARTLY = "holds in part"
    FAILS = "does not hold"
    OPEN = "cannot be decided"


@dataclass(frozen=True)
class Scale:
    """How much is driven.

    Attributes:
        seeds: Of the recordings of every setting.
        distance_m: Of each drive.
        most_scenes: Of those among which an experiment repeats the same.
        overrides: Of the generator's settings, `key=value` each.
    """

    seeds: tuple[int, ...]
    distance_m: float
    most_scenes: int = 99
    overrides: tuple[str, ...] = ()

    @property
    def drive(self) -> tuple[str, ...]:
        """Overrides that every recording shares: its length, and no labels, which none needs."""
        return (f"drive.distance_m={self.distance_m:g}", "labels.depth=false",
                "labels.disparity=false", *self.overrides)  # fmt: skip

    def recordings(self, scenes: Sequence[str], seeds: int | None = None) -> list[Recording]:
        """Drives through some scenes, each with all or the first few seeds."""
        chosen = scenes[: self.most_scenes]
        return [Recording(x, seed, self.drive) for x in chosen for seed in self.seeds[:seeds]]


FULL = Scale(seeds=(0, 1, 2), distance_m=4.0)
SMALL = Scale(
    seeds=(0,), distance_m=1.2, most_scenes=1, overrides=("rig.width_px=320", "rig.height_px=240")
)
"""For tests: enough to see that it runs, and too little to believe."""


@dataclass(frozen=True)
class TableOf:
    """A table of text.

    Attributes:
        columns: Headings, with units.
        rows: A cell for each column.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Findings:
    """What an experiment found.

    Attributes:
        verdict: On the claim.
        sentence: Why, and under which conditions it holds.
        table: The figures that the sentence rests on.
        caption: What the figure shows.
        draw: Draws it.
        data: The figure's data: name to columns, each a name with unit to (N,) values.
    """

    verdict: Verdict
    sentence: str
    table: TableOf
    caption: str
    draw: "Callable[[Figure], None]"
    data: Mapping[str, Mapping[str, Array]] = field(default_factory=dict[str, Mapping[str, Array]])


@dataclass(frozen=True)
class Experiment:
    """A claim of the thesis and how it is tested.

    Attributes:
        id: Such as `E1`.
        title: In a few words.
        claim: What the thesis says, in a sentence.
        source: Where it says so.
        setup: What is driven and what is compared, in a sentence or two.
        size_in: Width and height of the figure, inches.
        jobs: All that must be run, at a scale.
        analyse: Finds from what came of them.
    """

    id: str
    title: str
    claim: str
    source: str
    setup: str
    size_in: tuple[float, float]
    jobs: Callable[[Scale], Sequence[Job]]
    analyse: Callable[[Results], Findings]


def ragged(**columns: Array) -> dict[str, Array]:
    """Columns of unequal length as columns of one length, filled with NaN."""
    length = max((len(x) for x in columns.values()), default=0)
    return {
        name: np.concatenate([x.astype(float), np.full(length - len(x), np.nan)])
        for name, x in columns.items()
    }
