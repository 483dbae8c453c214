"""The simulated camera, light and scene that come nearest to a real recording."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from sim.camera_settings import SensorSettings
from sim.cameras import camera_overrides
from sim.settings import DriveSettings, RigSettings
from trials.execution.cache import CACHE
from trials.execution.jobs import Recording
from trials.execution.recording_settings import parse_scenes
from trials.execution.runner import NO_LABELS, cached_recording, record_all
from trials.realism.camera_estimates import (
    CameraSetting,
    estimate_drops,
    estimate_light,
    estimate_noise,
    estimate_response,
    estimate_softness,
)
from trials.realism.camera_match import CameraMatch
from trials.realism.comparison import Comparison, Progress, compare_measured
from trials.realism.geometry_estimates import estimate_ground, estimate_motion
from trials.realism.measure import measure
from trials.realism.quantities import Measured
from trials.realism.twin_corrections import Values, corrected, with_fitted_curve, with_speed
from vo.contract.files import write_text
from vo.contract.sequence import StereoSequence
from vo.contract.settings import Settings, overrides_of
from vo.recordings.readers import open_sequence

SCENE_FRAMES, TWIN_FRAMES = 10, 50
"""Frames of each scene that are recorded to find the nearest one, and of the nearest."""
ROUNDS = (with_speed, with_fitted_curve, corrected)
"""Corrections of the camera by its twin, one after the other; each needs a new twin."""
MAX_DISTANCE_M = 80.0
DEFAULT = Recording("office", 0, ("drive.distance_m=1.2", *camera_overrides("ideal"), *NO_LABELS))
"""The default picture, by the perfect camera."""
CONTENT = (
    *("grey", "gradient", "power", "features", "coverage", "stereo_matches", "matches"),
    *("inlier_ratio", "stereo_residual", "residual", "disparity", "motion", "track_length"),
)
"""Quantities whose mean distance tells which scene is nearest."""
BY_TWIN = "corrected until the twin is measured as the real recording is"


def match_camera(
    real: Path,
    out: Path | None = None,
    scenes: str = "all",
    frames: int = 100,
    progress: Progress | None = None,
    cache: Path = CACHE,
) -> CameraMatch:
    """Estimate the camera of a recording, find the nearest scene with it, and write its file.

    Raises:
        DriftyardError: If the recording is unreadable, a scene unknown, or there is no OpenGL.
    """
    wanted = parse_scenes(scenes) if scenes else []
    sequence = open_sequence(real)
    measured = measure(real, frames, progress=progress)
    response = estimate_response(measured)
    linear = measured
    if response != "srgb" and not wanted:
        linear = measure(real, frames, response, progress)
    estimates = [
        *_rig(sequence, measured),
        CameraSetting("sensor.response", response, note="explains the noise better"),
        CameraSetting("sensor.auto_exposure", False, note="the curve holds the brightness"),
        *map(_within_range, estimate_noise(measured, response)),
        *map(_within_range, [estimate_softness(linear), *estimate_light(linear)]),
        estimate_drops(sequence.timestamps_ns),
    ]
    found = CameraMatch(measured.name, estimates)
    if wanted:
        found = _with_twin(found, measured, wanted, cache, progress)
    if out is not None:
        write_text(out, found.toml())
    return found


def _with_twin(
    found: CameraMatch,
    real: Measured,
    scenes: Sequence[str],
    cache: Path,
    progress: Progress | None,
) -> CameraMatch:
    """Record scenes with the camera, and correct it by the nearest one."""
    recordings = [twin_recording(found.values, x, SCENE_FRAMES) for x in scenes]
    if len(scenes) > 1:
        folders = record_all(recordings, cache, _counted(progress, len(scenes)))
        compared = {
            scene: compare_measured(real, measure(folder, min(SCENE_FRAMES, real.frames)))
            for scene, folder in zip(scenes, folders, strict=True)
        }
        order = sorted(compared, key=lambda x: mean_distance(compared[x]))
        found = replace(found, scenes={x: mean_distance(compared[x]) for x in order})
        scenes = order
    for k, correct in enumerate((*ROUNDS, None)):
        count = min(SCENE_FRAMES if correct else TWIN_FRAMES, real.frames)
        recording = twin_recording(found.values, scenes[0], count)
        twin = measure(cached_recording(recording, cache), count)
        if correct:
            found = _with_values(found, correct(found.values, real, twin))
        else:
            comparison = compare_measured(real, twin)
            known = found.scenes or {scenes[0]: mean_distance(comparison)}
            found = replace(found, comparison=comparison, twin=recording, scenes=known)
        if progress:
            progress(k + 1, len(ROUNDS) + 1)
    plain = measure(cached_recording(DEFAULT, cache), min(TWIN_FRAMES, real.frames))
    return replace(found, default=compare_measured(real, plain))


def _counted(progress: Progress | None, total: int):
    done = 0

    def advance(_: object) -> None:
        nonlocal done
        done += 1
        if progress:
            progress(done, total)

    return advance


def _with_values(found: CameraMatch, values: Mapping[str, float]) -> CameraMatch:
    """Replace values of settings; intervals move along."""
    estimates = {x.key: x for x in found.estimates}
    for key, value in values.items():
        old = estimates.get(key, CameraSetting(key, None))
        shift = value - old.value if isinstance(old.value, int | float) else math.nan
        ends = max(old.low + shift, 0.0), old.high + shift
        low, high = ends if math.isfinite(old.low) else (math.nan, math.nan)
        estimates[key] = _within_range(CameraSetting(key, value, low, high, BY_TWIN))
    return replace(found, estimates=list(estimates.values()))


def twin_recording(values: Values, scene: str, frames: int) -> Recording:
    """Return the recording of a scene with a camera: of enough frames, soon at full speed."""
    default = DriveSettings().speed_mps
    rate_hz = float(values.get("rig.rate_hz", RigSettings().rate_hz))
    speed = float(values.get("drive.speed_mps", default))
    acceleration = min(max(speed * rate_hz / 2, 0.3), 3.0)
    distance_m = speed * (frames / rate_hz) + speed**2 / acceleration
    drive = {
        "drive.acceleration_mps2": round(acceleration, 3),
        "drive.lookahead_m": round(min(max(1.2 * speed, 0.35), 2.0), 3),
        "drive.distance_m": round(min(distance_m, MAX_DISTANCE_M), 2),
    }
    return Recording(scene, 0, (*overrides_of({**values, **drive}), *NO_LABELS))


def mean_distance(comparison: Comparison) -> float:
    """Return the mean of the known distances of CONTENT; infinite without any."""
    known = [x for name in CONTENT if (x := comparison.distances[name].value) is not None]
    return float(np.mean(known)) if known else math.inf


def _rig(sequence: StereoSequence, measured: Measured) -> list[CameraSetting]:
    """Return what the calibration, the times, the ground and the path say of the rig."""
    rig, note = sequence.rig, "of the calibration"
    hfov_deg = math.degrees(2 * math.atan(rig.width_px / 2 / rig.f_px))
    found = [
        CameraSetting("rig.width_px", rig.width_px, note=note),
        CameraSetting("rig.height_px", rig.height_px, note=note),
        CameraSetting("rig.hfov_deg", round(hfov_deg, 4), note=note),
        CameraSetting("rig.baseline_m", round(rig.baseline_m, 5), note=note),
        *estimate_ground(measured.landmarks, rig),
    ]
    steps_m, scale = measured.steps_m, _scale(found)
    if scale != 1:
        of_size = ("rig.baseline_m", "rig.height_m")
        note = f"and {scale:.3g} times as large as it is, as the speed: the rover has this height"
        found = [
            replace(x, value=round(x.value * scale, 5), note=f"{x.note}, {note}")
            if x.key in of_size and isinstance(x.value, float) else x
            for x in found
        ]  # fmt: skip
    if len(sequence) > 1:
        period_s = float(np.median(np.diff(sequence.timestamps_ns))) * 1e-9
        found += estimate_motion(steps_m * scale, period_s)
    return [_within_range(x) for x in found]


def _scale(found: Sequence[CameraSetting]) -> float:
    """Return the size of the twin over the real one: images do not tell it, the rover limits it."""
    height = next(x.value for x in found if x.key == "rig.height_m")
    if not isinstance(height, float):
        return 1.0
    low, high = _limits("rig", "height_m")
    return min(max(height, low), high) / height


def _limits(group: str, name: str) -> tuple[float, float]:
    models = {"rig": RigSettings, "drive": DriveSettings, "sensor": SensorSettings}
    model: type[Settings] = models[group]
    limits = {type(x).__name__: x for x in model.model_fields[name].metadata}
    low = getattr(limits.get("Ge"), "ge", -math.inf)
    return low, getattr(limits.get("Le"), "le", math.inf)


def _within_range(setting: CameraSetting) -> CameraSetting:
    """Return a setting within the range that is accepted, with a note if it is beyond."""
    group, _, name = setting.key.partition(".")
    low, high = _limits(group, name)
    value = setting.value
    if value is None or isinstance(value, str | bool) or low <= value <= high:
        return setting
    note = f"{value:g} {setting.note} is beyond the range of the setting"
    return replace(setting, value=min(max(value, low), high), note=note)
