"""Disturbances by name: each a recipe of settings with a strength, so that they combine.

A disturbance is nothing but settings: what `--disturb blur=2,slip` asks for could be written out
with `--set`, and the resolved settings in a dataset say all. Strength 0 changes nothing.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from sim.settings import RecordSettings
from vo.contract.errors import SettingsError
from vo.contract.settings import amended

Recipe = Mapping[str, Callable[[float], float]]
"""Key of a setting to its value at a strength."""


@dataclass(frozen=True)
class Disturbance:
    """One way to make visual odometry harder.

    Attributes:
        about: What it does, in a few words.
        recipe: Settings at a strength; the larger value counts where two disturbances meet.
    """

    about: str
    recipe: Recipe


def _linear(full: float) -> Callable[[float], float]:
    return lambda strength: full * strength


def _noisy_well(strength: float) -> float:
    """FrameExposure noise, as a share of full scale, is proportional to the strength."""
    return min(500.0 / strength**2, 200_000.0)


_SHUTTER_MS = 30.0
"""Exposure that comes with whatever shakes the camera: without one, a shake leaves no trace in an
image."""

DISTURBANCES: dict[str, Disturbance] = {
    "blur": Disturbance("a long exposure", {"exposure.time_ms": _linear(_SHUTTER_MS)}),
    "brick_bump": Disturbance(
        "loose bricks under the wheels",
        {
            "terrain.brick_mm": _linear(14.0),
            "terrain.brick_gap_m": lambda s: 0.25,
            "exposure.time_ms": _linear(_SHUTTER_MS),
        },
    ),
    "sill": Disturbance(
        "door sills and cables across the way",
        {
            "terrain.sill_mm": _linear(10.0),
            "terrain.sill_gap_m": lambda s: 0.6,
            "exposure.time_ms": _linear(_SHUTTER_MS),
        },
    ),
    "slip": Disturbance(
        "wet patches on which the wheels spin",
        {
            "terrain.ice_share": lambda s: 0.6,
            "terrain.ice_friction": lambda s: min(0.04 / s, 0.9),
            "exposure.time_ms": _linear(_SHUTTER_MS),
        },
    ),
    "mast_flex": Disturbance(
        "a mast that bends and rings after every jolt",
        {"rover.flex_deg": _linear(7.0), "exposure.time_ms": _linear(_SHUTTER_MS)},
    ),
    "load": Disturbance(
        "a heavy load that sways on one side",
        {"rover.load_kg": _linear(5.0), "exposure.time_ms": _linear(_SHUTTER_MS)},
    ),
    "collision": Disturbance(
        "light cartons that are pushed along in view", {"terrain.boxes_per_m": _linear(1.6)}
    ),
    "noise": Disturbance(
        "shot and read noise of a small, cheap sensor",
        {"sensor.full_well": _noisy_well, "sensor.read_noise": lambda s: 0.03 * s * _noisy_well(s)},
    ),
    "defocus": Disturbance("a lens out of focus", {"sensor.softness_px": _linear(4.0)}),
    "rolling_shutter": Disturbance(
        "rows read out one after the other", {"exposure.line_time_us": _linear(60.0)}
    ),
    "stereo_offset": Disturbance(
        "a right eye that looks later than the left", {"exposure.right_offset_ms": _linear(8.0)}
    ),
    "stereo_mismatch": Disturbance(
        "a right eye with another gain and more noise",
        {
            "sensor.right_gain": lambda s: 1 / (1 + 0.25 * s),
            "sensor.right_noise": lambda s: 1 + 7 * s,
            "sensor.read_noise": _linear(60.0),
        },
    ),
    "drop": Disturbance(
        "frames that never arrive", {"sensor.drop_share": lambda s: min(0.6 * s, 0.9)}
    ),
    "miscalibration": Disturbance(
        "an aged calibration: baseline, focal length, angles",
        {
            "calibration.baseline_percent": _linear(0.5),
            "calibration.focal_percent": _linear(0.5),
            "calibration.pitch_deg": _linear(0.05),
            "calibration.yaw_deg": _linear(0.05),
        },
    ),
}


def parse_disturbances(text: str) -> dict[str, float]:
    """Read `blur,brick_bump=0.5` as names and strengths.

    Raises:
        SettingsError: If a name is unknown or a strength is not a number of at least 0.
    """
    wanted: dict[str, float] = {}
    for word in filter(None, (w.strip() for w in text.split(","))):
        name, equals, number = word.partition("=")
        if name not in DISTURBANCES:
            raise SettingsError(
                f"unknown disturbance {name}; valid: {', '.join(sorted(DISTURBANCES))}"
            )
        try:
            wanted[name] = float(number) if equals else 1.0
        except ValueError:
            raise SettingsError(f"disturbance {name}: strength {number} is not a number") from None
        if not 0 <= wanted[name] < float("inf"):
            raise SettingsError(f"disturbance {name}: strength {number} must be 0 or more")
    return wanted


def disturbed(settings: RecordSettings, wanted: Mapping[str, float]) -> RecordSettings:
    """Work disturbances into settings.

    Args:
        settings: What is disturbed.
        wanted: Names, all known, and strengths; 0 leaves the settings as they are.

    Raises:
        SettingsError: If a strength takes a setting out of its range.
    """
    values: dict[str, float] = {}
    for name, strength in wanted.items():
        if strength > 0:
            for key, value in DISTURBANCES[name].recipe.items():
                values[key] = max(value(strength), values.get(key, 0.0))
    return amended(settings, values)
