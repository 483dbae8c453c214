"""Options of commands that read datasets from locations: which of them."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from trials.cli.completion import several_of
from trials.cli.options import argument, option

if TYPE_CHECKING:
    from trials.shards.catalogue import Entry
    from trials.shards.selection import Selection


def _labels() -> Iterable[str]:
    from sim.labels.formats import LABELS

    return [*LABELS, "none"]


@dataclass(frozen=True)
class SelectionOptions:
    """Datasets of locations that are chosen."""

    locations: list[str] = argument(
        ...,
        "Where `generate` wrote: folder, s3://BUCKET/NAME, gs://..., sftp://....",
        metavar="LOCATION...",
    )
    scene: str = option("", "Datasets of these scenes.", show_default="all", metavar="A,B,C")
    seed: str = option("", "Datasets of these seeds, 0-9,12.", show_default="all", metavar="RANGES")
    labels: str = option(
        "",
        "Datasets with these labels, or none.",
        show_default="all",
        metavar="A,B,C",
        autocompletion=several_of(_labels),
    )

    PANEL: ClassVar[str] = "Datasets"

    @property
    def selection(self) -> "Selection":
        """The selection."""
        from trials.shards.selection import parse_selection

        return parse_selection(self.scene, self.seed, self.labels)

    @property
    def entries(self) -> "list[Entry]":
        """The chosen datasets, read now."""
        from trials.shards.selection import select

        return select(self.locations, self.selection)
