"""Results that others have published, beside ours: each with its paper and where it was read."""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

FILE = Path(__file__).with_suffix(".toml")
MIN_FRAMES = 1000
"""Smallest number of frames of a recording that can be a whole sequence: 50 s at 20 Hz."""
NOTHING = "–"
NAMES = {
    "euroc": re.compile(r"(mh|v1|v2)_?0([1-5])", re.IGNORECASE),
    "tumvi": re.compile(r"(room)([1-6])", re.IGNORECASE),
}
"""Benchmark to the part of a recording's name that is the name of a sequence."""


@dataclass(frozen=True)
class Published:
    """ATE, metres, of a system on whole sequences, as others have printed it.

    Attributes:
        benchmark: euroc or tumvi.
        system: Name.
        input: Sensors that it uses.
        paper: Where it is published.
        figure: What the figure is, as far as the text says.
        seen_in: The text that it is copied from.
        values: Sequence, such as MH01 or room1, to the value.
    """

    benchmark: str
    system: str
    input: str
    paper: str
    figure: str
    seen_in: str
    values: Mapping[str, float]


@cache
def published(benchmark: str) -> tuple[Published, ...]:
    """Return what is known of a benchmark; of KITTI, nothing."""
    rows = tomllib.loads(FILE.read_text("utf-8"))["results"]
    return tuple(x for x in (Published(**row) for row in rows) if x.benchmark == benchmark)


def sequence_of(benchmark: str, recording: str) -> str | None:
    """Return the sequence that a recording is, by its name; None if that does not say."""
    if benchmark not in NAMES:
        return None
    found = NAMES[benchmark].findall(recording)
    if not found:
        return None
    place, number = found[-1]
    if benchmark == "tumvi":
        return f"room{number}"
    return f"{place.upper()}0{number}"


def published_table(
    benchmark: str, ours: Mapping[str, Mapping[str, float]], frames: Mapping[str, int]
) -> tuple[list[str], list[list[str]], list[str]]:
    """Tabulate our ATE, metres, by estimator and recording, beside what others have published.

    A recording with few frames is marked as an excerpt.

    Returns:
        Header, rows, and the numbered sources; no rows if none of the recordings is known.
    """
    known = {x: y for some in ours.values() for x in some if (y := sequence_of(benchmark, x))}
    theirs = [x for x in published(benchmark) if set(known.values()) & set(x.values)]
    if not theirs:
        return [], [], []
    sources = list(dict.fromkeys((x.paper, x.figure, x.seen_in) for x in theirs))
    rows = [[name, "stereo", *_cells([x.get(y) for y in known])] for name, x in ours.items()]
    for x in theirs:
        number = sources.index((x.paper, x.figure, x.seen_in)) + 1
        cells = _cells([x.values.get(y) for y in known.values()])
        rows.append([f"{x.system} (theirs [{number}])", x.input, *cells])
    said = [
        f"[{k}] {figure}: {paper}; read in {seen_in}"
        for k, (paper, figure, seen_in) in enumerate(sources, 1)
    ]
    excerpts = {x for x in known if frames[x] < MIN_FRAMES}
    said += [
        f"{x}: an excerpt of {frames[x]} frames, not comparable with theirs"
        for x in sorted(excerpts)
    ]
    names = [f"{x} (ours: excerpt)" if x in excerpts else x for x in known]
    return ["system", "input", *names, "mean"], rows, said


def _cells(values: Sequence[float | None]) -> list[str]:
    """Format values and their mean, with their number if some are missing."""
    found = [x for x in values if x is not None]
    if not found:
        return [NOTHING] * (len(values) + 1)
    of = "" if len(found) == len(values) else f" ({len(found)} of {len(values)})"
    return [NOTHING if x is None else f"{x:.3f}" for x in values] + [f"{np.mean(found):.3f}{of}"]
