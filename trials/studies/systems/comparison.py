"""Comparison of systems: medians of repeated runs, with intervals, and tables of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from trials.evaluation.display import html_display, text_display
from trials.evaluation.intervals import Interval, median_interval
from trials.studies.systems.measuring import Drive, Trial

ALL = "all scenes"
FAILED = "failed"


@dataclass(frozen=True)
class Metric:
    """A figure of a run: name, label with unit, digits, and its value; None if undefined."""

    name: str
    label: str
    digits: int
    of: Callable[[Trial], float | None]


def _rotation(trial: Trial) -> float | None:
    drift = trial.score.drift_1m if trial.score else None
    return drift.mean_deg_per_m if drift else None


DRIFT = Metric("drift", "drift over 1 m, %", 3, lambda x: x.score.drift_pct if x.score else None)
TIME = Metric("time", "ms per frame, one core", 1, lambda x: x.score.frame_ms if x.score else None)
METRICS = (
    DRIFT,
    Metric("rotation", "rotation over 1 m, °/m", 4, _rotation),
    Metric("lost", "frames lost, %", 1, lambda x: x.lost_percent),
    TIME,
)


@dataclass(frozen=True)
class About:
    """What a system is: settings, or where its trajectories come from; license and package."""

    what: str
    license: str = ""
    package: str = ""


@dataclass(frozen=True, repr=False)
class SystemComparison:
    """All runs of systems over drives.

    Attributes:
        drives: The recordings.
        systems: Name of each system to what it is, in their order.
        trials: The runs.
        command: What made them.
        machine: Where they ran.
        load: Load average of the machine when the runs were done.

    Example:
        >>> found = dy.compare_systems(["corner_flow"], ["yard.xml"], settings=SMALL)
        >>> found.interval("corner_flow", "drift").value > 0
        True
    """

    drives: tuple[Drive, ...]
    systems: Mapping[str, About]
    trials: tuple[Trial, ...]
    command: str
    machine: str
    load: float = 0.0

    @property
    def scenes(self) -> list[str]:
        """Names of the scenes, in their order."""
        return list(dict.fromkeys(x.scene for x in self.drives))

    @cached_property
    def _by_system(self) -> Mapping[str, list[Trial]]:
        return {name: [x for x in self.trials if x.system == name] for name in self.systems}

    def of(self, system: str, scene: str = ALL) -> list[Trial]:
        """Return the runs of a system on one scene, or all."""
        return [x for x in self._by_system[system] if scene in (ALL, x.scene)]

    def interval(self, system: str, metric: str, scene: str = ALL) -> Interval:
        """Return the median of a metric: drift, rotation, lost or time; with its 95 % interval.

        The median over drives of the median over the runs of each; runs that failed do not count.
        """
        (chosen,) = (x for x in METRICS if x.name == metric)
        by_drive: dict[str, list[float]] = {}
        for trial in self.of(system, scene):
            if (value := chosen.of(trial)) is not None:
                by_drive.setdefault(trial.drive, []).append(value)
        return median_interval([np.array(x) for x in by_drive.values()])

    def cell(self, system: str, metric: Metric, scene: str = ALL) -> str:
        """Format a median with its interval; the number of runs that failed if some did."""
        runs = self.of(system, scene)
        failures = sum(x.score is None for x in runs)
        if failures == len(runs):
            return FAILED
        text = _text(self.interval(system, metric.name, scene), metric.digits)
        return f"{text}, {failures} of {len(runs)} {FAILED}" if failures else text

    def summary(self) -> tuple[list[str], list[list[str]]]:
        """Header and rows of the table over all scenes: a row for each system."""
        header = ["system", *(x.label for x in METRICS), "runs", "failed"]
        rows = []
        for name in self.systems:
            runs = self.of(name)
            failures = sum(x.score is None for x in runs)
            cells = [
                FAILED if failures == len(runs) else _text(self.interval(name, x.name), x.digits)
                for x in METRICS
            ]
            rows.append([name, *cells, str(len(runs)), str(failures)])
        return header, rows

    def by_scene(self, metric: Metric) -> tuple[list[str], list[list[str]]]:
        """Header and rows of a metric: a row for each scene, a column for each system."""
        rows = [
            [scene, *(self.cell(name, metric, scene) for name in self.systems)]
            for scene in self.scenes
        ]
        return ["scene", *self.systems], rows

    @property
    def failures(self) -> list[tuple[str, str, str]]:
        """System, drives and reason of runs that failed; one row for each reason of a system."""
        found: dict[tuple[str, str], list[str]] = {}
        for x in self.trials:
            if x.score is None:
                found.setdefault((x.system, x.problem), []).append(x.drive)
        every = {x.name for x in self.drives}
        return [
            (system, "all" if set(names) == every else ", ".join(dict.fromkeys(names)), problem)
            for (system, problem), names in found.items()
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return everything, ready for JSON."""
        scopes = [ALL, *self.scenes]
        summary = {
            name: {
                scope: {x.name: _plain(self.interval(name, x.name, scope)) for x in METRICS}
                for scope in scopes
            }
            for name in self.systems
        }
        return {
            "command": self.command,
            "machine": self.machine,
            "load": self.load,
            "systems": {name: vars(x) for name, x in self.systems.items()},
            "drives": [{"name": x.name, "dataset": str(x.dataset)} for x in self.drives],
            "summary": summary,
            "runs": [
                {
                    "drive": x.drive, "system": x.system, "lost_percent": x.lost_percent,
                    "problem": x.problem, "score": x.score.to_dict() if x.score else None,
                }
                for x in self.trials
            ],
        }  # fmt: skip

    @property
    def _facts(self) -> list[tuple[str, ...]]:
        header, rows = self.summary()
        return [tuple(header), *map(tuple, rows)]

    def __repr__(self) -> str:
        rows = [(x[0], "  ".join(x[1:])) for x in self._facts]
        return text_display(f"Comparison over {len(self.drives)} drives", rows)

    def _repr_html_(self) -> str:
        return html_display(f"Comparison over {len(self.drives)} drives", self._facts)


def _text(interval: Interval, digits: int) -> str:
    """Format a median with its interval, if that is wider than the printed digits."""
    low, value, high = (f"{x:.{digits}f}" for x in (interval.low, interval.value, interval.high))
    return value if low == value == high != "nan" else interval.text(digits)


def _plain(interval: Interval) -> dict[str, float | None]:
    return {k: x if np.isfinite(x) else None for k, x in vars(interval).items()}
