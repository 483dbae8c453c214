"""The report's charts: what each shows of the runs."""

from collections.abc import Mapping, Sequence
from itertools import groupby

import numpy as np

from trials.evaluation.alignment import Alignment, Pair
from trials.evaluation.metrics import position_errors
from trials.evaluation.runs import FrameTable
from trials.evaluation.score import Score
from trials.report.svg import Bands, Chart, line_chart, stacked_chart
from vo.contract.arrays import Array
from vo.contract.estimator import Status
from vo.contract.trajectory import NS_PER_S

SHADED = (Status.START, Status.WEAK, Status.LOST)


def error_over_distance(pairs: Mapping[str, Pair]) -> Chart:
    """Position error with the first pose aligned, along the true path."""
    series = {
        name: (pair.travelled_m, 100 * position_errors(pair, Alignment.FIRST_POSE))
        for name, pair in pairs.items()
    }
    caption = "Distance of estimate and truth, first poses aligned."
    return line_chart(
        "Error over distance", series, "true path (m)", "position error (cm)", caption=caption
    )


def drift_by_length(scores: Sequence[Score]) -> Chart:
    """Mean drift of segments of every length."""
    series = {
        score.estimator: (
            np.array([x.length_m for x in score.segments]),
            np.array([x.mean_percent for x in score.segments]),
        )
        for score in scores
    }
    caption = (
        "Mean translation error of all segments of a length, by that length. Flat: scale is off; "
        "falling: errors of single frames that average out; rising: rotation errors that add up."
    )
    return line_chart(
        "Drift by segment length", series, "segment length (m)", "drift (%)", caption=caption
    )


def stage_counts(frames: FrameTable) -> Chart:
    """How many items survive each stage, over time, with everything but `tracked` shaded."""
    time_s = _time_s(frames)
    series = {
        stage: (time_s, counts)
        for stage, counts in frames.counts.items()
        if not stage.endswith("iterations")  # of an optimiser: no items that survive
    }
    caption = "Shaded frames are not plainly tracked: grey start, amber weak, red lost."
    return line_chart(
        "Survivors of each stage",
        series,
        "time (s)",
        "items per frame",
        Bands(_stretches(frames, time_s)),
        caption,
    )


def stage_timings(frames: FrameTable) -> Chart:
    """Milliseconds of each stage, stacked, over time."""
    return stacked_chart(
        "Time spent by stage",
        _time_s(frames),
        frames.timings_ms,
        "time (s)",
        "ms per frame",
        "Wall time of the estimator, loading of images not counted.",
    )


def _time_s(frames: FrameTable) -> Array:
    return (frames.timestamps_ns - frames.timestamps_ns[0]) / NS_PER_S


def _stretches(frames: FrameTable, time_s: Array) -> dict[str, list[tuple[float, float]]]:
    """Status to the intervals (s) in which frames have it, each frame lasting until the next."""
    ends = np.append(time_s[1:], time_s[-1])
    stretches: dict[str, list[tuple[float, float]]] = {}
    for status, group in groupby(range(len(frames)), key=lambda i: frames.status[i]):
        members = list(group)
        if status in SHADED:
            span = float(time_s[members[0]]), float(ends[members[-1]])
            stretches.setdefault(f"band-{status.value}", []).append(span)
    return stretches
