"""E11: drift of a stationary camera, and its detection (thesis 5.1.3)."""

from itertools import pairwise, product

import numpy as np
from matplotlib.figure import Figure

from trials.evaluation.metrics import errors_between
from trials.execution.jobs import Result, Results, Variant
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


def _runs(results: Results, condition: str, variant: Variant) -> list[Result]:
    disturb = CONDITIONS[condition]
    return [x for x in results.of(variant) if x.job.recording.disturb == disturb]


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


def _per_minute(results: Results, condition: str, variant: Variant) -> tuple[float, float]:
    """Return the stationary drift over all stops, mm and degrees per minute."""
    runs = _runs(results, condition, variant)
    seconds, mm, deg = np.sum([stationary_drift(x) for x in runs], axis=0)
    return mm / (seconds / 60), deg / (seconds / 60)


def _conclude(results: Results) -> Finding:
    drifts = {k: _per_minute(results, *k) for k in product(CONDITIONS, SHOWN)}
    negligible = {k: mm < MAX_MM and deg < MAX_DEG for k, (mm, deg) in drifts.items()}
    rests, cured = (all(negligible[c, v] for c in CONDITIONS) for v in (THESIS, BY_IMAGE))
    sentences: list[str] = []
    for condition in CONDITIONS:
        seconds = sum(stationary_drift(x)[0] for x in _runs(results, condition, THESIS))
        thesis, without, image, wheels = (
            "{:.3f} mm and {:.4f}°".format(*drifts[condition, v]) for v in SHOWN
        )
        sentences.append(
            f"{condition.capitalize()} ({seconds:.0f} s at rest), the stationary drift per minute "
            f"is {thesis} with the thesis preset and, with the default settings, {without} without "
            f"detection, {image} with detection by image, and {wheels} with detection by image and "
            "encoders."
        )
    return Verdict.of(not rests, cured), " ".join(sentences)


def _table(results: Results) -> Rows:
    for condition, variant in product(CONDITIONS, SHOWN):
        runs = _runs(results, condition, variant)
        seconds, mm, deg = np.array([stationary_drift(x) for x in runs]).T
        yield {
            "condition": condition,
            "variant": variant.label,
            "stationary drift, mm per minute": mean_text(mm / (seconds / 60)),
            "stationary drift, ° per minute": mean_text(deg / (seconds / 60), 4),
            "drift over 1 m, %": mean_text(np.array([x.drift_percent for x in runs])),
        }


def _data(results: Results) -> Data:
    first = {k: _runs(results, *k)[0] for k in product(CONDITIONS, SHOWN)}
    return {
        f"halts, {x}": {f"{v.label}, mm": _errors_at_rest(first[x, v])[1] for v in SHOWN}
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


def _draw(figure: Figure, results: Results) -> None:
    panels = figure.subplots(1, len(CONDITIONS), sharey=True)
    seed = results.recordings[0].seed
    for panel, condition in zip(panels, CONDITIONS, strict=True):
        for variant, colour in SHOWN.items():
            run = _runs(results, condition, variant)[0]
            times_s, errors_mm, ends_s = _errors_at_rest(run)
            errors_mm = np.maximum(errors_mm, MIN_SHOWN_MM)
            panel.plot(times_s, errors_mm, color=colour, lw=1.0, label=variant.label)
            for end_s in ends_s:
                panel.axvline(end_s, color=GREY, lw=0.6)
        panel.set_yscale("log")
        tidy(panel, "time at rest, s", "", f"stop_and_go, {condition}, seed {seed}")
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
        scale.with_length(LENGTH_M).recording("stop_and_go", seed, STOPS, disturb)
        for disturb, seed in product(CONDITIONS.values(), scale.seeds)
    ],
    variants=SHOWN,
    steps=Steps(_conclude, _table, _draw, _data),
)
