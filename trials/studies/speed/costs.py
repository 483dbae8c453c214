"""Processor time, bytes and memory of a frame by scene, label, resolution and camera.

The camera is the ideal one, to which CAMERAS add what costs time, one thing at a time.

The rows of a scene are short drives that are recorded one after the other in a process of its own
on one core, with the same world where only labels differ. Processor time is that of the process
and its threads, over those frames in whose time as many are rendered as are written; what comes
before and after (scene, physics, map, certificate) counts for the drive.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time

from scenes import SCENES
from sim.batch import build
from sim.camera.camera import StereoCamera
from sim.camera.render import StereoRenderer
from sim.camera_names import IDEAL
from sim.labels.formats import LABELS as FORMATS
from sim.record import FRAMES_IN_FLIGHT, record_trip
from sim.world.trip import make_trip
from sim.world.world import build_world
from trials.execution.recording_settings import recording_settings
from trials.execution.runner import NO_LABELS
from trials.studies.speed.drive import NOISE, peak_memory_mb
from vo.contract.dataset import DatasetWriter

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
DRIVE = ("drive.distance_m=0.6", "drive.speed_mps=0.5", "rig.rate_hz=6")
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


def measure_scene(rows: Sequence[Conditions], folder: Path) -> dict[Conditions, Cost]:
    """Record drives of a scene in this process, which loads all code with one of the first rows."""
    alike: dict[tuple[tuple[int, int], str], list[Conditions]] = {}
    for x in rows:
        alike.setdefault((x.size_px, x.camera), []).append(x)
    measure_drives(next(iter(alike.values()))[-1:], folder / "first")
    return {
        x: cost
        for k, same in enumerate(alike.values())
        for x, cost in zip(same, measure_drives(same, folder / f"{k}"), strict=True)
    }


def measure_drives(same: Sequence[Conditions], folder: Path, seed: int = 0) -> list[Cost]:
    """Record a drive with each of these labels in this process; all else is the same."""
    start_s = process_time()
    settings = [recording_settings(x.scene, seed, x.overrides, camera=IDEAL) for x in same]
    first = settings[0]
    world = build_world(build(same[0].scene, first), first)
    trip, camera = make_trip(world, first), StereoCamera(world, first)
    costs: list[Cost] = []
    with StereoRenderer(world, first.render, first.rig.color) as renderer:
        built_s = process_time() - start_s
        for k, labelled in enumerate(settings):
            out = folder / f"{k}"
            at_s = [process_time()]
            with DatasetWriter(out) as writer:
                record_trip(
                    writer, world, trip, labelled, camera, renderer,
                    lambda _, __, at_s=at_s: at_s.append(process_time()),
                )  # fmt: skip
            frames = len(at_s) - 1
            last = frames - FRAMES_IN_FLIGHT - 1  # then the last one has been rendered
            frame_ms = 1e3 * (at_s[last] - at_s[1]) / (last - 1)
            drive_s = built_s + process_time() - at_s[0] - frame_ms * frames / 1e3
            kb, memory_gb = _kilobytes(out, frames), peak_memory_mb() / 1024
            costs.append(Cost(frames, frame_ms, kb, drive_s, memory_gb))
    return costs


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
