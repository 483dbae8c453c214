"""E11: standing still drifts, unless it is recognised (thesis 5.1.3)."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from trials.experiments.experiment import (
    Experiment,
    Findings,
    Scale,
    TableOf,
    Verdict,
    ragged,
)
from trials.intervals import mean_interval
from trials.metrics import errors_between
from trials.outcomes import Outcome, Outcomes, Recording, Trial, Variant, crossed
from trials.report.figure import BLUE, GREEN, GREY, OCHRE, RED, tidy
from vo.contract import se3

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HALT = ("drive.stop_every_m=0.9", "drive.stop_s=10")
UNAWARE = Variant("thesis", "thesis")
FOLLOWING = Variant("default, unaware", "driftyard", ("standing=none",))
BY_IMAGE = Variant("default, by image", "driftyard", ("standing=image",))
BY_WHEELS = Variant("default, by image and encoders", "driftyard", ("standing=encoders",))
SHOWN = ((UNAWARE, RED), (FOLLOWING, BLUE), (BY_IMAGE, OCHRE), (BY_WHEELS, GREEN))
AT_REST_MPS, AT_REST_DEG_PER_S = 1e-3, 0.01
LEAST_S = 1.0
"""A halt is no shorter."""
MOST_MM, MOST_DEG = 1.0, 0.01
"""Drift in a minute that counts as none."""


def trials(scale: Scale) -> Sequence[Trial]:
    """Drives that halt for ten seconds every 0.9 m, with a sensor's noise."""
    short = replace(scale, distance_m=0.6 * scale.distance_m).drive
    return crossed(
        [Recording("stop_and_go", seed, (*short, *HALT), "noise") for seed in scale.seeds],
        [v for v, _ in SHOWN],
    )


def halts(run: Outcome) -> list[tuple[int, int]]:
    """First and last row, among the poses, of every time that the camera truly stood still."""
    pair = run.pair
    time_s, T = pair.timestamps_ns * 1e-9, pair.T_world_cam
    speed = np.diff(pair.travelled_m) / np.diff(time_s)
    turn_deg = np.degrees([se3.rotation_angle(se3.inverse(a) @ b) for a, b in pairwise(T)])
    rests = (speed < AT_REST_MPS) & (turn_deg / np.diff(time_s) < AT_REST_DEG_PER_S)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rests, [False]])))
    ends = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [(a, b) for a, b in ends if time_s[b] - time_s[a] > LEAST_S]


def drift_at_rest(run: Outcome) -> tuple[float, float, float]:
    """Length of all halts in seconds, and the error of the motion in them: mm, degrees in all."""
    starts, ends = np.array(halts(run), dtype=int).reshape(-1, 2).T
    seconds = (run.pair.timestamps_ns[ends] - run.pair.timestamps_ns[starts]).sum() * 1e-9
    errors = errors_between(run.pair, starts, ends)
    moved_mm = 1e3 * float(errors.translation_m.sum())
    return float(seconds), moved_mm, float(np.degrees(errors.rotation_rad.sum()))


def analyse(outcomes: Outcomes) -> Findings:
    """Add up by how much the pose errs while the camera stands."""
    rows: list[tuple[str, ...]] = []
    moved: dict[str, float] = {}
    turned: dict[str, float] = {}
    total_s = 0.0
    for variant, _ in SHOWN:
        found = np.array([drift_at_rest(x) for x in outcomes.of(variant)])
        minutes = found[:, 0] / 60
        total_s = float(found[:, 0].sum())
        moved[variant.label] = float(found[:, 1].sum() / minutes.sum())
        turned[variant.label] = float(found[:, 2].sum() / minutes.sum())
        rows.append(
            (
                variant.label,
                mean_interval(found[:, 1] / minutes, least=0).text(3),
                mean_interval(found[:, 2] / minutes, least=0).text(4),
                mean_interval(outcomes.drifts(variant), least=0).text(3),
            )
        )
    drifts = moved[UNAWARE.label] > MOST_MM or turned[UNAWARE.label] > MOST_DEG
    cured = moved[BY_IMAGE.label] < MOST_MM and turned[BY_IMAGE.label] < MOST_DEG
    verdict = Verdict.HOLDS if drifts and cured else Verdict.PARTLY
    verdict = verdict if drifts else Verdict.FAILS
    return Findings(
        verdict,
        f"In a minute of standing still the thesis preset drifts by {moved[UNAWARE.label]:.2f} mm "
        f"and {turned[UNAWARE.label]:.3f}°; the default settings, unaware of it, by "
        f"{moved[FOLLOWING.label]:.3f} mm and {turned[FOLLOWING.label]:.4f}°, by image by "
        f"{moved[BY_IMAGE.label]:.3f} mm and {turned[BY_IMAGE.label]:.4f}°, by image and encoders "
        f"by {moved[BY_WHEELS.label]:.3f} mm and {turned[BY_WHEELS.label]:.4f}° "
        f"({total_s:.0f} s of halts).",
        TableOf(
            (
                "variant",
                "drift while standing, mm a minute",
                "drift while standing, ° a minute",
                "drift over 1 m, %",
            ),
            tuple(rows),
        ),
        "Error of the motion since the halt began, against the truth, over the halts of the first "
        "seed one after the other; grey lines part them.",
        lambda figure: _draw(figure, outcomes),
        {
            "halts": ragged(
                **{f"{v.label}, mm": _wander(outcomes.at(outcomes.recordings[0], v))[1]
                   for v, _ in SHOWN}
            )
        },
    )  # fmt: skip


def _wander(run: Outcome) -> tuple[np.ndarray, np.ndarray, list[float]]:
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


def _draw(figure: "Figure", outcomes: Outcomes) -> None:
    panel = figure.subplots()
    first = outcomes.recordings[0]
    for variant, colour in SHOWN:
        times_s, away_mm, ends = _wander(outcomes.at(first, variant))
        panel.plot(times_s, np.maximum(away_mm, 1e-4), color=colour, lw=1.0, label=variant.label)
        for end in ends:
            panel.axvline(end, color=GREY, lw=0.6)
    panel.set_yscale("log")
    figure.legend(fontsize=8, frameon=False, ncols=4, loc="outside lower center")
    tidy(panel, "time stood still, s", "error since the halt began, mm",
         f"stop_and_go with noise, seed {first.seed}")  # fmt: skip


EXPERIMENT = Experiment(
    id="E11",
    title="Standing still",
    claim="Standing still drifts; it helps to detect whether there is motion, by wheels or images.",
    source="section 5.1.3",
    setup="Halts of ten seconds in the hall of stop_and_go, with the noise of a small sensor: the "
    "thesis preset, and the default settings unaware of standing, by image, and by image and "
    "encoders. Drift is the error against the truth, for standing tyres creep. None: less than "
    f"{MOST_MM:g} mm and {MOST_DEG:g}° a minute.",
    size_in=(9.0, 3.4),
    trials=trials,
    analyse=analyse,
)
