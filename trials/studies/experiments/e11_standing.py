"""E11: standing still drifts, unless it is recognised (thesis 5.1.3)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import TYPE_CHECKING

import numpy as np

from trials.evaluation.intervals import Interval, mean_interval
from trials.evaluation.metrics import errors_between
from trials.execution.jobs import Job, Recording, Result, Results, Variant, jobs_of
from trials.report.figure import BLUE, GREEN, GREY, OCHRE, RED, tidy
from trials.studies.experiments.experiment import (
    Experiment,
    Findings,
    Scale,
    TableOf,
    Verdict,
    ragged,
)
from vo.contract import se3

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CONDITIONS = {"undisturbed": "", "with noise": "noise"}
"""Label to disturbance."""
HALT = ("drive.stop_every_m=0.9", "drive.stop_s=10")
UNAWARE = Variant("thesis", "thesis")
FOLLOWING = Variant("default, unaware", "driftyard", ("stationary=none",))
BY_IMAGE = Variant("default, by image", "driftyard", ("stationary=image",))
BY_WHEELS = Variant("default, by image and encoders", "driftyard", ("stationary=encoders",))
SHOWN = ((UNAWARE, RED), (FOLLOWING, BLUE), (BY_IMAGE, OCHRE), (BY_WHEELS, GREEN))
AT_REST_MPS, AT_REST_DEG_PER_S = 1e-3, 0.01
LEAST_S = 1.0
"""A halt is no shorter."""
LEAST_MM = 1e-3
"""What is less is drawn there, for the axis is logarithmic."""
MOST_MM, MOST_DEG = 1.0, 0.01
"""Drift in a minute that counts as none."""


def jobs(scale: Scale) -> Sequence[Job]:
    """Drives that halt for ten seconds every 0.9 m, undisturbed and with a sensor's noise."""
    short = (*replace(scale, distance_m=0.6 * scale.distance_m).drive, *HALT)
    return jobs_of(
        [
            Recording("stop_and_go", seed, short, disturb)
            for disturb, seed in product(CONDITIONS.values(), scale.seeds)
        ],
        [v for v, _ in SHOWN],
    )


def halts(run: Result) -> list[tuple[int, int]]:
    """First and last row, among the poses, of every time that the camera truly stood still."""
    pair = run.pair
    time_s, T = pair.timestamps_ns * 1e-9, pair.T_world_cam
    speed = np.diff(pair.travelled_m) / np.diff(time_s)
    turn_deg = np.degrees([se3.rotation_angle(se3.inverse(a) @ b) for a, b in pairwise(T)])
    rests = (speed < AT_REST_MPS) & (turn_deg / np.diff(time_s) < AT_REST_DEG_PER_S)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rests, [False]])))
    ends = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [(a, b) for a, b in ends if time_s[b] - time_s[a] > LEAST_S]


def drift_at_rest(run: Result) -> tuple[float, float, float]:
    """Length of all halts in seconds, and the error of the motion in them: mm, degrees in all."""
    starts, ends = np.array(halts(run), dtype=int).reshape(-1, 2).T
    seconds = (run.pair.timestamps_ns[ends] - run.pair.timestamps_ns[starts]).sum() * 1e-9
    errors = errors_between(run.pair, starts, ends)
    moved_mm = 1e3 * float(errors.translation_m.sum())
    return float(seconds), moved_mm, float(np.degrees(errors.rotation_rad.sum()))


@dataclass(frozen=True)
class Drift:
    """Error of the motion while standing, of some drives under one condition.

    Attributes:
        seconds: Of all halts.
        mm: A minute, over all halts.
        deg: Likewise.
        mm_of_drives: The same a drive, with its interval.
        deg_of_drives: Likewise.
    """

    seconds: float
    mm: float
    deg: float
    mm_of_drives: Interval
    deg_of_drives: Interval

    @property
    def none(self) -> bool:
        """Whether it is too little to count."""
        return self.mm < MOST_MM and self.deg < MOST_DEG


def drift_of(runs: Sequence[Result]) -> Drift:
    """Add up by how much the pose errs while the camera stands."""
    seconds, mm, deg = np.array([drift_at_rest(x) for x in runs]).T
    minutes = seconds / 60
    return Drift(
        float(seconds.sum()),
        float(mm.sum() / minutes.sum()),
        float(deg.sum() / minutes.sum()),
        mean_interval(mm / minutes, least=0),
        mean_interval(deg / minutes, least=0),
    )


def analyse(results: Results) -> Findings:
    """Hold what every variant makes of a minute of standing against what counts as none."""
    runs = {
        (label, v): [x for x in results.of(v) if x.job.recording.disturb == disturb]
        for (label, disturb), (v, _) in product(CONDITIONS.items(), SHOWN)
    }
    found = {key: drift_of(of) for key, of in runs.items()}
    rows = tuple(
        (
            label,
            variant.label,
            drift.mm_of_drives.text(3),
            drift.deg_of_drives.text(4),
            mean_interval(np.array([x.drift_percent for x in runs[label, variant]]), 0).text(3),
        )
        for (label, variant), drift in found.items()
    )
    if all(found[label, UNAWARE].none for label in CONDITIONS):
        verdict = Verdict.FAILS
    else:
        cured = all(found[label, BY_IMAGE].none for label in CONDITIONS)
        verdict = Verdict.HOLDS if cured else Verdict.PARTLY
    return Findings(
        verdict,
        " ".join(_said(label, found) for label in CONDITIONS),
        TableOf(
            (
                "condition",
                "variant",
                "drift while standing, mm a minute",
                "drift while standing, ° a minute",
                "drift over 1 m, %",
            ),
            rows,
        ),
        "Error of the motion since the halt began, against the truth, over the halts of the first "
        "seed one after the other; grey lines part them. What is under 0.001 mm stands there.",
        lambda figure: _draw(figure, results),
        {
            f"halts, {label}": ragged(
                **{f"{v.label}, mm": _wander(runs[label, v][0])[1] for v, _ in SHOWN}
            )
            for label in CONDITIONS
        },
    )


def _said(label: str, found: Mapping[tuple[str, Variant], Drift]) -> str:
    """A sentence on one condition."""
    drifts = [found[label, variant] for variant, _ in SHOWN]
    thesis, unaware, image, wheels = (f"{x.mm:.3f} mm and {x.deg:.4f}°" for x in drifts)
    return (
        f"{label.capitalize()} ({drifts[0].seconds:.0f} s of halts), a minute of standing still "
        f"costs the thesis preset {thesis}, the default settings, unaware of it, {unaware}, by "
        f"image {image}, by image and encoders {wheels}."
    )


def _wander(run: Result) -> tuple[np.ndarray, np.ndarray, list[float]]:
    """Seconds of standing so far, mm of error since the halt began, and when each halt ends."""
    times: list[np.ndarray] = [np.zeros(0)]
    away: list[np.ndarray] = [np.zeros(0)]
    ends: list[float] = []
    so_far = 0.0
    for a, b in halts(run):
        within = np.arange(a, b + 1)
        time_s = (run.pair.timestamps_ns[a : b + 1] - run.pair.timestamps_ns[a]) * 1e-9
        times.append(so_far + time_s)
        away.append(1e3 * errors_between(run.pair, np.full_like(within, a), within).translation_m)
        so_far += float(time_s[-1])
        ends.append(so_far)
    return np.concatenate(times), np.concatenate(away), ends


def _draw(figure: "Figure", results: Results) -> None:
    panels = figure.subplots(1, len(CONDITIONS), sharey=True)
    seed = results.recordings[0].seed
    for panel, (label, disturb) in zip(panels, CONDITIONS.items(), strict=True):
        first = next(x for x in results.recordings if x.disturb == disturb)
        for variant, colour in SHOWN:
            times_s, away_mm, ends = _wander(results.at(first, variant))
            name = variant.label if panel is panels[0] else None
            panel.plot(times_s, np.maximum(away_mm, LEAST_MM), color=colour, lw=1.0, label=name)
            for end in ends:
                panel.axvline(end, color=GREY, lw=0.6)
        panel.set_yscale("log")
        tidy(panel, "time stood still, s", "error since the halt began, mm",
             f"stop_and_go, {label}, seed {seed}")  # fmt: skip
    panels[1].set_ylabel("")
    figure.legend(fontsize=8, frameon=False, ncols=4, loc="outside lower center")


EXPERIMENT = Experiment(
    id="E11",
    title="Standing still",
    claim="Standing still drifts; it helps to detect whether there is motion, by wheels or images.",
    source="section 5.1.3",
    setup="Halts of ten seconds in the hall of stop_and_go, undisturbed and with much noise: the "
    "thesis preset, and the default settings unaware of standing, by image, and by image and "
    "encoders. Drift is the error against the truth, for standing tyres creep. None: less than "
    f"{MOST_MM:g} mm and {MOST_DEG:g}° a minute.",
    size_in=(9.0, 3.4),
    jobs=jobs,
    analyse=analyse,
)
