"""Recording: a scene and settings become a dataset folder, whole or not at all."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from scenes.scene import Scene
from sim.certificate import FrameResidual, certify, measure_frame
from sim.labels import disparity_from_depth
from sim.manifest import MAP, manifest
from sim.map import render_map
from sim.render import StereoRenderer, Survey
from sim.sensors import LABELS, camera_sheet, label_sheet, truth_sheet, wheels_sheet
from sim.settings import RecordSettings
from sim.trip import Trip, drive_trip
from sim.world import World, build_world
from vo.contract import se3
from vo.contract.arrays import Image
from vo.contract.dataset import TRUTH, DatasetWriter
from vo.contract.files import encode_float, encode_png
from vo.contract.rig import StereoRig

Progress = Callable[[int, int], None]
"""Called with (frames done, frames in total) after every frame."""

WORKERS = 2
FRAMES_IN_FLIGHT = 4
"""Rendered frames that may wait for encoding; bounds the memory."""

IMAGE_COLUMNS = ("timestamp [ns]", "filename")
WHEEL_COLUMNS = ("timestamp [ns]", "left [ticks]", "right [ticks]")
TRUTH_COLUMNS = (
    "timestamp",
    *(f"p_RS_R_{axis} [m]" for axis in "xyz"),
    *(f"q_RS_{axis} []" for axis in "wxyz"),
    *(f"v_RS_R_{axis} [m s^-1]" for axis in "xyz"),
    *(f"b_w_RS_S_{axis} [rad s^-1]" for axis in "xyz"),
    *(f"b_a_RS_S_{axis} [m s^-2]" for axis in "xyz"),
)


def record(
    scene: Scene,
    settings: RecordSettings,
    out: Path,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Drive the scene's route, render it and write the dataset folder `out`.

    The same scene, settings, MuJoCo and GL give the same bytes.

    Returns:
        The certificate.

    Raises:
        DatasetError: If `out` is in the way.
        SettingsError: If route and distance do not fit the scene.
        DriveError: If the rover tips over or gets stuck.
        GraphicsError: If there is no GL.
    """
    with DatasetWriter(out, overwrite) as writer:
        world = build_world(scene, settings)
        trip = drive_trip(world, settings)
        with StereoRenderer(world, settings.render, settings.rig.color) as renderer:
            residuals = _write_frames(writer, renderer, world, trip, settings, progress)
            top_down = render_map(renderer, scene.extent_m)
            gl = renderer.gl_strings
        writer.add(MAP, encode_png(top_down.image))
        _write_sensors(writer, world.rig, settings, trip)
        certificate = certify(residuals)
        writer.commit(manifest(scene, settings, world.rig, trip, top_down, gl, certificate))
    return certificate


def _write_frames(
    writer: DatasetWriter,
    renderer: StereoRenderer,
    world: World,
    trip: Trip,
    settings: RecordSettings,
    progress: Progress | None,
) -> list[FrameResidual]:
    """Render in this thread, and encode, hash, write and certify in others."""
    residuals: list[FrameResidual] = []
    pending: deque[Future[FrameResidual]] = deque()

    def collect() -> None:
        residuals.append(pending.popleft().result())
        if progress:
            progress(len(residuals), len(trip))

    with ThreadPoolExecutor(WORKERS, "encode") as pool:
        try:
            for time_ns, qpos in zip(trip.timestamps_ns, trip.qpos, strict=True):
                world.data.qpos[:] = qpos
                world.place_bodies()
                survey = renderer.survey()
                images = renderer.paint()
                if len(pending) == FRAMES_IN_FLIGHT:
                    collect()
                pending.append(
                    pool.submit(
                        _write_frame, writer, settings, world.rig, int(time_ns), images, survey
                    )
                )
            while pending:
                collect()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return residuals


def _write_frame(
    writer: DatasetWriter,
    settings: RecordSettings,
    rig: StereoRig,
    time_ns: int,
    images: tuple[Image, Image],
    survey: Survey,
) -> FrameResidual:
    left, right = images
    disparity_px = disparity_from_depth(rig, survey.depth_left_m)
    writer.add(f"mav0/cam0/data/{time_ns}.png", encode_png(left))
    writer.add(f"mav0/cam1/data/{time_ns}.png", encode_png(right))
    labels = {"depth": survey.depth_left_m, "disparity": disparity_px}
    for label in _wanted(settings):
        writer.add(f"mav0/{label}0/data/{time_ns}.tiff", encode_float(labels[label]))
    return measure_frame(time_ns, left, right, disparity_px)


def _write_sensors(
    writer: DatasetWriter, rig: StereoRig, settings: RecordSettings, trip: Trip
) -> None:
    """Write every sensor.yaml and data.csv."""
    rate_hz, times = settings.rig.rate_hz, [int(t) for t in trip.timestamps_ns]
    for eye in (0, 1):
        writer.add_yaml(f"mav0/cam{eye}/sensor.yaml", camera_sheet(rig, rate_hz, eye))
        writer.add_csv(f"mav0/cam{eye}/data.csv", IMAGE_COLUMNS, ((t, f"{t}.png") for t in times))
    for label in _wanted(settings):
        writer.add_yaml(f"mav0/{label}0/sensor.yaml", label_sheet(rig, rate_hz, label))
        writer.add_csv(f"mav0/{label}0/data.csv", IMAGE_COLUMNS, ((t, f"{t}.tiff") for t in times))
    writer.add_yaml("mav0/wheels0/sensor.yaml", wheels_sheet(settings.encoders))
    counts = zip(trip.wheel_times_ns.tolist(), *trip.wheel_counts.T.tolist(), strict=True)
    writer.add_csv("mav0/wheels0/data.csv", WHEEL_COLUMNS, counts)
    writer.add_yaml(f"{TRUTH}/sensor.yaml", truth_sheet(settings))
    states = np.hstack(
        [
            trip.T_world_body[:, :3, 3],
            se3.to_quat_wxyz(trip.T_world_body),
            trip.v_world_body,
            np.zeros((len(trip), 6)),  # this rover has no inertial unit, so no biases
        ]
    )
    rows = ([t, *state] for t, state in zip(times, states.tolist(), strict=True))
    writer.add_csv(f"{TRUTH}/data.csv", TRUTH_COLUMNS, rows)


def _wanted(settings: RecordSettings) -> list[str]:
    return [label for label in LABELS if getattr(settings.labels, label)]
