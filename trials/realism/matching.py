"""The simulated camera, light and scene that come nearest to a real recording."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from sim.camera_names import IDEAL
from sim.camera_settings import SensorSettings
from sim.settings import DriveSettings, RigSettings
from trials.execution.cache import CACHE
from trials.execution.jobs import Recording
from trials.execution.recording_settings import parse_scenes
from trials.execution.runner import NO_LABELS, cached_recording
from trials.realism.camera_estimates import (
    CameraSetting,
    estimate_drops,
    estimate_light,
    estimate_noise,
    estimate_response,
    estimate_softness,
)
from trials.realism.camera_match import CameraMatch
from trials.realism.comparison import Progress, compare_measured
from trials.realism.geometry_estimates import estimate_ground, estimate_motion
from trials.realism.quantities import Measured
from trials.realism.saved_measures import saved_measure
from trials.realism.twin_corrections import with_fitted_curve, with_speed
from trials.realism.twins import (
    LAYOUTS,
    SCENE_FRAMES,
    far_by_default,
    nearest_twins,
    places_of,
    twin_recording,
)
from vo.contract.files import write_text
from vo.contract.sequence import StereoSequence
from vo.contract.settings import Settings
from vo.recordings.readers import open_sequence

TWIN_FRAMES = 50
"""Frames of the twin that is compared."""
PERFECT = Recording("office", 0, ("drive.distance_m=1.2", *NO_LABELS), camera=IDEAL)
"""The picture that a twin must be nearer than."""
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
    measured = saved_measure(real, frames, cache, progress=progress)
    response = estimate_response(measured)
    linear = measured
    if response != "srgb" and not wanted:
        linear = saved_measure(real, frames, cache, response, progress)
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
    count = min(TWIN_FRAMES, real.frames)
    plain = saved_measure(cached_recording(PERFECT, cache), count, cache)
    default = compare_measured(real, plain)
    tried = [(x, 0) for x in places_of(scenes)]
    near = nearest_twins(found.values, default, tried, cache, progress)
    order = {place.label: ratio for (place, _), ratio in near.items()}
    place = next(iter(near))[0]
    others = [(place, seed) for seed in range(1, LAYOUTS)]
    near |= nearest_twins(found.values, default, others, cache, progress)
    seeds = sorted(range(LAYOUTS), key=lambda seed: near[place, seed])
    curve = partial(with_fitted_curve, far=far_by_default(default))
    for k, correct in enumerate((with_speed, curve, with_speed, None)):
        count = min(SCENE_FRAMES if correct else TWIN_FRAMES, real.frames)
        recording = twin_recording(found.values, place, count, real, seeds[0])
        twin = saved_measure(cached_recording(recording, cache), count, cache)
        if correct:
            found = _with_values(found, correct(found.values, real, twin))
        else:
            comparison = compare_measured(real, twin)
            found = replace(found, comparison=comparison, twin=recording)
        if progress:
            progress(k + 1, 4)
    return replace(found, scenes=order, place=place, default=default, seeds=seeds)


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
