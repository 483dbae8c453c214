"""When the preemption of a signal begins: arrival of the vehicle, transition, queue before it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vo.contract.arrays import Array
from vo.contract.errors import SettingsError
from vo.contract.remarks import remark
from vo.recordings.tables import read_table


@dataclass(frozen=True)
class Discharge:
    """How a queue leaves at green (Highway Capacity Manual, saturation flow).

    Attributes:
        lost_time_s: Start-up lost time l, until the first vehicles drive off.
        headway_s: Saturation headway h of a lane; its saturation flow is s = 1 / h.
    """

    lost_time_s: float = 2.0
    headway_s: float = 2.0

    def delay_s(self, queue_vehicles: float) -> float:
        """Compute the delay of the vehicle behind a queue of a lane, t_q = l + h n_q."""
        return self.lost_time_s + self.headway_s * queue_vehicles


@dataclass(frozen=True)
class Green:
    """Begin t_g of the last green of a movement and its length g, infinite while it is on."""

    start_s: float
    length_s: float = np.inf


class Counts:
    """Vehicles counted on an approach since some time (cumulative counts, Newell 1982).

    Args:
        detector: Name in errors.
        times_s: (k,) ascending.
        arrivals: (k,) vehicles that would have reached the stop line by each time without a queue.
        departures: (k,) vehicles that have crossed the stop line by each time.

    Raises:
        SettingsError: If there are no counts, or they fall.
    """

    def __init__(self, detector: str, times_s: Array, arrivals: Array, departures: Array) -> None:
        if not len(times_s):
            raise SettingsError(f"{detector}: the detector has no counts")
        for name, values in (
            ("times", times_s),
            ("arrivals", arrivals),
            ("departures", departures),
        ):
            fallen = np.flatnonzero(np.diff(values) < 0)
            if len(fallen):
                before, after = values[fallen[0] : fallen[0] + 2]
                raise SettingsError(f"{detector}: {name} fall from {before:g} to {after:g}")
        self.times_s, self.arrivals, self.departures = times_s, arrivals, departures

    def arrived(self, time_s: float) -> float:
        """A(T): interpolate the arrivals; after the last count they go on at the mean rate."""
        late_s = max(0.0, time_s - self.times_s[-1])
        span_s = self.times_s[-1] - self.times_s[0]
        rate_per_s = (self.arrivals[-1] - self.arrivals[0]) / span_s if span_s else 0.0
        return float(np.interp(time_s, self.times_s, self.arrivals) + late_s * rate_per_s)

    def departed(self, time_s: float) -> float:
        """D(t): interpolate the departures, of a time that has been."""
        return float(np.interp(time_s, self.times_s, self.departures))

    def queue(self, time_s: float, green: Green, flow_per_s: float) -> float:
        """Compute the queue length n_q at a time, vehicles.

        It is max(0, A(T) - D(t_g) - s (T - t_g)) while green is on at the time of the last count,
        and A(T) - D(t_g + g), at least 0, afterwards.

        Args:
            time_s: T, when the urgent vehicle arrives.
            green: The last green of its movement.
            flow_per_s: Saturation flow s of the lanes that have green, vehicles/s.
        """
        if np.isinf(green.length_s):
            left = self.departed(green.start_s) + flow_per_s * max(0.0, time_s - green.start_s)
        else:
            left = self.departed(green.start_s + green.length_s)
        return max(0.0, self.arrived(time_s) - left)


def read_counts(path: Path) -> Counts:
    """Read rows of time, s, arrivals and departures until then.

    Raises:
        SettingsError: If the file is missing or malformed, has no counts, or they fall.

    More departures than arrivals in all are a remark: the queue is then too short.
    """
    expected = "a time in s, and the vehicles that arrived and departed until then"
    values = read_table(path, SettingsError).numbers(range(3), expected)
    counts = Counts(str(path), *values.T)
    arrived, departed = counts.arrivals[-1], counts.departures[-1]
    if departed > arrived:
        remark(
            f"{path}: {departed:g} vehicles departed, but only {arrived:g} arrived; the queue is "
            "too short if the columns are swapped, or if vehicles stood there before the first row"
        )
    return counts


def preemption_start_s(
    arrival_s: float, transition_s: float, margin_s: float, queue_delay_s: float = 0.0
) -> float:
    """Compute when the preemption begins, P = T - transition - safety margin - t_q.

    Args:
        arrival_s: T, when the vehicle arrives at the stop line without delay.
        transition_s: Duration of yellow and all-red.
        margin_s: Safety margin.
        queue_delay_s: Delay t_q by the queue before it; 0 with low congestion.
    """
    return arrival_s - transition_s - margin_s - queue_delay_s
