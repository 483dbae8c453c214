"""A short film of a drive: left image, chase camera, depth and optical flow."""

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from matplotlib import font_manager
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

from scenes.scene import Scene
from sim.camera.camera import StereoCamera
from sim.camera.render import StereoRenderer
from sim.labels.annotate import Annotation, Annotator
from sim.preview.cameras import SIDE_DEG, chase_camera
from sim.preview.colours import depth_scale, flow_colours, rgb_of, round_up
from sim.progress import Progress
from sim.settings import RecordSettings
from sim.world.path import plan_path
from sim.world.trip import Trip, make_trip
from sim.world.world import START_S, World, build_world
from vo.contract.arrays import Array, Image
from vo.contract.errors import SettingsError
from vo.contract.files import known_suffix, replacing
from vo.contract.settings import with_defaults

FILMS = (".mp4", ".gif")
"""File name suffixes of films."""
FPS = 15.0
WIDTH_PX = {".mp4": 960, ".gif": 640}
CAPTION_SHARE = 0.075
"""Height of a caption over that of its panel."""
CAPTION, CAPTION_INK = (38, 40, 44), (236, 236, 232)

Show = Callable[[Image], None]


def make_film(
    scene: Scene,
    settings: RecordSettings,
    out: Path,
    seconds: float,
    progress: Progress | None = None,
) -> None:
    """Write the first seconds of a recording as an MP4 or GIF; raise as `record`."""
    suffix = known_suffix(out, FILMS)
    settings = with_defaults(settings, scene.defaults)
    world = build_world(scene, settings)
    world, trip = first_seconds(world, settings, seconds)
    stride = max(1, round(settings.rig.rate_hz / FPS))
    with (
        StereoRenderer(world, settings.render, settings.rig.color) as renderer,
        writing(out, settings.rig.rate_hz / stride) as show,
    ):
        frames = _frames(world, settings, trip, renderer, WIDTH_PX[suffix])
        total = int(trip.delivered.sum()) - 1
        for done, frame in enumerate(frames):
            if done % stride == 0:
                show(frame)
            if progress:
                progress(done + 1, total)


def first_seconds(world: World, settings: RecordSettings, seconds: float) -> tuple[World, Trip]:
    """Simulate only the first seconds, and one frame more for the flow, as on the whole trip."""
    end_s = START_S + seconds + 2 / settings.rig.rate_hz
    drive, path = settings.drive, world.path
    if world.arrival_s is not None:
        world = replace(world, arrival_s=min(world.arrival_s, end_s))
    else:
        braking_m = drive.speed_mps**2 / (2 * drive.acceleration_mps2)
        reach_m = drive.speed_mps * (end_s - START_S) + braking_m + 2 * drive.lookahead_m
        if reach_m < path.length_m:
            world = replace(world, path=plan_path(path.waypoints, reach_m))
    trip = make_trip(world, settings)
    wanted = trip.timestamps_ns < round(1e9 * (START_S + seconds + 0.5 / settings.rig.rate_hz))
    return world, replace(trip, delivered=trip.delivered & wanted)


def _frames(
    world: World, settings: RecordSettings, trip: Trip, renderer: StereoRenderer, width_px: int
) -> Iterator[Image]:
    camera, annotator = StereoCamera(world, settings), Annotator(world)
    layout: _Layout | None = None
    for now, following in pairwise(camera.captures(trip, renderer)):
        annotation = annotator.annotate(now, following)
        layout = layout or _Layout(world, settings, annotation.depth, width_px // 2)
        time_ns = now.exposure.timestamp_ns
        world.place(time_ns * 1e-9, trip.states.at(world.model, time_ns))
        chase = renderer.render_view(chase_camera(world, SIDE_DEG), *layout.panel_px)
        left = rgb_of(camera.form_images(now).rectified[0])
        yield layout.compose(annotation, left, chase, trip)


class _Layout:
    """Layout of four panels, with scales that hold for the whole film."""

    def __init__(self, world: World, settings: RecordSettings, depth_m: Array, width_px: int):
        rig = world.rig
        self._scale = depth_scale(depth_m)
        step_m = settings.drive.speed_mps / settings.rig.rate_hz
        self._full_px = round_up(rig.f_px * step_m / float(np.nanpercentile(depth_m, 5)))
        self.panel_px = width_px, 2 * round(width_px * rig.height_px / rig.width_px / 2)
        self._caption_px = 2 * round(CAPTION_SHARE * self.panel_px[1] / 2)
        size_px = round(0.62 * self._caption_px)
        self._font = ImageFont.truetype(font_manager.findfont("DejaVu Sans"), size_px)

    def compose(self, annotation: Annotation, left: Image, chase: Image, trip: Trip) -> Image:
        capture = annotation.capture
        k, exposure, scale = capture.index, capture.exposure, self._scale
        time_s = (exposure.timestamp_ns - trip.timestamps_ns[0]) * 1e-9
        way_m = np.linalg.norm(np.diff(trip.T_world_body[: k + 1, :3, 3], axis=0), axis=1).sum()
        speed_mps = np.linalg.norm(trip.v_world_body[k])
        exposed = f"   {exposure.exposure_ms:.3g} ms" if exposure.exposure_ms else ""
        panels = (
            (left, f"left image   {time_s:.1f} s{exposed}"),
            (chase, f"from behind   {speed_mps:.2f} m/s   {way_m:.2f} m"),
            (scale.colours(annotation.depth), f"depth   {scale.near_m:g} to {scale.far_m:g} m"),
            (flow_colours(annotation.flow, self._full_px), f"flow   up to {self._full_px:g} px"),
        )
        cells = [self._panel(*panel) for panel in panels]
        return np.vstack([np.hstack(cells[:2]), np.hstack(cells[2:])])

    def _panel(self, image: Image, caption: str) -> Image:
        small = cv2.resize(image, self.panel_px, interpolation=cv2.INTER_AREA)
        strip = Pillow.new("RGB", (self.panel_px[0], self._caption_px), CAPTION)
        middle = self._caption_px / 2
        draw, place = ImageDraw.Draw(strip), (middle * 0.8, middle)
        draw.text(place, caption, fill=CAPTION_INK, font=self._font, anchor="lm")
        return np.vstack([np.asarray(strip, np.uint8), np.asarray(small, np.uint8)])


@contextmanager
def writing(out: Path, fps: float) -> Generator[Show]:
    """Yield a function that adds (H, W, 3) RGB frames to a film, which is written atomically.

    Raises:
        SettingsError: If the name has another suffix, or no encoder can be opened.
    """
    encoding = _writing_mp4 if known_suffix(out, FILMS) == ".mp4" else _writing_gif
    with replacing(out) as partial, encoding(partial, fps) as show:
        yield show


@contextmanager
def _writing_mp4(path: Path, fps: float) -> Generator[Show]:
    """Encode as MPEG-4 part 2, which is part of every OpenCV."""
    writer: cv2.VideoWriter | None = None

    def show(frame: Image) -> None:
        nonlocal writer
        if writer is None:
            fourcc = cv2.VideoWriter.fourcc(*"mp4v")
            writer = cv2.VideoWriter(str(path), fourcc, fps, frame.shape[1::-1])
            if not writer.isOpened():
                raise SettingsError(f"{path}: OpenCV cannot write MP4 here; try .gif")
        writer.write(np.ascontiguousarray(frame[..., ::-1]))

    try:
        yield show
    finally:
        if writer is not None:
            writer.release()


@contextmanager
def _writing_gif(path: Path, fps: float) -> Generator[Show]:
    """Encode with a palette for each frame."""
    frames: list[Pillow.Image] = []
    yield lambda frame: frames.append(Pillow.fromarray(frame).quantize(256))
    interval_ms = round(1000 / fps)
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=interval_ms, loop=0)
