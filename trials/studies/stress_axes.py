"""Axes of stress tests: a strength, and the settings or disturbance that it stands for."""

from collections.abc import Callable
from dataclasses import dataclass

from sim.disturbances import DISTURBANCES


@dataclass(frozen=True)
class Axis:
    """Quantity that a stress test varies.

    Attributes:
        label: Description with the unit.
        maximum: Largest strength.
        minimum: Smallest strength.
        overrides: Strength to settings of the recording, `key=value` each.
        disturb: Strength to disturbances, as for `driftyard generate`.
        scene: Default scene.
    """

    label: str
    maximum: float
    minimum: float = 0.0
    overrides: Callable[[float], tuple[str, ...]] = lambda _: ()
    disturb: Callable[[float], str] = lambda _: ""
    scene: str = "office"


def _settings(*keys: str) -> Callable[[float], tuple[str, ...]]:
    return lambda strength: tuple(f"{key}={strength:.6g}" for key in keys)


def _disturbance(name: str, unit: float = 1.0) -> Callable[[float], str]:
    """Return the function for a disturbance whose strength 1 is `unit` of the axis."""
    return lambda strength: f"{name}={strength / unit:.6g}" if strength > 0 else ""


MAIN: dict[str, Axis] = {
    "exposure": Axis(
        "exposure time, ms", 40.0, overrides=_settings("exposure.time_ms"), scene="turntable"
    ),
    "brick_height": Axis("height of the bricks, mm", 30.0, overrides=_settings("terrain.brick_mm")),
    "noise": Axis(
        "read noise, % of full scale (shot noise rises with it)", 6.0,
        disturb=_disturbance("noise", unit=3.0),
    ),
    "calibration": Axis(
        "unknown pitch and unknown yaw of the right camera, degrees each", 0.4,
        overrides=_settings("calibration.pitch_deg", "calibration.yaw_deg"),
    ),
    "texture": Axis(
        "fraction of the doors that are missing", 1.0,
        overrides=lambda s: (f"scene.doors={0.8 * (1 - s):.6g}",), scene="corridor",
    ),
    "speed": Axis(
        "speed, m/s", 1.5, minimum=0.3, overrides=_settings("drive.speed_mps",
                                                          "drive.acceleration_mps2"),
    ),
}  # fmt: skip
"""Axes of `driftyard stress all`; each has a unit."""

AXES: dict[str, Axis] = MAIN | {
    name: Axis(f"strength of the disturbance {name} ({x.about})", 2.0, disturb=_disturbance(name))
    for name, x in DISTURBANCES.items()
    if name not in MAIN
}
"""All axes; the strength of a disturbance is that of `--disturb`."""
