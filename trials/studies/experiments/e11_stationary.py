"""E11: drift of a stationary camera, and its detection (thesis 5.1.3)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from matplotlib.figure import Figure

from trials.evaluation.intervals import Interval, mean_interval
from trials.evaluation.metrics import errors_between
from trials.execution.jobs import Recording, Result, Results, Variant
from trials.report.figure import BLUE, GREEN, GREY, OCHRE, RED, tidy
from trials.studies.experiments.base import Data, Experiment, Finding, Rows, Steps, Verdict
from trials.studies.experiments.measures import mean_text
from trials.studies.experiments.variants import THESIS
from vo.contract import se3
from vo.contract.arrays import Array

CONDITIONS = {"undisturbed": "", "with noise": "noise"}
"""Label to disturbance."""
LENGTH_M = 2.4
STOPS = ("drive.stop_every_m=0.9", "drive.stop_s=10")
WITHOUT = Variant("default, no detection", "driftyard", ("stationary=none",))
BY_IMAGE = Variant("default, by image", "driftyard", ("stationary=image",))
BY_WHEELS = Variant("default, by image and encoders", "driftyard", ("stationary=encoders",))
SHOWN = {THESIS: RED, WITHOUT: BLUE, BY_IMAGE: OCHRE, BY_WHEELS: GREEN}
REST_MPS, REST_DEG_PER_S = 1e-3, 0.01
"""True speed and turn rate below which the camera is stationary."""
MIN_STOP_S = 1.0
MIN_SHOWN_MM = 1e-3
"""Smaller errors are drawn at this value of the logarithmic axis, mm."""
MAX_MM, MAX_DEG = 1.0, 0.01
"""Drift per minute that is negligible."""


@dataclass(frozen=True)
class Drift:
    """Stationary drift of several drives under one condition.

    Attributes:
        seconds: Time at rest.
        mm: Translation error per minute, over all stops.
        deg: Rotation error per minute, over all stops.
        mm_of_drives: Mean over drives of the translation error per minute.
        deg_of_drives: Mean over drives of the rotation error per minute.
    """

    seconds: float
    mm: float
    deg: float
    mm_of_drives: Interval
    deg_of_drives: Interval

    @property
    def negligible(self) -> bool:
        """Whether both errors are negligible."""
        return self.mm < MAX_MM and self.deg < MAX_DEG


@dataclass(frozen=True)
class Stops:
    """Runs and their stationary drift, each by label of the condition and variant."""

    runs: Mapping[tuple[str, Variant], Sequence[Result]]
    drift: Mapping[tuple[str, Variant], Drift]


def measure(results: Results) -> Stops:
    """Compute the stationary drift of every variant under every condition."""
    runs = {
        (label, v): [x for x in results.of(v) if x.job.recording.disturb == disturb]
        for (label, disturb), v in product(CONDITIONS.items(), SHOWN)
    }
    return Stops(runs, {key: _drift(of) for key, of in runs.items()})


def stops(run: Result) -> list[tuple[int, int]]:
    """Return the first and last row, among the poses, of every time that the camera is at rest."""
    pair = run.pair
    time_s, T = pair.timestamps_ns * 1e-9, pair.T_world_cam
    speed = np.diff(pair.travelled_m) / np.diff(time_s)
    turn_deg = np.degrees([se3.rotation_angle(se3.inverse(a) @ b) for a, b in pairwise(T)])
    rests = (speed < REST_MPS) & (turn_deg / np.diff(time_s) < REST_DEG_PER_S)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rests, [False]])))
    ends = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [(a, b) for a, b in ends if time_s[b] - time_s[a] > MIN_STOP_S]


def stationary_drift(run: Result) -> tuple[float, float, float]:
    """Return the time of all stops, s, and the motion error in them, mm and degrees."""
    starts, ends = np.array(stops(run), dtype=int).reshape(-1, 2).T
    seconds = (run.pair.timestamps_ns[ends] - run.pair.timestamps_ns[starts]).sum() * 1e-9
    errors = errors_between(run.pair, starts, ends)
    moved_mm = 1e3 * float(errors.translation_m.sum())
    return float(seconds), moved_mm, float(np.degrees(errors.rotation_rad.sum()))


def _drift(runs: Sequence[Result]) -> Drift:
    seconds, mm, deg = np.array([stationary_drift(x) for x in runs]).T
    minutes = seconds / 60
    return Drift(
        float(seconds.sum()),
        float(mm.sum() / minutes.sum()),
        float(deg.sum() / minutes.sum()),
        mean_interval(mm / minutes, minimum=0),
        mean_interval(deg / minutes, minimum=0),
    )


def _conclude(found: Stops) -> Finding:
    rests, cured = (
        all(found.drift[label, variant].negligible for label in CONDITIONS)
        for variant in (THESIS, BY_IMAGE)
    )
    sentences = (_sentence(label, found) for label in CONDITIONS)
    return Verdict.of(not rests, cured), " ".join(sentences)


def _sentence(label: str, found: Stops) -> str:
    drifts = [found.drift[label, variant] for variant in SHOWN]
    thesis, without, image, wheels = (f"{x.mm:.3f} mm and {x.deg:.4f}°" for x in drifts)
    return (
        f"{label.capitalize()} ({drifts[0].seconds:.0f} s at rest), the stationary drift per "
        f"minute is {thesis} with the thesis preset and, with the default settings, {without} "
        f"without detection, {image} with detection by image, and {wheels} with detection by image "
        "and encoders."
    )


def _table(found: Stops) -> Rows:
    drifts = {k: np.array([x.drift_percent for x in runs]) for k, runs in found.runs.items()}
    return [
        {
            "condition": label,
            "variant": variant.label,
            "stationary drift, mm per minute": drift.mm_of_drives.text(3),
            "stationary drift, ° per minute": drift.deg_of_drives.text(4),
            "drift over 1 m, %": mean_text(drifts[label, variant]),
        }
        for (label, variant), drift in found.drift.items()
    ]


def _data(found: Stops) -> Data:
    return {
        f"halts, {x}": {f"{v.label}, mm": _errors_at_rest(found.runs[x, v][0])[1] for v in SHOWN}
        for x in CONDITIONS
    }


def _errors_at_rest(run: Result) -> tuple[Array, Array, list[float]]:
    """Return seconds at rest so far, the error since the stop began, mm, and the ends of stops."""
    times_s, errors_mm, ends_s = [np.zeros(0)], [np.zeros(0)], [0.0]
    for a, b in stops(run):
        within = np.arange(a, b + 1)
        time_s = (run.pair.timestamps_ns[within] - run.pair.timestamps_ns[a]) * 1e-9
        errors = errors_between(run.pair, np.full_like(within, a), within)
        times_s.append(ends_s[-1] + time_s)
        errors_mm.append(1e3 * errors.translation_m)
        ends_s.append(ends_s[-1] + float(time_s[-1]))
    return np.concatenate(times_s), np.concatenate(errors_mm), ends_s[1:]


def _draw(figure: Figure, found: Stops) -> None:
    panels = figure.subplots(1, len(CONDITIONS), sharey=True)
    for panel, label in zip(panels, CONDITIONS, strict=True):
        for variant, colour in SHOWN.items():
            times_s, errors_mm, ends_s = _errors_at_rest(found.runs[label, variant][0])
            errors_mm = np.maximum(errors_mm, MIN_SHOWN_MM)
            panel.plot(times_s, errors_mm, color=colour, lw=1.0, label=variant.label)
            for end_s in ends_s:
                panel.axvline(end_s, color=GREY, lw=0.6)
        panel.set_yscale("log")
        seed = found.runs[label, THESIS][0].job.recording.seed
        tidy(panel, "time at rest, s", "", f"stop_and_go, {label}, seed {seed}")
    panels[0].set_ylabel("error since the stop began, mm")
    names = panels[0].get_legend_handles_labels()
    figure.legend(*names, ncols=4, loc="outside lower center")


E11 = Experiment(
    id="E11",
    title="Stationary drift",
    claim="The pose of a stationary camera drifts; detecting by wheels or images whether there is "
    "motion helps.",
    source="section 5.1.3",
    setup="Stops of ten seconds in the hall of stop_and_go, undisturbed and with strong noise: the "
    "thesis preset, and the default settings without detection of rest, with detection by image, "
    "and by image and encoders. Drift is the error against the truth, as tyres creep at rest. "
    f"Negligible: less than {MAX_MM:g} mm and {MAX_DEG:g}° per minute.",
    caption="Error of the motion since the stop began, against the truth, over the stops of the "
    "first seed in sequence; grey lines separate them. Values below 0.001 mm are drawn there.",
    size_in=(9.0, 3.4),
    recordings=lambda scale: [
        Recording("stop_and_go", seed, (*scale.with_length(LENGTH_M).drive, *STOPS), disturb)
        for disturb, seed in product(CONDITIONS.values(), scale.seeds)
    ],
    variants=SHOWN,
    steps=Steps(_conclude, _table, _draw, _data, measure),
)
