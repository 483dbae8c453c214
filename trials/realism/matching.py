"""The simulated camera, light and scene that come nearest to a real recording."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sim.camera_settings import SensorSettings
from sim.settings import RigSettings
from trials.evaluation.display import html_display, text_display
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
from trials.realism.comparison import Comparison, Progress, compare_measured, summary
from trials.realism.measure import measure
from trials.realism.quantities import QUANTITIES, Measured
from vo.contract.files import write_text
from vo.contract.sequence import StereoSequence
from vo.contract.settings import Settings
from vo.recordings.readers import open_sequence

SCENE_FRAMES = 24
"""Frames of each scene that are recorded to find the nearest one."""
SPEED_MPS, MAX_DISTANCE_M = 0.3, 4.0
GREY_TOLERANCE = 10.0
"""Difference of mean grey levels above which the automatic exposure is set to that of the real
recording."""
MAX_DISTANCE, MAX_ERRORS = 0.1, 3.0
"""Distance, and its number of errors beyond chance, above which a quantity is not matched."""
CONTENT = (
    *("grey", "gradient", "power", "features", "coverage", "stereo_matches", "matches"),
    *("inlier_ratio", "stereo_residual", "residual", "disparity"),
)
"""Quantities whose mean distance tells which scene is nearest."""
UNKNOWN = (
    "rig.height_m and rig.tilt_deg: nothing in the images tells the ground from a wall",
    "exposure.time_ms and exposure.line_time_us: motion blur and shutter are not estimated",
    "sensor.k1 to p2: images are compared as rectified",
    "black level and compression: there is no such setting, or it is not estimated",
)


@dataclass(frozen=True, repr=False)
class CameraMatch:
    """The camera that comes nearest to a real recording.

    Attributes:
        real: Name of the recording.
        estimates: Settings with their intervals; those without a value are not in the file.
        scenes: Mean distance of each scene that was tried, the nearest first.
        comparison: The real recording beside the nearest scene with this camera; None without.

    Example:
        >>> match = dy.match("ds", "camera.toml", scenes="")
        >>> match.values["rig.width_px"]
        160
    """

    real: str
    estimates: Sequence[CameraSetting]
    scenes: Mapping[str, float] = field(default_factory=dict[str, float])
    comparison: Comparison | None = None

    @property
    def values(self) -> dict[str, float | str | bool]:
        """Settings by `key.path`, as `driftyard generate --camera` takes them from a file."""
        return {x.key: x.value for x in self.estimates if x.value is not None}

    @property
    def unmatched(self) -> list[str]:
        """What could not be matched, in words: settings, and quantities of the nearest scene."""
        lacking = [f"{x.key}: {x.note}" for x in self.estimates if x.value is None]
        distances = self.comparison.distances.values() if self.comparison else ()
        far = [
            f"{QUANTITIES[x.quantity].label}: distance {x.text}, by chance {x.chance or 0:.3f}"
            for x in sorted(distances, key=lambda x: -(x.value or 0))
            if x.value is not None
            and x.value > MAX_DISTANCE + (x.chance or 0) + MAX_ERRORS * (x.error or 0)
        ]
        return [*lacking, *far, *UNKNOWN]

    def table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        """Return header and rows: key, estimate with interval, and how it was found."""
        return ("setting", "estimate", "note"), [(x.key, x.text, x.note) for x in self.estimates]

    def to_dict(self) -> dict[str, Any]:
        """Return everything as JSON takes it."""
        estimates = {
            x.key: {
                "value": x.value,
                "interval": [x.low, x.high] if math.isfinite(x.low) else None,
                "note": x.note,
            }
            for x in self.estimates
        }
        twin = self.comparison.to_dict() if self.comparison else None
        parts = {"scenes": dict(self.scenes), "unmatched": self.unmatched, "comparison": twin}
        return {"real": self.real, "settings": estimates, **parts}

    def toml(self) -> str:
        """Return the file of the camera, with intervals and what is not matched as comments."""
        lines = [f"# Camera nearest to {self.real}, by driftyard match."]
        if self.scenes:
            lines.append(f"# Nearest scene: {next(iter(self.scenes))}.")
        lines += [f"# Not matched: {x}." for x in self.unmatched]
        for group in dict.fromkeys(key.partition(".")[0] for key in self.values):
            lines += ["", f"[{group}]"]
            for x in self.estimates:
                section, _, name = x.key.partition(".")
                if section == group and x.value is not None:
                    about = ", ".join(filter(None, (x.text, x.note)))
                    lines.append(f"{name} = {_toml(x.value)}  # {about}")
        return "\n".join(lines) + "\n"

    def __repr__(self) -> str:
        return text_display(f"Camera of {self.real}", [(x.key, x.text) for x in self.estimates])

    def _repr_html_(self) -> str:
        return html_display(f"Camera of {self.real}", [r[:2] for r in self.table()[1]])


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
    if response != "srgb":
        linear = measure(real, frames, response, progress)
    estimates = [
        *_rig(sequence),
        CameraSetting("sensor.response", response, note="explains the noise better"),
        *map(_within_range, estimate_noise(measured, response)),
        *map(_within_range, [estimate_softness(linear), *estimate_light(linear)]),
        estimate_drops(sequence.timestamps_ns),
    ]
    found = CameraMatch(measured.name, estimates)
    if wanted:
        found = _with_nearest_scene(found, measured, wanted, cache, progress)
    if out is not None:
        write_text(out, found.toml())
    return found


def _with_nearest_scene(
    found: CameraMatch,
    real: Measured,
    scenes: Sequence[str],
    cache: Path,
    progress: Callable[[int, int], None] | None,
) -> CameraMatch:
    """Record scenes with the camera, at the real brightness; return it with their distances.

    The automatic exposure is one of its settings if the nearest scene needs it.
    """
    target = float(np.clip(_mean_grey(real), 10.0, 240.0))
    light = (
        CameraSetting("sensor.auto_exposure", True, note="the scene has another brightness"),
        CameraSetting("sensor.target_grey", round(target, 1), note="mean of the real recording"),
    )
    lit = replace(found, estimates=[*found.estimates, *light])
    compared: dict[str, Comparison] = {}
    for k, scene in enumerate(scenes):
        compared[scene] = _compare_scene(lit, real, scene, cache)
        if progress:
            progress(k + 1, len(scenes))
    order = sorted(compared, key=lambda x: mean_distance(compared[x]))
    plain = _compare_scene(found, real, order[0], cache)
    if abs(_mean_grey(plain.simulated) - _mean_grey(real)) <= GREY_TOLERANCE:
        best, comparison = found, plain
    else:
        best, comparison = lit, compared[order[0]]
    distances = {x: mean_distance(compared[x]) for x in order}
    return replace(best, scenes=distances, comparison=comparison)


def _mean_grey(measured: Measured) -> float:
    return summary(measured, "grey") or 0.0


def _compare_scene(found: CameraMatch, real: Measured, scene: str, cache: Path) -> Comparison:
    rate_hz = float(found.values.get("rig.rate_hz", RigSettings().rate_hz))
    distance_m = min(SPEED_MPS * (SCENE_FRAMES / rate_hz + 1), MAX_DISTANCE_M)
    values = {**found.values, "drive.distance_m": round(distance_m, 2)}
    overrides = tuple(f"{key}={_toml(value)}" for key, value in values.items())
    folder = cached_recording(Recording(scene, 0, (*overrides, *NO_LABELS)), cache)
    return compare_measured(real, measure(folder, min(SCENE_FRAMES, real.frames)))


def mean_distance(comparison: Comparison) -> float:
    """Return the mean of the known distances of CONTENT; infinite without any."""
    known = [x for name in CONTENT if (x := comparison.distances[name].value) is not None]
    return float(np.mean(known)) if known else math.inf


def _rig(sequence: StereoSequence) -> list[CameraSetting]:
    """Return what the calibration and the times say of the rig."""
    rig, note = sequence.rig, "of the calibration"
    hfov_deg = math.degrees(2 * math.atan(rig.width_px / 2 / rig.f_px))
    found = [
        CameraSetting("rig.width_px", rig.width_px, note=note),
        CameraSetting("rig.height_px", rig.height_px, note=note),
        CameraSetting("rig.hfov_deg", round(hfov_deg, 4), note=note),
        CameraSetting("rig.baseline_m", round(rig.baseline_m, 5), note=note),
    ]
    if len(sequence) > 1:
        period_s = float(np.median(np.diff(sequence.timestamps_ns))) * 1e-9
        found.append(CameraSetting("rig.rate_hz", round(1 / period_s, 3), note="of the times"))
    return [_within_range(x) for x in found]


def _within_range(setting: CameraSetting) -> CameraSetting:
    """Return a setting within the range that is accepted, with a note if it is beyond."""
    group, _, name = setting.key.partition(".")
    model: type[Settings] = RigSettings if group == "rig" else SensorSettings
    limits = {type(x).__name__: x for x in model.model_fields[name].metadata}
    low = getattr(limits.get("Ge"), "ge", -math.inf)
    high = getattr(limits.get("Le"), "le", math.inf)
    value = setting.value
    if value is None or isinstance(value, str | bool) or low <= value <= high:
        return setting
    note = f"{value:g} {setting.note} is beyond the range of the setting"
    return replace(setting, value=min(max(value, low), high), note=note)


def _toml(value: float | str | bool) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else f"{value:.6g}"
