"""A trial as a dataset: what was driven is rendered again, with labels, as the recorder would."""

from itertools import chain, pairwise
from pathlib import Path

from sim.annotate import Annotator
from sim.camera import Shot, StereoCamera
from sim.certificate import FrameResidual, Judge, certify, unjudged
from sim.lens import delivered_rig
from sim.manifest import MAP, manifest
from sim.map import survey_map
from sim.plausibility import check_folder
from sim.sensors import CODES, LABELS
from sim.settings import RecordSettings
from sim.tables import write_cameras, write_exposures, write_inertial, write_wheels
from sim.trip import Trip
from trials.gym.site import Site
from vo.contract.dataset import DatasetWriter
from vo.contract.errors import DatasetError
from vo.contract.files import encode_float, encode_png
from vo.contract.settings import amended


def save_drive(site: Site, trip: Trip, noise_seed: int, out: Path) -> None:
    """Write what was driven; the images are those that the trial saw, to the byte.

    The world is left as it was.

    Args:
        site: Where it was driven.
        trip: What was driven.
        noise_seed: Of the eyes in that trial.
        out: Folder.

    Raises:
        DatasetError: If `out` is in the way, or fewer than two pictures were taken.
    """
    if trip.delivered.sum() < 2:
        raise DatasetError(f"{out}: a dataset needs two pictures at least")
    world, renderer = site.simulation.world, site.eyes.renderer
    settings = amended(
        site.settings, {"imu.rate_hz": len(site.simulation.regular) * site.settings.rig.rate_hz}
    )
    before = world.data.qpos.copy()
    try:
        with DatasetWriter(out) as writer:
            top_down = survey_map(world, renderer)
            shots, frames, annotator = _write_frames(writer, site, settings, trip, noise_seed)
            writer.add(MAP, encode_png(top_down.image))
            delivered = delivered_rig(world.rig, settings.calibration)
            write_cameras(writer, delivered, settings, trip)
            write_exposures(writer, shots)
            write_inertial(writer, settings, trip)
            write_wheels(writer, settings, trip)
            checks = check_folder(writer.partial, settings, trip.ended)
            certificate = certify(frames, checks, unjudged(settings))
            writer.commit(
                manifest(
                    world, settings, delivered, trip, annotator.things, top_down,
                    renderer.gl_strings, certificate,
                )
            )  # fmt: skip
    finally:
        world.data.qpos[:] = before
        world.move_movers(site.simulation.time_s)
        world.place_bodies()


def _write_frames(
    writer: DatasetWriter, site: Site, settings: RecordSettings, trip: Trip, noise_seed: int
) -> tuple[list[Shot], list[FrameResidual], Annotator]:
    """Render every frame that was kept, and its labels, one after the other."""
    world = site.simulation.world
    camera = StereoCamera(world, settings.model_copy(update={"seed": noise_seed}))
    annotator, judge = Annotator(world), Judge(settings, world.rig, camera.sensors)
    shots: list[Shot] = []
    residuals: list[FrameResidual] = []
    captures = camera.captures(trip, site.eyes.renderer)
    for capture, following in pairwise(chain(captures, [None])):
        assert capture is not None
        stamp = capture.shot.timestamp_ns
        picture = camera.develop(capture)
        for eye in (0, 1):
            writer.add(f"mav0/cam{eye}/data/{stamp}.png", encode_png(picture.rectified[eye]))
            if picture.raw is not None:
                writer.add(f"mav0/raw{eye}/data/{stamp}.png", encode_png(picture.raw[eye]))
        annotation = annotator.annotate(capture, following)
        for name, label in annotation.wanted(settings.labels).items():
            form = LABELS[name]
            data = encode_png(label) if form.encoding == CODES else encode_float(label)
            writer.add(f"mav0/{form.folder}/data/{stamp}{form.suffix}", data)
        stereo = judge.stereo(*picture.rectified, annotation.disparity, capture.shot)
        residuals.append(FrameResidual(stamp, stereo, None))
        shots.append(capture.shot)
    return shots, residuals, annotator
