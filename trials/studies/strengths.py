"""What a stress test can turn up: one number each, with the settings it stands for."""

from collections.abc import Callable
from dataclasses import dataclass

from sim.disturbances import DISTURBANCES


@dataclass(frozen=True)
class Axis:
    """One thing that can be more or less.

    Attributes:
        label: With the unit.
        reach: Strongest that is tried.
        least: Weakest.
        overrides: Strength to settings of the generator, `key=value` each.
        disturb: Strength to disturbances.
        scene: Where it is tried, unless the user says otherwise.
    """

    label: str
    reach: float
    least: float = 0.0
    overrides: Callable[[float], tuple[str, ...]] = lambda _: ()
    disturb: Callable[[float], str] = lambda _: ""
    scene: str = "office"


def _settings(*keys: str) -> Callable[[float], tuple[str, ...]]:
    return lambda strength: tuple(f"{key}={strength:.6g}" for key in keys)


def _disturbance(name: str, unit: float = 1.0) -> Callable[[float], str]:
    """A disturbance whose strength 1 is `unit` of the axis."""
    return lambda strength: f"{name}={strength / unit:.6g}" if strength > 0 else ""


MAIN: dict[str, Axis] = {
    "exposure": Axis(
        "open shutter, ms", 40.0, overrides=_settings("exposure.time_ms"), scene="turntable"
    ),
    "brick_height": Axis("height of the bricks, mm", 30.0, overrides=_settings("terrain.brick_mm")),
    "noise": Axis(
        "read noise, % of full scale (shot noise rises with it)", 6.0,
        disturb=_disturbance("noise", unit=3.0),
    ),
    "calibration": Axis(
        "unknown pitch and unknown yaw of the right eye, degrees each", 0.4,
        overrides=_settings("calibration.pitch_deg", "calibration.yaw_deg"),
    ),
    "texture": Axis(
        "share of the doors that are missing", 1.0,
        overrides=lambda s: (f"scene.doors={0.8 * (1 - s):.6g}",), scene="corridor",
    ),
    "speed": Axis(
        "speed, m/s", 1.5, least=0.3, overrides=_settings("drive.speed_mps",
                                                          "drive.acceleration_mps2"),
    ),
}  # fmt: skip
"""The axes that `driftyard stress all` goes through; each has a unit."""

AXES: dict[str, Axis] = MAIN | {
    name: Axis(f"strength of the disturbance {name} ({x.about})", 2.0, disturb=_disturbance(name))
    for name, x in DISTURBANCES.items()
    if name not in MAIN
}
"""All that `driftyard stress` can turn up; a disturbance's strength is that of `--disturb`."""
