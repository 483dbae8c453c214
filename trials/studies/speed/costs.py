"""Processor time, bytes and memory of a frame by scene, label, resolution and camera; a model.

Every row is a short drive that is recorded in a process of its own on one core. Processor time is
that of the process and its threads, from the first finished frame to the last; what comes before
(scene, physics, map) counts for the drive.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
from scipy.optimize import nnls

from scenes import SCENES
from sim.batch import build
from sim.record import record
from trials.execution.recording_settings import recording_settings
from trials.execution.runner import NO_LABELS
from trials.studies.speed.drive import NOISE, peak_memory_mb

BASE, QUICK_SCENES = "brick_court", ("brick_court", "office", "long_haul")
SIZES_PX = ((320, 240), (640, 480))
SIZE_PX = SIZES_PX[0]
LABELS = (
    "depth", "disparity", "disparity_right", "occlusion", "flow", "covisibility", "segmentation",
    "classes", "normals",
)  # fmt: skip
CAMERAS: Mapping[str, tuple[str, ...]] = {
    "noise": NOISE,
    "colour": ("rig.color=true",),
    "exposure of 10 ms": ("exposure.time_ms=10",),
    "rolling shutter": ("exposure.line_time_us=30",),
}
DEFAULT_LABELS = ("depth", "disparity")
DRIVE = ("drive.distance_m=1.2", "drive.speed_mps=0.5", "rig.rate_hz=10")
SHARED = 0.5
"""Ratio of the frames from which a folder's files are taken for those of frames."""


@dataclass(frozen=True)
class Conditions:
    """What the cost of a frame depends on."""

    scene: str = BASE
    size_px: tuple[int, int] = SIZE_PX
    labels: tuple[str, ...] = ()
    camera: str = ""

    @property
    def overrides(self) -> tuple[str, ...]:
        """Settings of the recording."""
        width, height = self.size_px
        size = (f"rig.width_px={width}", f"rig.height_px={height}")
        labels = tuple(f"labels.{x}=true" for x in self.labels)
        return (*DRIVE, *size, *NO_LABELS, *labels, *CAMERAS.get(self.camera, ()))

    @property
    def megapixels(self) -> float:
        """Megapixels of one image."""
        return self.size_px[0] * self.size_px[1] / 1e6

    def __str__(self) -> str:
        parts = ["{} × {}".format(*self.size_px), *self.labels, self.camera]
        return ", ".join(filter(None, (self.scene, *parts)))


@dataclass(frozen=True)
class Cost:
    """Costs of a recording: milliseconds and kilobytes of a frame; seconds before the first."""

    frames: int
    frame_ms: float
    frame_kb: float
    drive_s: float
    memory_gb: float


def measure_cost(conditions: Conditions, out: Path, seed: int = 0) -> Cost:
    """Record a drive in this process."""
    settings = recording_settings(conditions.scene, seed, conditions.overrides)
    at_s = [process_time()]
    record(
        build(conditions.scene, settings), settings, out,
        progress=lambda done, total: at_s.append(process_time()),
    )  # fmt: skip
    frames = len(at_s) - 1
    frame_ms = 1e3 * (at_s[-1] - at_s[1]) / (frames - 1)
    drive_s = process_time() - at_s[0] - frame_ms * frames / 1e3
    kb = sum(
        sum(x.stat().st_size for x in files) / 1024
        for files in _by_folder(out).values()
        if len(files) >= SHARED * frames
    )
    return Cost(frames, frame_ms, kb / frames, drive_s, peak_memory_mb() / 1024)


def _by_folder(out: Path) -> dict[Path, list[Path]]:
    found: dict[Path, list[Path]] = {}
    for file in out.rglob("*"):
        if file.is_file():
            found.setdefault(file.parent, []).append(file)
    return found


def design(quick: bool) -> list[Conditions]:
    """List the rows that the model is fitted to: one factor at a time, at both SIZES_PX."""
    return [
        row
        for size in SIZES_PX
        for row in (
            *(Conditions(x, size) for x in (QUICK_SCENES if quick else SCENES)),
            *(Conditions(size_px=size, labels=(x,)) for x in LABELS),
            *(Conditions(size_px=size, camera=x) for x in CAMERAS),
        )
    ]


CHECKS = (
    Conditions(BASE, (160, 120)),
    Conditions(BASE, (640, 480), DEFAULT_LABELS, "noise"),
    Conditions("office", (640, 480), DEFAULT_LABELS),
    Conditions("long_haul", (480, 360), ("depth", "flow", "segmentation")),
    Conditions("office", (160, 120), ("normals",), "noise"),
)
"""Rows that the model is not fitted to."""


@dataclass(frozen=True)
class Line:
    """Cost that consists of a fixed part and one for each megapixel, neither negative."""

    fixed: float
    per_mpx: float

    @staticmethod
    def fit(megapixels: Sequence[float], costs: Sequence[float]) -> "Line":
        """Fit by least squares."""
        found, _ = nnls(np.column_stack([np.ones(len(costs)), megapixels]), np.array(costs))
        return Line(*found.tolist())

    def at(self, megapixels: float) -> float:
        """Cost of an image of this size."""
        return self.fixed + self.per_mpx * megapixels


@dataclass(frozen=True)
class CostModel:
    """Cost of a frame: a line over megapixels for the scene, and one for each label and camera."""

    scenes: Mapping[str, Line]
    extra: Mapping[str, Line]

    @staticmethod
    def fit(costs: Mapping[Conditions, float]) -> "CostModel":
        """Fit the rows of `design`; labels and cameras by their difference from the BASE."""

        def line(rows: Sequence[Conditions], over: float) -> Line:
            values = [costs[x] - over * costs[Conditions(size_px=x.size_px)] for x in rows]
            return Line.fit([x.megapixels for x in rows], values)

        plain = [x for x in costs if not x.labels and not x.camera]
        factors = dict.fromkeys((x.labels, x.camera) for x in costs if x not in plain)
        return CostModel(
            {
                scene: line([x for x in plain if x.scene == scene], 0.0)
                for scene in dict.fromkeys(x.scene for x in plain)
            },
            {
                "".join((*labels, camera)): line(
                    [x for x in costs if (x.labels, x.camera) == (labels, camera)], 1.0
                )
                for labels, camera in factors
            },
        )

    def of(self, conditions: Conditions) -> float:
        """Predict the cost of a frame."""
        extra = [self.extra[x] for x in (*conditions.labels, conditions.camera) if x]
        return sum(x.at(conditions.megapixels) for x in (self.scenes[conditions.scene], *extra))


def million_frames(cpu: CostModel, size: CostModel, conditions: Conditions) -> tuple[float, float]:
    """Predict core-hours and gigabytes of a million frames, without what drives cost once."""
    return cpu.of(conditions) * 1e6 / 3.6e6, size.of(conditions) * 1e6 / 2**20


def relative_errors(model: CostModel, costs: Mapping[Conditions, float]) -> Sequence[float]:
    """Errors of the model's predictions, relative to what was measured."""
    return [model.of(x) / cost - 1 for x, cost in costs.items()]
