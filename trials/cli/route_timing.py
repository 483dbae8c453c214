"""`driftyard route timing`: when the preemption of a signal begins."""

from dataclasses import asdict, dataclass
from math import inf, isfinite
from pathlib import Path
from typing import ClassVar

from trials.cli import console
from trials.cli.options import option
from trials.routing.preemption import Discharge, Green, preemption_start_s, read_counts
from trials.routing.signal_controller import TRANSITION_S
from trials.routing.urgent import MARGIN_S
from vo.contract.errors import SettingsError


@dataclass(frozen=True)
class QueueOptions:
    """The queue before the vehicle."""

    PANEL: ClassVar[str] = "Queue"
    queue: float | None = option(None, "Length of the queue in a lane, vehicles.", min=0)
    counts: Path | None = option(
        None,
        "Counts of an approach instead: rows of time s, vehicles that arrived by then, and that "
        "crossed the stop line.",
        metavar="FILE.csv",
    )
    green_start: float | None = option(None, "Begin of the last green, s; with --counts.")
    green_length: float | None = option(
        None, "Length of the last green, s.", min=0, show_default="still on"
    )
    lanes: int = option(1, "Number of lanes of the approach.", min=1)
    lost_time: float = option(2.0, "Start-up lost time l, s.", min=0)
    headway: float = option(2.0, "Saturation headway h of a lane, s.", min=0.1)


def route_timing(
    queue: QueueOptions,
    arrival: float = option(..., "Time T at which the vehicle arrives without delay, s."),
    transition: float = option(TRANSITION_S, "Duration of yellow and all-red, s.", min=0),
    margin: float = option(MARGIN_S, "Safety margin, s.", min=0),
) -> None:
    """Compute P = T - transition - margin - t_q, with the delay t_q = l + h n_q by the queue.

    Without --queue and --counts, no queue is before the vehicle, and t_q is 0.
    """
    given = {"arrival": arrival, "transition": transition, "margin": margin, **asdict(queue)}
    for name, value in given.items():
        if isinstance(value, float) and not isfinite(value):
            raise SettingsError(f"--{name.replace('_', '-')} {value}: expected a finite number")
    discharge = Discharge(queue.lost_time, queue.headway)
    vehicles = _queue(queue, arrival)
    delay_s = 0.0 if vehicles is None else discharge.delay_s(vehicles)
    start_s = preemption_start_s(arrival, transition, margin, delay_s)
    if vehicles is not None:
        console.out.print(f"queue {vehicles:.2f} vehicles a lane, its delay {delay_s:.2f} s")
    console.out.print(f"the preemption begins at {start_s:.2f} s")


def _queue(given: QueueOptions, arrival_s: float) -> float | None:
    if given.counts is None:
        return given.queue
    if given.queue is not None:
        raise SettingsError("--queue and --counts: the queue is given by one of both")
    if given.green_start is None:
        raise SettingsError("--counts needs --green-start, the begin of the last green")
    length_s = inf if given.green_length is None else given.green_length
    counts = read_counts(given.counts)
    first_s, last_s = counts.times_s[0], counts.times_s[-1]
    if not first_s <= given.green_start <= last_s:
        raise SettingsError(
            f"--green-start {given.green_start:g}: {given.counts} counts from {first_s:g} to "
            f"{last_s:g} s"
        )
    green, flow_per_s = Green(given.green_start, length_s), given.lanes / given.headway
    return counts.queue(arrival_s, green, flow_per_s) / given.lanes
