"""The stretch of a scene's route on which a camera turns as a real one did."""

from functools import lru_cache

import cv2
import numpy as np

from scenes.geometry.routes import arc_lengths
from sim.batch import build
from sim.world.path import CLOSED_WITHIN_M
from trials.execution.recording_settings import recording_settings
from vo.contract.arrays import Array

STARTS = 80
"""Number of places at which a stretch may begin."""
CHORD_M = 0.8
"""Length over which the heading of a route is taken: the rover cuts corners."""
TOLERANCE_M = 0.02
QUANTILES = np.linspace(0.05, 0.95, 19)


@lru_cache(maxsize=64)
def route_of(scene: str, seed: int, options: tuple[str, ...] = ()) -> Array:
    """Return the waypoints (N, 2) of the route of a scene with options, world metres."""
    settings = recording_settings(scene, seed, options)
    return np.asarray(build(scene, settings).routes[settings.drive.route], dtype=float)


def stretch_of(route: Array, length_m: float, step_m: float, turns: Array) -> Array | None:
    """Return the waypoints (K, 2) of the stretch whose turns are nearest to those wanted.

    Nearest is the smallest mean difference of the quantiles of the turns' sizes. A closed route
    may begin anywhere; None for one that is shorter than the stretch, which leaves no choice.

    Args:
        route: (N, 2) waypoints, m.
        length_m: Of the stretch.
        step_m: Distance from frame to frame.
        turns: (M,) wanted turns from frame to frame, radians.
    """
    marks = arc_lengths(route)
    whole_m = float(marks[-1])
    spare_m = whole_m - length_m
    if spare_m <= 0 or not len(turns):
        return None
    closed = bool(np.linalg.norm(route[-1] - route[0]) <= CLOSED_WITHIN_M)
    starts = np.linspace(0, whole_m if closed else spare_m, STARTS, endpoint=not closed)
    frames = np.arange(0, length_m, step_m)
    wanted = np.quantile(abs(turns), QUANTILES)

    def at(s_m: Array) -> Array:
        s_m = s_m % whole_m if closed else np.clip(s_m, 0, whole_m)
        return np.stack([np.interp(s_m, marks, route[:, k]) for k in (0, 1)], axis=-1)

    def misfit(start_m: float) -> float:
        chords = at(start_m + frames + CHORD_M / 2) - at(start_m + frames - CHORD_M / 2)
        headings = np.unwrap(np.arctan2(chords[:, 1], chords[:, 0]))
        made = np.quantile(abs(np.diff(headings)), QUANTILES) if len(frames) > 1 else 0.0
        return float(abs(made - wanted).mean())

    best_m = min(starts, key=misfit)
    points = at(best_m + np.arange(0, length_m + 0.05, 0.05)).astype(np.float32)
    return cv2.approxPolyDP(points[:, None], TOLERANCE_M, closed=False)[:, 0].astype(np.float64)
