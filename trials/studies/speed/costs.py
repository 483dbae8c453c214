"""Processor time, bytes and memory of a frame by scene, label, resolution and camera; a model.

The rows of a scene are short drives that are recorded one after the other in a process of its own
on one core. Processor time is that of the process and its threads, over those frames in whose time
as many are rendered as are written; what comes before and after (scene, physics, map, certificate)
counts for the drive.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
from scipy.optimize import nnls

from scenes import SCENES
from sim.batch import build
from sim.labels.formats import LABELS as FORMATS
from sim.record import FRAMES_IN_FLIGHT, record
from trials.execution.recording_settings import recording_settings
from trials.execution.runner import NO_LABELS
from trials.studies.speed.drive import NOISE, peak_memory_mb

BASE, QUICK_SCENES = "brick_court", ("brick_court", "office", "long_haul")
SMALL_PX, LARGE_PX = (160, 120), (640, 480)
LABELS = (
    "depth", "disparity", "disparity_right", "occlusion", "flow", "covisibility", "segmentation",
    "classes", "normals",
)  # fmt: skip
IMAGES = "images"
CAMERAS: Mapping[str, tuple[str, ...]] = {
    "noise": NOISE,
    "colour": ("rig.color=true",),
    "exposure of 10 ms": ("exposure.time_ms=10",),
    "rolling shutter": ("exposure.line_time_us=30",),
}
DEFAULT_LABELS = ("depth", "disparity")
DRIVE = ("drive.distance_m=0.6", "drive.speed_mps=0.5", "rig.rate_hz=10")
SHARED = 0.5
"""Ratio of the frames from which a folder's files are taken for those of frames."""


@dataclass(frozen=True)
class Conditions:
    """What the cost of a frame depends on."""

    scene: str = BASE
    size_px: tuple[int, int] = LARGE_PX
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
        labels = ("all labels",) if self.labels == LABELS else self.labels
        parts = ["{} × {}".format(*self.size_px), *labels, self.camera]
        return ", ".join(filter(None, (self.scene, *parts)))


@dataclass(frozen=True)
class Cost:
    """Costs of a recording.

    Attributes:
        frames: Its number of frames.
        frame_ms: Processor time of a frame.
        kb: Kilobytes of a frame: of its IMAGES and of each label.
        drive_s: Processor time of the rest.
        memory_gb: Largest size of the process so far.
    """

    frames: int
    frame_ms: float
    kb: Mapping[str, float]
    drive_s: float
    memory_gb: float

    @property
    def frame_kb(self) -> float:
        """Kilobytes of a frame."""
        return sum(self.kb.values())


def measure_scene(rows: Sequence[Conditions], folder: Path) -> list[Cost]:
    """Record drives in this process; the first is recorded before them, too, and loads all code."""
    measure_cost(rows[0], folder / "first")
    return [measure_cost(x, folder / f"{k}") for k, x in enumerate(rows)]


def measure_cost(conditions: Conditions, out: Path, seed: int = 0) -> Cost:
    """Record a drive in this process."""
    settings = recording_settings(conditions.scene, seed, conditions.overrides)
    at_s = [process_time()]
    record(
        build(conditions.scene, settings), settings, out,
        progress=lambda done, total: at_s.append(process_time()),
    )  # fmt: skip
    frames = len(at_s) - 1
    last = frames - FRAMES_IN_FLIGHT - 1  # then the last one has been rendered
    frame_ms = 1e3 * (at_s[last] - at_s[1]) / (last - 1)
    drive_s = process_time() - at_s[0] - frame_ms * frames / 1e3
    return Cost(frames, frame_ms, _kilobytes(out, frames), drive_s, peak_memory_mb() / 1024)


def _kilobytes(out: Path, frames: int) -> dict[str, float]:
    """Return kilobytes of a frame by what they hold."""
    names = {form.folder: label for label, form in FORMATS.items()}
    found: dict[str, float] = {}
    for data in sorted(out.glob("mav0/*/data")):
        sizes = [x.stat().st_size for x in data.iterdir()]
        if len(sizes) >= SHARED * frames:
            part = names.get(data.parent.name, IMAGES)
            found[part] = found.get(part, 0.0) + sum(sizes) / 1024 / frames
    return found


def design(quick: bool) -> list[Conditions]:
    """List the rows that the models are fitted to.

    Each scene has images alone and all labels at both sizes; the base has each label, and each
    camera at both sizes.
    """
    sizes = SMALL_PX, LARGE_PX
    return [
        *(
            Conditions(scene, size, labels)
            for scene in (QUICK_SCENES if quick else SCENES)
            for labels in ((), LABELS)
            for size in sizes
        ),
        *(Conditions(labels=(x,)) for x in LABELS),
        *(Conditions(size_px=size, camera=x) for x in CAMERAS for size in sizes),
    ]


CHECKS = (
    Conditions(BASE, (320, 240)),
    Conditions(BASE, (640, 480), DEFAULT_LABELS, "noise"),
    Conditions("office", (640, 480), DEFAULT_LABELS),
    Conditions("office", (320, 240), ("normals",), "noise"),
    Conditions("long_haul", (480, 360), ("depth", "flow", "segmentation")),
)
"""Rows that the models are not fitted to."""


@dataclass(frozen=True)
class Line:
    """Cost that consists of a fixed part and one for each megapixel, neither negative."""

    fixed: float
    per_mpx: float

    @staticmethod
    def fit(costs: Mapping[Conditions, float]) -> "Line":
        """Fit by least squares."""
        sizes = [[1.0, x.megapixels] for x in costs]
        found, _ = nnls(np.array(sizes), np.array([*costs.values()]))
        return Line(*found.tolist())

    def at(self, megapixels: float) -> float:
        """Cost of an image of this size."""
        return self.fixed + self.per_mpx * megapixels


@dataclass(frozen=True)
class Power:
    """Bytes that grow with a power of the size: large pictures of the same compress better."""

    per_mpx: float
    exponent: float

    @staticmethod
    def fit(costs: Mapping[Conditions, float]) -> "Power":
        """Fit the logarithms by least squares."""
        sizes, values = np.log([x.megapixels for x in costs]), np.log([*costs.values()])
        exponent, level = np.polyfit(sizes, values, 1)
        return Power(float(np.exp(level)), float(exponent))

    def at(self, megapixels: float) -> float:
        """Bytes of an image of this size."""
        return self.per_mpx * megapixels**self.exponent


@dataclass(frozen=True)
class SceneCosts:
    """Costs of a frame of a scene: milliseconds of images and of all labels, kilobytes by part.

    And the seconds of a drive beside its frames.
    """

    images: Line
    labels: Line
    kb: Mapping[str, Power]
    drive_s: float


@dataclass(frozen=True)
class CostModel:
    """Costs of a frame by scene, labels, size and camera.

    Attributes:
        scenes: What a scene costs.
        shares: Part of a label in the processor time of all labels; sums to more than 1, as labels
            share what is computed for them.
        cameras: Milliseconds beside those of images.
        image_kb: Ratio of the kilobytes of a camera's images to those of the base.
    """

    scenes: Mapping[str, SceneCosts]
    shares: Mapping[str, float]
    cameras: Mapping[str, Line]
    image_kb: Mapping[str, float]

    @staticmethod
    def fit(costs: Mapping[Conditions, Cost]) -> "CostModel":
        """Fit the rows of `design`."""

        def at(scene: str, labels: tuple[str, ...], camera: str = "") -> dict[Conditions, Cost]:
            return {
                x: cost
                for x, cost in costs.items()
                if (x.scene, x.labels, x.camera) == (scene, labels, camera)
            }

        def beside(rows: Mapping[Conditions, Cost]) -> dict[Conditions, float]:
            plain = {x: costs[Conditions(x.scene, x.size_px)].frame_ms for x in rows}
            return {x: max(0.0, cost.frame_ms - plain[x]) for x, cost in rows.items()}

        scenes: dict[str, SceneCosts] = {}
        for scene in dict.fromkeys(x.scene for x in costs):
            plain, whole = at(scene, ()), at(scene, LABELS)
            scenes[scene] = SceneCosts(
                Line.fit({x: cost.frame_ms for x, cost in plain.items()}),
                Line.fit(beside(whole)),
                {
                    part: Power.fit({x: cost.kb[part] for x, cost in whole.items()})
                    for part in (IMAGES, *LABELS)
                },
                min(cost.drive_s for cost in (plain | whole).values()),
            )
        (of_all,) = (ms for x, ms in beside(at(BASE, LABELS)).items() if x.size_px == LARGE_PX)
        plain_kb = sum(x.kb[IMAGES] for x in at(BASE, ()).values())
        return CostModel(
            scenes,
            {x: sum(beside(at(BASE, (x,))).values()) / of_all for x in LABELS},
            {x: Line.fit(beside(at(BASE, (), x))) for x in CAMERAS},
            {
                x: sum(cost.kb[IMAGES] for cost in at(BASE, (), x).values()) / plain_kb
                for x in CAMERAS
            },
        )

    def frame_ms(self, conditions: Conditions) -> float:
        """Predict the processor time of a frame."""
        size, scene = conditions.megapixels, self.scenes[conditions.scene]
        labels = min(1.0, sum(self.shares[x] for x in conditions.labels)) * scene.labels.at(size)
        camera = self.cameras[conditions.camera].at(size) if conditions.camera else 0.0
        return scene.images.at(size) + labels + camera

    def frame_kb(self, conditions: Conditions) -> float:
        """Predict the kilobytes of a frame."""
        kb = self.scenes[conditions.scene].kb
        parts = {x: kb[x].at(conditions.megapixels) for x in (IMAGES, *conditions.labels)}
        parts[IMAGES] *= self.image_kb.get(conditions.camera, 1.0)
        return sum(parts.values())


def million_frames(model: CostModel, conditions: Conditions) -> tuple[float, float]:
    """Predict core-hours and gigabytes of a million frames, without what drives cost once."""
    hours, gb = model.frame_ms(conditions) * 1e6 / 3.6e6, model.frame_kb(conditions) * 1e6 / 2**20
    return hours, gb
