"""Disturbances by name: each maps a strength to settings, so that disturbances combine."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from sim.settings import RecordSettings
from vo.contract.errors import SettingsError
from vo.contract.settings import amended


@dataclass(frozen=True)
class Disturbance:
    """A disturbance of visual odometry.

    The recipe maps the key of each setting to its value as a function of the strength, or to its
    value at strength 1, to which it is proportional; the larger value counts where two disturbances
    set the same key.
    """

    about: str
    recipe: Mapping[str, float | Callable[[float], float]]


def _noisy_well(strength: float) -> float:
    """Full well whose shot noise, relative to full scale, is proportional to the strength."""
    return min(500.0 / strength**2, 200_000.0)


_BLUR: dict[str, float] = {"exposure.time_ms": 30.0}
"""Exposure time of all disturbances that shake the camera, to make the shake visible."""

DISTURBANCES: dict[str, Disturbance] = {
    "blur": Disturbance("long exposure time", _BLUR),
    "brick_bump": Disturbance(
        "loose bricks under the wheels",
        {"terrain.brick_mm": 14.0, "terrain.brick_gap_m": lambda s: 0.25, **_BLUR},
    ),
    "sill": Disturbance(
        "door sills and cables across the route",
        {"terrain.sill_mm": 10.0, "terrain.sill_gap_m": lambda s: 0.6, **_BLUR},
    ),
    "slip": Disturbance(
        "wet patches on which the wheels spin",
        {
            "terrain.ice_share": lambda s: 0.6,
            "terrain.ice_friction": lambda s: min(0.04 / s, 0.9),
            **_BLUR,
        },
    ),
    "mast_flex": Disturbance("mast that bends and vibrates", {"rover.flex_deg": 7.0, **_BLUR}),
    "load": Disturbance("heavy load that sways on one side", {"rover.load_kg": 5.0, **_BLUR}),
    "collision": Disturbance(
        "light cartons that the rover pushes along in view", {"terrain.boxes_per_m": 1.6}
    ),
    "noise": Disturbance(
        "shot and read noise of a small, cheap sensor",
        {
            "sensor.full_well": _noisy_well,
            "sensor.read_noise": lambda s: 0.03 * s * _noisy_well(s),
        },
    ),
    "defocus": Disturbance("lens out of focus", {"sensor.softness_px": 4.0}),
    "chromatic": Disturbance(
        "lens that images red larger, and blue smaller", {"sensor.chromatic_px": 1.5}
    ),
    "fog": Disturbance("fog with a visibility of 10 m", {"weather.fog_m": lambda s: 10 / s}),
    "rain": Disturbance("violent rain of 50 mm/h", {"weather.rain_mm_h": 50.0}),
    "soiling": Disturbance(
        "dust, drops and fingerprints on both lenses",
        {"sensor.soiling": lambda s: min(0.5 * s, 1.0)},
    ),
    "rolling_shutter": Disturbance("rolling shutter", {"exposure.line_time_us": 60.0}),
    "stereo_offset": Disturbance(
        "right camera exposed later than the left", {"exposure.right_offset_ms": 8.0}
    ),
    "stereo_mismatch": Disturbance(
        "right camera with another gain and more noise",
        {
            "sensor.right_gain": lambda s: 1 / (1 + 0.25 * s),
            "sensor.right_noise": lambda s: 1 + 7 * s,
            "sensor.read_noise": 60.0,
        },
    ),
    "drop": Disturbance("lost frames", {"sensor.drop_share": lambda s: min(0.6 * s, 0.9)}),
    "miscalibration": Disturbance(
        "aged calibration: baseline, focal length, angles",
        {
            "calibration.baseline_percent": 0.5,
            "calibration.focal_percent": 0.5,
            "calibration.pitch_deg": 0.05,
            "calibration.yaw_deg": 0.05,
        },
    ),
}
RENAMED = {"eye_offset": "stereo_offset", "eye_mismatch": "stereo_mismatch"}
"""Earlier names of disturbances."""


def parse_disturbances(text: str) -> dict[str, float]:
    """Parse `blur,brick_bump=0.5` as names and strengths.

    Raises:
        SettingsError: If a name is unknown or a strength is not a number of at least 0.
    """
    wanted: dict[str, float] = {}
    for word in filter(None, (w.strip() for w in text.split(","))):
        name, equals, number = word.partition("=")
        if name not in DISTURBANCES:
            if name in RENAMED:
                raise SettingsError(f"disturbance {name} is now {RENAMED[name]}")
            valid = ", ".join(sorted(DISTURBANCES))
            raise SettingsError(f"unknown disturbance {name}; valid: {valid}")
        try:
            wanted[name] = float(number) if equals else 1.0
        except ValueError:
            raise SettingsError(f"disturbance {name}: strength {number} is not a number") from None
        if not 0 <= wanted[name] < float("inf"):
            raise SettingsError(f"disturbance {name}: strength {number} must be 0 or more")
    return wanted


def disturbed_values(wanted: Mapping[str, float]) -> dict[str, float]:
    """Return the settings of disturbances, by name and strength; strength 0 sets nothing."""
    values: dict[str, float] = {}
    for name, strength in wanted.items():
        if strength > 0:
            for key, rule in DISTURBANCES[name].recipe.items():
                value = rule(strength) if callable(rule) else rule * strength
                values[key] = max(value, values.get(key, 0.0))
    return values


def disturbed(settings: RecordSettings, wanted: Mapping[str, float]) -> RecordSettings:
    """Apply disturbances, by name and strength, to settings.

    Raises:
        SettingsError: If a strength takes a setting out of its range.
    """
    return amended(settings, disturbed_values(wanted))
