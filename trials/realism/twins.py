"""Simulated twins of a real recording: where they drive, and which scene and layout is nearest."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.camera_names import IDEAL
from sim.settings import DriveSettings, RigSettings
from trials.execution.jobs import Recording
from trials.execution.runner import NO_LABELS, record_all
from trials.realism.comparison import Comparison, Progress, compare_measured
from trials.realism.geometry_estimates import SLOW
from trials.realism.quantities import SMALLEST, Measured
from trials.realism.saved_measures import saved_measure
from trials.realism.twin_corrections import Values, with_fitted_curve
from trials.realism.twin_route import route_of, stretch_of
from vo.contract.arrays import Array
from vo.contract.settings import overrides_of

CURVE_FRAMES, SCENE_FRAMES = 4, 10
"""Frames that are recorded to fit the curve of a scene, and to find the nearest scene."""
LAYOUTS = 3
"""Seeds of the nearest scene that are tried."""
UNKNOWN_RATIO = 3.0
"""Ratio that stands for a distance that is unknown, as for want of landmarks."""
MAX_DISTANCE_M, MAX_HALT_S = 80.0, 60.0
CONTENT = (
    *("grey", "gradient", "power", "features", "coverage", "stereo_matches", "matches"),
    *("inlier_ratio", "stereo_residual", "residual", "disparity", "motion", "track_length"),
)
"""Quantities whose mean ratio to the default picture tells which scene is nearest."""


@dataclass(frozen=True)
class Place:
    """A scene with options that are not its defaults, such as `scene.surround=hall`."""

    scene: str
    options: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """The scene, and its options if there are any."""
        return " ".join((self.scene, *self.options))


OTHER_PLACES = {"sandbox": [("scene.surround=hall",)]}
"""Options of scenes that make another place of them, which may be a twin too."""


def places_of(scenes: Sequence[str]) -> list[Place]:
    """Return the places that scenes may be."""
    return [Place(x, options) for x in scenes for options in ((), *OTHER_PLACES.get(x, []))]


def twin_recording(
    values: Values, place: Place, frames: int, real: Measured, seed: int = 0
) -> Recording:
    """Return the recording of a scene with a camera: of enough frames, soon at full speed.

    It drives where the scene's route turns as the real path did, and halts as long.
    """
    default = DriveSettings().speed_mps
    rate_hz = float(values.get("rig.rate_hz", RigSettings().rate_hz))
    speed = float(values.get("drive.speed_mps", default))
    acceleration = min(max(speed * rate_hz / 2, 0.3), 3.0)
    halts, still = halts_of(real.steps_m, frames)
    moving_s = (frames - still) / rate_hz
    distance_m = min(speed * moving_s + (1 + halts) * speed**2 / acceleration, MAX_DISTANCE_M)
    route = route_of(place.scene, seed, place.options)
    stretch = stretch_of(route, distance_m, speed / rate_hz, real.turns)
    drive = {
        "drive.acceleration_mps2": round(acceleration, 3),
        "drive.lookahead_m": round(min(max(1.2 * speed, 0.35), 2.0), 3),
    }
    if stretch is None:
        drive["drive.distance_m"] = round(distance_m, 2)
    else:
        drive["drive.waypoints"] = stretch.round(3).tolist()
    if halts:
        drive["drive.stop_every_m"] = round(distance_m / (1 + halts), 3)
        drive["drive.stop_s"] = round(min(still / halts / rate_hz, MAX_HALT_S), 3)
    settings = (*overrides_of({**values, **drive}), *place.options, *NO_LABELS)
    return Recording(place.scene, seed, settings, camera=IDEAL)


def halts_of(steps_m: Array, frames: int) -> tuple[int, float]:
    """Return how many halts a twin of so many frames has, and how many frames they take.

    Both are in proportion to those of the steps (M,) of the real recording; a halt of less than two
    frames is none.
    """
    if not len(steps_m):
        return 0, 0.0
    still = np.r_[False, steps_m <= SLOW * steps_m.max()]
    scale = frames / len(still)
    number = max(round((np.diff(still.astype(int)) > 0).sum() * scale), 1)
    taken = float(still.sum()) * scale
    return (number, taken) if taken >= 2 * number else (0, 0.0)


def nearest_twins(
    values: Values,
    default: Comparison,
    candidates: Sequence[tuple[Place, int]],
    cache: Path,
    progress: Progress | None = None,
) -> dict[tuple[Place, int], float]:
    """Record places of seeds with a camera; return their mean ratios, the nearest first.

    Each has the curve that brings it nearest, so that light and dark scenes are on a par.

    Args:
        values: Settings of the camera.
        default: The real recording beside the default picture.
        candidates: Places and seeds.
        cache: Of recordings.
        progress: Called with the number of recordings and that of all.
    """
    real, steps = default.real, 2 * len(candidates)
    done = 0

    def advance(_: object) -> None:
        nonlocal done
        done += 1
        if progress:
            progress(done, steps)

    def measured(of: Sequence[Values], frames: int) -> list[Measured]:
        recordings = [
            twin_recording(x, place, frames, real, seed)
            for x, (place, seed) in zip(of, candidates, strict=True)
        ]
        return [saved_measure(x, frames, cache) for x in record_all(recordings, cache, advance)]

    first = measured([values] * len(candidates), CURVE_FRAMES)
    far = far_by_default(default)
    fitted = [{**values, **with_fitted_curve(values, real, x, far)} for x in first]
    found = {
        which: mean_ratio(compare_measured(real, x), default)
        for which, x in zip(candidates, measured(fitted, SCENE_FRAMES), strict=True)
    }
    return dict(sorted(found.items(), key=lambda x: x[1]))


def far_by_default(default: Comparison) -> dict[str, float]:
    """Return the distances to the default picture, at least those by chance."""
    return {
        name: max(x.value, x.chance or 0, SMALLEST)
        for name, x in default.distances.items()
        if x.value is not None
    }


def mean_ratio(comparison: Comparison, default: Comparison) -> float:
    """Return the geometric mean, over CONTENT, of distances over those to the default picture."""
    logs: list[float] = []
    for name, far in far_by_default(default).items():
        x = comparison.distances[name]
        least = max(x.chance or 0, SMALLEST)
        if name in CONTENT:
            logs.append(np.log(UNKNOWN_RATIO if x.value is None else max(x.value, least) / far))
    return float(np.exp(np.mean(logs)))
