"""Datasets of locations that are chosen by scene, seed and labels."""

from collections.abc import Sequence
from dataclasses import dataclass

from sim.labels.formats import LABELS
from trials.execution.location import Location
from trials.shards.catalogue import Entry, read_entries
from vo.contract.errors import DatasetError, SettingsError
from vo.contract.remarks import remark

NONE = "none"
"""Word for no labels."""


@dataclass(frozen=True)
class Selection:
    """Which datasets are chosen; those of every scene and seed by default.

    Attributes:
        scenes: Names or sources of scenes; empty for all.
        seeds: Ranges of seeds, both ends included; empty for all.
        labels: Labels that are needed; None for any.

    Raises:
        SettingsError: If there is no such label.
    """

    scenes: tuple[str, ...] = ()
    seeds: tuple[range, ...] = ()
    labels: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if wrong := [x for x in self.labels or () if x not in LABELS]:
            raise SettingsError(f"labels: there is no {wrong[0]}, only {', '.join(LABELS)}")

    def chooses(self, entry: Entry) -> bool:
        """Whether scene and seed are chosen."""
        known = not self.scenes or {*entry.scenes} & {*self.scenes}
        return bool(known) and (not self.seeds or any(entry.seed in x for x in self.seeds))


def parse_selection(scenes: str, seeds: str, labels: str) -> Selection:
    """Parse `a,b`, `0-9,12` and `depth,flow` or `none`; what is empty is not restricted.

    Raises:
        SettingsError: If a seed is no number or range, or there is no such label.
    """
    asked = tuple(x for x in labels.split(",") if x)
    ranges: list[range] = []
    for text in filter(None, seeds.split(",")):
        first, dash, last = text.partition("-")
        if not (first.isdecimal() and (last.isdecimal() or not dash)):
            raise SettingsError(f"--seed {text}: expected seeds as 0-9,12")
        ranges.append(range(int(first), int(last or first) + 1))
    wanted = None if not asked else () if asked == (NONE,) else asked
    return Selection(tuple(x for x in scenes.split(",") if x), tuple(ranges), wanted)


def select(locations: Sequence[str], selection: Selection) -> list[Entry]:
    """Return the chosen datasets of locations.

    Of a name in two locations, the first counts, with a remark. Datasets without the labels are
    left out, with a remark.

    Raises:
        DatasetError: If no dataset is chosen; says what there is.
        StoreError: If a location cannot be read.
    """
    entries: dict[str, Entry] = {}
    places = [Location(x) for x in locations]
    for place in places:
        found = read_entries(place)
        if again := [x for x in found if x in entries]:
            first = entries[again[0]].location
            remark(f"{place}: {len(again)} datasets, as {again[0]}, are in {first}, and used there")
        entries = found | entries
    where = ", ".join(map(str, places))
    if not entries:
        raise DatasetError(f"{where}: holds no complete dataset, or does not exist")
    chosen = [x for x in entries.values() if selection.chooses(x)]
    if not chosen:
        scenes = ", ".join(sorted({x.scenes[0] for x in entries.values()}))
        seeds = sorted({x.seed for x in entries.values()})
        raise DatasetError(
            f"{where}: holds no dataset of this scene and seed; scenes are {scenes}, seeds from "
            f"{seeds[0]} to {seeds[-1]}"
        )
    found = [x for x in chosen if {*(selection.labels or ())} <= {*x.labels}]
    lacking = [x for x in chosen if x not in found]
    if lacking:
        said = f"has no {' and '.join(set(selection.labels or ()) - {*lacking[0].labels})}"
        said = f"{lacking[0].location}: {lacking[0].name} {said}"
        if not found:
            raise DatasetError(f"{said}, only {', '.join(lacking[0].labels) or 'images'}")
        remark(f"{said}; {len(lacking)} datasets without the labels are left out")
    return found
