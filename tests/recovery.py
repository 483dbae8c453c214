"""Recovery of a camera by `driftyard match`, from simulated recordings, as a table.

    python tests/recovery.py 31 32 33

Each seed draws a camera and a scene, and records the scene with it, of the same seed. `match` sees
the images and the calibration alone, and makes no twin. A value is found again if it is within 10 %
of the truth, or if its interval holds the truth.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trials.execution.cache import CACHE
from trials.execution.jobs import Recording
from trials.execution.runner import NO_LABELS, cached_recording
from trials.realism.camera_estimates import CameraSetting
from trials.realism.matching import match_camera
from trials.report.tables import markdown_table
from vo.contract.settings import overrides_of

SCENES = ("office", "brick_court", "meadow", "sandbox")
RANGES = {
    "sensor.full_well": (2_000, 15_000),
    "sensor.read_noise": (6, 25),
    "sensor.softness_px": (0.6, 2.2),
    "sensor.vignetting": (0.15, 0.5),
}
WITHIN = 0.1
RATE_HZ, SPEED_MPS = 15, 0.3


@dataclass(frozen=True)
class Found:
    """A setting of a simulated camera, and its estimate."""

    truth: float
    estimate: CameraSetting

    @property
    def is_near(self) -> bool:
        """Whether the estimate is near the truth, or its interval holds it."""
        value, x = self.estimate.value, self.estimate
        return isinstance(value, float) and (
            abs(value / self.truth - 1) <= WITHIN or x.low <= self.truth <= x.high
        )

    @property
    def text(self) -> str:
        """Estimate, interval and truth."""
        mark = "" if self.is_near else " **not found**"
        return f"{self.estimate.text} [{self.truth:.4g}]{mark}"


def drawn(seed: int) -> tuple[str, dict[str, float]]:
    """Draw a scene, and the settings of a camera."""
    rng = np.random.default_rng(seed)
    scene = str(rng.choice(SCENES))
    logs = {key: rng.uniform(*np.log(ends)) for key, ends in RANGES.items()}
    return scene, {key: round(float(np.exp(x)), 3) for key, x in logs.items()}


def recovered(seed: int, frames: int, cache: Path = CACHE) -> tuple[str, list[Found]]:
    """Record a scene with a drawn camera, and estimate the camera from the images."""
    scene, truth = drawn(seed)
    drive = {
        "drive.distance_m": SPEED_MPS * frames / RATE_HZ,
        "rig.width_px": 320,
        "rig.height_px": 240,
    }
    settings = (*overrides_of({**truth, **drive}), *NO_LABELS)
    made = Recording(scene, seed, settings, camera="ideal")
    folder = cached_recording(made, cache)
    estimates = {x.key: x for x in match_camera(folder, None, "", frames, cache=cache).estimates}
    return scene, [Found(value, estimates[key]) for key, value in truth.items()]


def main(seeds: list[str]) -> int:
    """Print the table; the exit status says whether every value was found again."""
    header = ("scene, seed", *(x.partition(".")[2].replace("_", " ") for x in RANGES))
    rows, found = list[tuple[str, ...]](), list[Found]()
    for seed in seeds:
        scene, values = recovered(int(seed), 100)
        rows.append((f"{scene}, {seed}", *(x.text for x in values)))
        found += values
    print(markdown_table(header, rows))
    return 0 if all(x.is_near for x in found) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
