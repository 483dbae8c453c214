"""Recording: a scene and settings become a dataset folder, complete or not at all."""

from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

from scenes.scene import Scene
from sim.camera.camera import Capture, FrameExposure, StereoCamera, StereoImages
from sim.camera.render import StereoRenderer
from sim.certificate.blur import CameraMotion
from sim.certificate.certificate import (
    LITTLE_POWER,
    certify,
    check_folder,
    detectable_shifts,
    exempt_parts,
)
from sim.certificate.frame_residual import FrameView, frame_residual
from sim.certificate.label_coverage import COVERAGE, check_coverage
from sim.certificate.photometric import FrameResidual, PhotometricCheck
from sim.dataset.image_codecs import encode_float, encode_png
from sim.dataset.manifest import manifest
from sim.dataset.tables import write_cameras, write_exposures, write_inertial, write_wheels
from sim.imaging.lens import delivered_rig
from sim.labels.annotate import Annotator
from sim.labels.formats import CODES, LABELS
from sim.preview.cameras import render_world_map
from sim.progress import Progress
from sim.settings import RecordSettings
from sim.world.enclosure import enclosing_geom
from sim.world.fingerprint import expect_unchanged
from sim.world.physics import remark_replaced
from sim.world.trip import Trip, make_trip
from sim.world.world import World, build_world
from vo.contract.dataset import MAP_FILE, DatasetWriter
from vo.contract.remarks import remark
from vo.contract.settings import with_defaults

WORKERS = 2
FRAMES_IN_FLIGHT = 4
"""Rendered frames that may wait for encoding; bounds the memory."""


@dataclass(frozen=True)
class Recording:
    """Certificate of a recording, as in the manifest, and the reason if it ended early, or ""."""

    certificate: dict[str, Any]
    ended: str

    @property
    def faults(self) -> list[str]:
        """What is wrong with a dataset that was written nevertheless, or hidden by its noise."""
        found = [f"incomplete, {self.ended}"] if self.ended else []
        for name, part in self.certificate.items():
            if isinstance(part, dict) and not part["passed"]:
                frames = part.get("failed_frames_ns", [])
                where = f", first at {frames[0]} ns" if frames else ""
                found.append(f"the {name} check of the certificate fails{where}")
        return found + [x for x in detectable_shifts(self.certificate) if LITTLE_POWER in x]


def record(
    scene: Scene,
    settings: RecordSettings,
    out: Path,
    overwrite: bool = False,
    progress: Progress | None = None,
    recorded: Mapping[str, Any] | None = None,
) -> Recording:
    """Drive the scene's route, render it and write the dataset folder `out`.

    Defaults of the scene apply to settings that were not set. The same scene, settings, MuJoCo and
    OpenGL give the same bytes. A rover that tips over or gets stuck leaves a dataset of the frames
    until then, marked incomplete with the reason. `recorded` is the manifest of a dataset of the
    same scene: a custom scene must not have changed since.

    Raises:
        DatasetError: If `out` exists, the disk is full, or the scene changed since `recorded`.
        SettingsError: If route, distance, lens or start do not fit the scene.
        DriveError: If the rover fails before the second frame.
        GraphicsError: If there is no OpenGL.
    """
    settings = with_defaults(settings, scene.defaults)
    with DatasetWriter(out, overwrite) as writer:
        world = build_world(scene, settings)
        remark_replaced(world)
        if recorded is not None:
            expect_unchanged(recorded, world)
        trip = make_trip(world, settings)
        camera = StereoCamera(world, settings)
        with StereoRenderer(world, settings.render, settings.rig.color) as renderer:
            return record_trip(writer, world, trip, settings, camera, renderer, progress)


def record_trip(
    writer: DatasetWriter,
    world: World,
    trip: Trip,
    settings: RecordSettings,
    camera: StereoCamera,
    renderer: StereoRenderer,
    progress: Progress | None = None,
) -> Recording:
    """Render a trip of two or more delivered frames, label it, certify it and commit the dataset.

    The renderer is open; the world is moved along the trip.

    Raises:
        DatasetError: If the disk is full.
    """
    annotator = Annotator(world)
    check = PhotometricCheck(settings, world.rig, camera.sensors)
    overhead = render_world_map(world, renderer)
    T_world_cam = trip.motions.T_world_body @ world.rig.T_body_cam
    motion = CameraMotion(trip.motions.times_ns, T_world_cam, world.rig)
    processor = _FrameProcessor(writer, settings, camera, annotator, check, motion)
    coverage = check_coverage(world, trip, renderer)
    captures = _watched(world, camera.captures(trip, renderer))
    exposures, frames = _write_frames(processor, captures, int(trip.delivered.sum()), progress)
    writer.add(MAP_FILE, encode_png(overhead.image))
    delivered, things = delivered_rig(world.rig, settings.calibration), annotator.things
    write_cameras(writer, world.rig, delivered, settings, trip)
    write_exposures(writer, exposures)
    write_inertial(writer, settings, trip, world.gravity_mps2)
    write_wheels(writer, settings, trip)
    checks = check_folder(writer.partial, settings, trip.ended, world.gravity_mps2)
    checks[COVERAGE] = coverage
    certificate = certify(
        frames, checks, exempt_parts(settings), settings.render.engine == "filament"
    )
    entries = overhead.manifest_entry, renderer.gl_strings, certificate
    writer.commit(manifest(world, settings, delivered, trip, things, *entries))
    return Recording(certificate, trip.ended)


def _watched(world: World, captures: Iterator[Capture]) -> Iterator[Capture]:
    """Pass captures on, with a remark on the first one from inside a solid of a user's world."""
    inside = ""
    for capture in captures:
        if world.scene.source and not inside:
            eye = capture.T_world_cam[:3, 3]
            if inside := enclosing_geom(world.model, world.data, eye):
                where = f"({eye[0]:.2f}, {eye[1]:.2f}, {eye[2]:.2f}) m"
                remark(
                    f"{world.scene.source}: the camera passes through {inside}, first at {where}"
                )
        yield capture


_Frame = tuple[Capture, Future[StereoImages]]
"""A rendered frame, and its images, which may still be computed."""


@dataclass(frozen=True)
class _FrameProcessor:
    """Computation and writing of images and labels, thread-safe."""

    writer: DatasetWriter
    settings: RecordSettings
    camera: StereoCamera
    annotator: Annotator
    check: PhotometricCheck
    motion: CameraMotion

    def write_images(self, capture: Capture) -> StereoImages:
        images = self.camera.form_images(capture)
        for k in (0, 1):
            name = f"{k}/data/{capture.exposure.timestamp_ns}.png"
            self.writer.add(f"mav0/cam{name}", encode_png(images.rectified[k]))
            if images.raw is not None:
                self.writer.add(f"mav0/raw{name}", encode_png(images.raw[k]))
        return images

    def finish(self, frame: _Frame, following: _Frame | None) -> FrameResidual:
        """Write the labels of a frame and compute their photometric residuals."""
        capture = frame[0]
        annotation = self.annotator.annotate(capture, following and following[0])
        labels = annotation.wanted(self.settings.labels)
        for name, label in labels.items():
            form = LABELS[name]
            data = encode_png(label) if form.encoding == CODES else encode_float(label)
            path = f"mav0/{form.folder}/data/{capture.exposure.timestamp_ns}{form.suffix}"
            self.writer.add(path, data)
        labels["disparity"] = annotation.disparity
        views = _view(frame), following and _view(following)
        return frame_residual(self.check, self.motion, self.annotator.rig, labels, *views)


def _view(frame: _Frame) -> FrameView:
    capture, images = frame
    return FrameView(capture.exposure, *images.result().rectified, capture.T_world_cam)


def _write_frames(
    processor: _FrameProcessor, captures: Iterator[Capture], total: int, progress: Progress | None
) -> tuple[list[FrameExposure], list[FrameResidual]]:
    """Render in this thread; form images, label, encode, hash, write and certify in others.

    Forward labels need the next frame, so that each frame is submitted after the next.
    """
    exposures: list[FrameExposure] = []
    residuals: list[FrameResidual] = []
    pending: deque[Future[FrameResidual]] = deque()

    def collect() -> None:
        residuals.append(pending.popleft().result())
        if progress:
            progress(len(residuals), total)

    # Frames of a video follow one another: a single thread takes them in order.
    workers = 1 if processor.settings.sensor.h264_crf else WORKERS
    with ThreadPoolExecutor(workers, "frames") as pool:

        def submitted() -> Iterator[_Frame]:
            for capture in captures:
                exposures.append(capture.exposure)
                yield capture, pool.submit(processor.write_images, capture)

        try:
            for frame, following in pairwise(chain(submitted(), [None])):
                assert frame is not None
                if len(pending) == FRAMES_IN_FLIGHT:
                    collect()
                pending.append(pool.submit(processor.finish, frame, following))
            while pending:
                collect()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return exposures, residuals
