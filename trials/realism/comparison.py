"""Comparison of a simulated recording with a real one, quantity by quantity, without truth."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trials.evaluation.display import html_display, text_display
from trials.realism.measure import measure
from trials.realism.quantities import QUANTITIES, SMALLEST, Measured, Quantity
from vo.contract.arrays import Array
from vo.recordings.readers import open_sequence

RESAMPLES = 200
FRAMES = 200
"""Default for the largest number of frames of each recording."""
MIN_FRAMES = 4
"""Smallest number of frames from which a sampling error is estimated."""
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Distance:
    """Distance of one quantity between two recordings.

    Attributes:
        quantity: Its name in QUANTITIES.
        value: In the unit that `Quantity.kind` says; 0 for equal ones; None without estimates.
        error: Standard error by sampling of frames; None with too few.
        chance: Median distance of the real recording to itself, its frames drawn anew twice.
        reason: Why there is no value; else empty.

    Example:
        >>> dy.Distance("noise", 0.31, 0.02).text
        '0.310 ± 0.020'
    """

    quantity: str
    value: float | None = None
    error: float | None = None
    chance: float | None = None
    reason: str = ""

    @property
    def text(self) -> str:
        """Value and error, or why there is none."""
        if self.value is None:
            return self.reason
        return f"{self.value:.3f}" + ("" if self.error is None else f" ± {self.error:.3f}")


@dataclass(frozen=True, repr=False)
class Comparison:
    """Statistics of a real and a simulated recording, and their distances.

    Attributes:
        real: Statistics of the real recording.
        simulated: Those of the simulated one.
        distances: By the name of the quantity.

    Example:
        >>> found = dy.compare("ds", "ds", frames=4)
        >>> found.distances["grey"].value
        0.0
    """

    real: Measured
    simulated: Measured
    distances: Mapping[str, Distance]

    def table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Return header and rows: quantity, mean of each, distance, and what chance gives."""
        header = "quantity", "real", "simulated", "distance", "by chance"
        rows: list[tuple[str, ...]] = []
        for name, x in self.distances.items():
            real, simulated = (_text(summary(m, name)) for m in (self.real, self.simulated))
            chance = "–" if x.chance is None else f"{x.chance:.3f}"
            rows.append((QUANTITIES[name].label, real, simulated, x.text, chance))
        return header, rows

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON takes it."""
        both = {"real": self.real, "simulated": self.simulated}
        return {
            **{key: {"name": x.name, "frames": x.frames} for key, x in both.items()},
            "quantities": {
                name: {
                    "label": QUANTITIES[name].label,
                    "kind": QUANTITIES[name].kind,
                    "distance": x.value,
                    "standard_error": x.error,
                    "by_chance": x.chance,
                    "reason": x.reason or None,
                    **{key: summary(m, name) for key, m in both.items()},
                    "x": QUANTITIES[name].x.tolist(),
                    **{f"{key}_estimate": _values(m.estimate(name)) for key, m in both.items()},
                }
                for name, x in self.distances.items()
            },
        }

    @property
    def _title(self) -> str:
        return f"{self.simulated.name} beside {self.real.name}"

    def __repr__(self) -> str:
        return text_display(self._title, [(r[0], r[3]) for r in self.table()[1]])

    def _repr_html_(self) -> str:
        header, rows = self.table()
        return html_display(self._title, [header, *rows])


def compare_recordings(
    real: Path, simulated: Path, frames: int = FRAMES, progress: Progress | None = None
) -> Comparison:
    """Measure two recordings, the same number of frames of each, and compare them.

    Raises:
        DriftyardError: If a recording is unreadable.
    """
    return compare_measured(*measure_equally((real, simulated), frames, progress))


def measure_equally(
    folders: tuple[Path, ...], frames: int, progress: Progress | None
) -> list[Measured]:
    """Measure as many frames of each recording as the shortest has, at most `frames`."""
    count = min(frames, *(len(open_sequence(x)) for x in folders))
    found: list[Measured] = []
    for k, folder in enumerate(folders):

        def advance(done: int, of: int, k: int = k) -> None:
            if progress:
                progress(k * of + done, len(folders) * of)

        found.append(measure(folder, count, progress=advance))
    return found


def compare_measured(real: Measured, simulated: Measured) -> Comparison:
    """Compare statistics; the sampling error is that of a bootstrap over blocks of frames."""
    rng = np.random.default_rng(0)
    draws = [block_draws(x.frames, rng) for x in (real, simulated, real)]
    found = {
        name: _distance(name, quantity, (real, simulated), draws)
        for name, quantity in QUANTITIES.items()
    }
    return Comparison(real, simulated, found)


def block_draws(frames: int, rng: np.random.Generator) -> Array:
    """Return how often each frame is in RESAMPLES samples of blocks of frames: (R, F).

    Blocks are as long as the root of the number of frames, and wrap around at the end.

    Source: Politis and Romano, A circular block-resampling procedure for stationary data, 1992.
    """
    length = max(1, round(frames**0.5))
    starts = rng.integers(frames, size=(RESAMPLES, -(-frames // length)))
    chosen = (starts[..., None] + np.arange(length)) % frames
    chosen = chosen.reshape(RESAMPLES, -1)[:, :frames]
    places = np.arange(RESAMPLES)[:, None] * frames + chosen
    return np.bincount(places.ravel(), minlength=RESAMPLES * frames).reshape(RESAMPLES, frames)


def _distance(
    name: str, quantity: Quantity, both: tuple[Measured, Measured], draws: list[Array]
) -> Distance:
    estimates = [x.estimate(name) for x in both]
    lacking = [x.name for x, found in zip(both, estimates, strict=True) if found is None]
    if lacking:
        return Distance(name, reason=f"{' and '.join(lacking)}: {quantity.missing}")
    real, simulated = (x[None] for x in estimates if x is not None)
    value = float(distances(quantity, real, simulated)[0])
    if not np.isfinite(value):
        return Distance(name, reason="no bin in which both have an estimate")
    if min(x.frames for x in both) < MIN_FRAMES:
        return Distance(name, value)
    statistics = both[0].statistics[name], both[1].statistics[name], both[0].statistics[name]
    first, second, again = (x.pooled(n) for x, n in zip(statistics, draws, strict=True))
    error = float(np.nanstd(distances(quantity, first, second)))
    return Distance(name, value, error, float(np.nanmedian(distances(quantity, first, again))))


def distances(quantity: Quantity, real: Array, simulated: Array) -> Array:
    """Return the distances (R,) of estimates (R, B), as the kind of the quantity says."""
    if quantity.kind == "histogram":
        x = quantity.x
        width = x[1] - x[0]
        mean = real @ x
        spread = np.sqrt(np.maximum(real @ x**2 - mean**2, 0))
        shift = abs(np.cumsum(real - simulated, axis=1)).sum(axis=1) * width
        return shift / np.maximum(spread, width)
    if quantity.kind == "ratio":
        logs = (np.log(np.maximum(x, SMALLEST)) for x in (real, simulated))
        found = abs(np.subtract(*logs))
    else:
        found = abs(real - simulated)
    known = np.isfinite(found)
    count = known.sum(axis=1)
    total = np.where(known, found, 0).sum(axis=1)
    return np.divide(total, count, out=np.full(len(found), np.nan), where=count > 0)


def summary(measured: Measured, name: str) -> float | None:
    """Return the mean of a quantity: of a histogram, or over the known bins of a curve."""
    found = measured.estimate(name)
    if found is None:
        return None
    if QUANTITIES[name].kind == "histogram":
        return float(found @ QUANTITIES[name].x)
    return float(np.nanmean(found))


def _text(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"


def _values(estimate: Array | None) -> list[float | None] | None:
    if estimate is None:
        return None
    return [float(x) if np.isfinite(x) else None for x in estimate]
