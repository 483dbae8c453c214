"""Recording: a scene and settings become a dataset folder, whole or not at all."""

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

from scenes.scene import Scene
from sim.camera.camera import Capture, FrameExposure, StereoCamera, StereoImages
from sim.camera.render import StereoRenderer
from sim.certificate.certificate import FrameResidual, PhotometricCheck, certify, exempt_parts
from sim.certificate.plausibility import check_folder
from sim.dataset.image_codecs import encode_float, encode_png
from sim.dataset.manifest import manifest
from sim.dataset.sensor_yaml import CODES, LABELS
from sim.dataset.tables import write_cameras, write_exposures, write_inertial, write_wheels
from sim.imaging.lens import delivered_rig
from sim.labels.annotate import Annotation, Annotator
from sim.preview.overhead_map import MAP_FILE, render_world_map
from sim.progress import Progress
from sim.settings import RecordSettings
from sim.world.trip import Trip, make_trip
from sim.world.world import World, build_world
from vo.contract.dataset import DatasetWriter

WORKERS = 2
FRAMES_IN_FLIGHT = 4
"""Rendered frames that may wait for encoding; bounds the memory."""


@dataclass(frozen=True)
class Recording:
    """What became of a dataset.

    Attributes:
        certificate: As in the manifest.
        ended: Why it ended early; empty if it is complete.
    """

    certificate: dict[str, Any]
    ended: str


def record(
    scene: Scene,
    settings: RecordSettings,
    out: Path,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Recording:
    """Follow the scene's route, render it and write the dataset folder `out`.

    The same scene, settings, MuJoCo and GL give the same bytes. A rover that tips over or gets
    stuck leaves a dataset of the frames until then, which says that it is incomplete and why.

    Raises:
        DatasetError: If `out` is in the way or the disk is full.
        SettingsError: If route, distance, lens or start do not fit the scene.
        DriveError: If the rover fails before the second frame.
        GraphicsError: If there is no GL.
    """
    with DatasetWriter(out, overwrite) as writer:
        world = build_world(scene, settings)
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
    """Render what was driven, label it, certify it and commit the dataset.

    Args:
        writer: Of the folder.
        world: Is moved along the trip.
        trip: At least two frames of it were delivered.
        settings: What goes into the manifest.
        camera: Of that world.
        renderer: Of that world, open.
        progress: Is told of every frame.

    Raises:
        DatasetError: If the disk is full.
    """
    annotator = Annotator(world)
    judge = PhotometricCheck(settings, world.rig, camera.sensors)
    darkroom = _Darkroom(writer, settings, camera, annotator, judge)
    top_down = render_world_map(world, renderer)
    captures = camera.captures(trip, renderer)
    shots, frames = _write_frames(darkroom, captures, int(trip.delivered.sum()), progress)
    writer.add(MAP_FILE, encode_png(top_down.image))
    delivered, gl = delivered_rig(world.rig, settings.calibration), renderer.gl_strings
    write_cameras(writer, delivered, settings, trip)
    write_exposures(writer, shots)
    write_inertial(writer, settings, trip)
    write_wheels(writer, settings, trip)
    checks = check_folder(writer.partial, settings, trip.ended)
    certificate = certify(frames, checks, exempt_parts(settings))
    writer.commit(
        manifest(
            world,
            settings,
            delivered,
            trip,
            annotator.things,
            top_down.manifest_entry,
            gl,
            certificate,
        )
    )
    return Recording(certificate, trip.ended)


@dataclass(frozen=True)
class _Darkroom:
    """What turns captures into files; used by several threads."""

    writer: DatasetWriter
    settings: RecordSettings
    camera: StereoCamera
    annotator: Annotator
    judge: PhotometricCheck

    def develop(self, capture: Capture) -> StereoImages:
        """Make the images of one frame and write them."""
        picture = self.camera.form_images(capture)
        for eye in (0, 1):
            name = f"{eye}/data/{capture.exposure.timestamp_ns}.png"
            self.writer.add(f"mav0/cam{name}", encode_png(picture.rectified[eye]))
            if picture.raw is not None:
                self.writer.add(f"mav0/raw{name}", encode_png(picture.raw[eye]))
        return picture

    def finish(self, negatives: "_Negatives") -> FrameResidual:
        """Write the labels of a frame and measure how well they explain its images."""
        capture, following = negatives.capture, negatives.following
        annotation = self.annotator.annotate(capture, following)
        for name, label in annotation.wanted(self.settings.labels).items():
            form = LABELS[name]
            data = encode_png(label) if form.encoding == CODES else encode_float(label)
            path = f"mav0/{form.folder}/data/{capture.exposure.timestamp_ns}{form.suffix}"
            self.writer.add(path, data)
        return self._measure(annotation, negatives)

    def _measure(self, annotation: Annotation, negatives: "_Negatives") -> FrameResidual:
        picture, capture = negatives.picture.result(), negatives.capture
        stereo = self.judge.stereo(*picture.rectified, annotation.disparity, capture.exposure)
        flow = None
        if self.settings.labels.flow and negatives.following and negatives.next_picture:
            images = picture.rectified[0], negatives.next_picture.result().rectified[0]
            shots = capture.exposure, negatives.following.exposure
            flow = self.judge.flow(*images, annotation.flow, annotation.covisibility, shots)
        return FrameResidual(capture.exposure.timestamp_ns, stereo, flow)


@dataclass(frozen=True)
class _Negatives:
    """A frame and the one after it, on their way through the darkroom."""

    capture: Capture
    picture: Future[StereoImages]
    following: Capture | None
    next_picture: Future[StereoImages] | None


def _write_frames(
    darkroom: _Darkroom, captures: Iterator[Capture], total: int, progress: Progress | None
) -> tuple[list[FrameExposure], list[FrameResidual]]:
    """Render in this thread; develop, annotate, encode, hash, write and certify in others.

    A frame's forward labels need the next frame, so each is handed over when the next is there.
    """
    shots: list[FrameExposure] = []
    residuals: list[FrameResidual] = []
    pending: deque[Future[FrameResidual]] = deque()

    def collect() -> None:
        residuals.append(pending.popleft().result())
        if progress:
            progress(len(residuals), total)

    with ThreadPoolExecutor(WORKERS, "darkroom") as pool:

        def developing() -> Iterator[tuple[Capture, Future[StereoImages]]]:
            for capture in captures:
                shots.append(capture.exposure)
                yield capture, pool.submit(darkroom.develop, capture)

        try:
            for now, then in pairwise(chain(developing(), [None])):
                assert now is not None
                if len(pending) == FRAMES_IN_FLIGHT:
                    collect()
                job = _Negatives(*now, *(then or (None, None)))
                pending.append(pool.submit(darkroom.finish, job))
            while pending:
                collect()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return shots, residuals
