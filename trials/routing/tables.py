"""Data of the routing figures as CSV."""

from collections.abc import Iterable, Mapping
from dataclasses import astuple

from trials.evaluation.intervals import mean_interval
from trials.routing.drive import STRATEGIES
from trials.routing.study import Randomised, Study


def delays_csv(studies: Mapping[str, Study]) -> str:
    """Format mean travel times with their intervals over both kinds of delay."""
    rows = [
        (name, over, delay_s, strategy.name, *(f"{x:.3f}" for x in astuple(mean_interval(samples))))
        for name, study in studies.items()
        for over, sweep in (("node", study.node), ("queue", study.queue))
        for strategy, times_s in zip(STRATEGIES, sweep.times_s, strict=True)
        for delay_s, samples in zip(sweep.delays_s.tolist(), times_s, strict=True)
    ]
    return _csv(("network", "over", "delay_s", "strategy", "mean_s", "low_s", "high_s"), rows)


def random_csv(drives: Randomised) -> str:
    """Format the travel times of every random drive."""
    times = zip(drives.free_s, *drives.times_s, strict=True)
    rows = ((k, *(f"{x:.3f}" for x in each)) for k, each in enumerate(times))
    return _csv(("drive", "undelayed_s", *(f"{s.name}_s" for s in STRATEGIES)), rows)


def _csv(header: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> str:
    return "".join(",".join(map(str, row)) + "\n" for row in (header, *rows))
