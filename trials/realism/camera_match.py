"""The camera that comes nearest to a real recording, with its twin: what `match` returns."""

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from trials.evaluation.display import html_display, text_display
from trials.execution.jobs import Recording
from trials.realism.camera_estimates import CameraSetting
from trials.realism.comparison import Comparison, Distance
from trials.realism.shortfalls import shortfall
from trials.realism.twins import Place

TARGET = 1 / 3
"""Wanted distance to the twin over that to the default picture."""
MAX_DISTANCE, MAX_ERRORS = 0.1, 3.0
"""Distance, and its number of errors beyond chance, above which a quantity is not matched."""
UNKNOWN = (
    "exposure.time_ms and exposure.line_time_us: motion blur and shutter are not estimated",
    "sensor.k1 to p2: images are compared as rectified",
    "sensor.right_noise and sensor.jpeg_quality: neither is estimated",
)


@dataclass(frozen=True, repr=False)
class CameraMatch:
    """The camera that comes nearest to a real recording.

    Attributes:
        real: Name of the recording.
        estimates: Settings with their intervals; those without a value are not in the file.
        scenes: Mean distance of each scene that was tried, with its options, the nearest first.
        place: The nearest scene and its options; None without.
        comparison: The real recording beside the nearest scene with this camera; None without.
        default: The real recording beside `office` with all default settings and the camera
            `ideal`; None without scenes.
        twin: The recording of the nearest scene; None without.
        seeds: Of the nearest scene, the nearest first.

    Example:
        >>> match = dy.match("ds", "camera.toml", scenes="", frames=8)
        >>> match.values["rig.width_px"]
        160
    """

    real: str
    estimates: Sequence[CameraSetting]
    scenes: Mapping[str, float] = field(default_factory=dict[str, float])
    comparison: Comparison | None = None
    default: Comparison | None = None
    twin: Recording | None = None
    seeds: Sequence[int] = ()
    place: Place | None = None

    @property
    def ratios(self) -> dict[str, float]:
        """Distance to the twin over that to the default picture, by the name of the quantity."""
        if self.comparison is None or self.default is None:
            return {}
        twin, plain = self.comparison.distances, self.default.distances
        return {
            name: x.value / y
            for name, x in twin.items()
            if x.value is not None and (y := plain[name].value)
        }

    @property
    def undecided(self) -> list[str]:
        """Quantities in which the default picture is as near to the real one as chance allows."""
        if self.default is None:
            return []
        return [
            name
            for name, x in self.default.distances.items()
            if x.value is not None and x.value <= (x.chance or 0) + 2 * (x.error or 0)
        ]

    @property
    def values(self) -> dict[str, float | str | bool]:
        """Settings by `key.path`, as `driftyard generate --camera` takes them from a file."""
        return {x.key: x.value for x in self.estimates if x.value is not None}

    @property
    def unmatched(self) -> list[str]:
        """What could not be matched, in words: settings, and quantities of the nearest scene."""
        lacking = [f"{x.key}: {x.note}" for x in self.estimates if x.value is None]
        if self.comparison is None:
            return [*lacking, *UNKNOWN]
        both, found = (self.comparison.real, self.comparison.simulated), self.comparison.distances
        far = sorted(filter(self._is_far, found.values()), key=lambda x: -(x.value or 0))
        return [*lacking, *(shortfall(x, *both) for x in far), *UNKNOWN]

    def _is_far(self, x: Distance) -> bool:
        """Whether a distance is beyond chance, and large or above the target."""
        if x.value is None:
            return False
        error, chance = x.error or 0, x.chance or 0
        large = x.value > MAX_DISTANCE + chance + MAX_ERRORS * error
        above = self.ratios.get(x.quantity, 0) > TARGET and x.quantity not in self.undecided
        return large or (above and x.value > chance + 2 * error)

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
        plain = self.default.to_dict() if self.default else None
        return {
            "real": self.real,
            "settings": estimates,
            "scenes": dict(self.scenes),
            "unmatched": self.unmatched,
            "comparison": twin,
            "default": plain,
            "ratios": self.ratios,
        }

    def twin_command(self, camera: str) -> str:
        """Return the command that records the nearest scene with a file of the camera, or ''."""
        if self.place is None:
            return ""
        options = [word for x in self.place.options for word in ("--set", x)]
        seed = ["--seed", str(self.seeds[0])] if self.seeds else []
        words = ["driftyard", "generate", self.place.scene, "--camera", camera, *options, *seed]
        return shlex.join([*words, "--out", "twin"])

    def toml(self) -> str:
        """Return the file of the camera, with intervals and what is not matched as comments."""
        lines = [f"# Camera nearest to {self.real}, by driftyard match."]
        if self.scenes:
            lines.append(f"# Nearest scene: {next(iter(self.scenes))}.")
        if command := self.twin_command("THIS_FILE"):
            lines.append(f"# A recording of it: {command}")
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


def _toml(value: float | str | bool) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else f"{value:.6g}"
