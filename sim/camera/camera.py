"""The stereo camera: light on both image sensors, and ground truth at mid-exposure, by frame."""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from functools import cache, partial
from typing import Literal

import numpy as np

from sim.camera.exposure import expose, mean_brightness, open_shutter
from sim.camera.render import GeometryBuffers, StereoRenderer
from sim.camera_settings import CalibrationSettings, SensorSettings
from sim.imaging.auto_exposure import AutoExposure, Exposure
from sim.imaging.fog import foggy
from sim.imaging.image_sensor import ImageSensor
from sim.imaging.lens import raw_margin_px
from sim.imaging.linear_light import decode
from sim.imaging.rain import draw_drops, rain_visibility_m, streaked
from sim.imaging.soiling import Soiling
from sim.imaging.video import Video
from sim.settings import RecordSettings
from sim.world.random_streams import stream
from sim.world.trip import Trip
from sim.world.world import World
from vo.contract.arrays import Array, Image, Indices

REFERENCE_EXPOSURE_MS = 10.0
"""Exposure time of the rendered brightness where `exposure.time_ms` is 0."""
_EMPTY: Array = np.zeros((0, 0))
NO_GEOMETRY = GeometryBuffers(_EMPTY, _EMPTY, _EMPTY, _EMPTY)
"""Of frames without labels."""


@dataclass(frozen=True)
class FrameExposure:
    """Exposure of a frame: when, how long, by which automatic gain and from how many sub-frames.

    The timestamp is mid-exposure; the brightness is the light on the left camera over the rendered
    brightness, the mean of the rows.
    """

    timestamp_ns: int
    exposure_ms: float
    gain: float
    subframes: int
    brightness: float

    @property
    def level(self) -> float:
        """Linear light of the image over the rendered brightness, gain included."""
        return self.brightness * self.gain


@dataclass(frozen=True)
class Capture:
    """Light and ground truth of one frame, from which images and labels are computed.

    Attributes:
        index: Of the frame in the trip.
        light: Left and right images in the rendered size: uint8 as rendered by the classic engine
            for a single sub-frame, else float32 linear light.
        brightness: (H',) light on each row over the rendered brightness.
        geometry: Depth and geom ids at mid-exposure, in the delivered size.
        T_world_cam: (4, 4) left camera.
        T_world_bodies: (nbody, 4, 4) MuJoCo's bodies.
        raw: Depth and numbers of the left camera as rendered, if its raw image is labelled.
    """

    index: int
    exposure: FrameExposure
    light: tuple[Array, Array]
    brightness: Array
    geometry: GeometryBuffers
    T_world_cam: Array
    T_world_bodies: Array
    raw: tuple[Array, Indices] | None = None


@dataclass(frozen=True)
class StereoImages:
    """Left and right (H, W[, 3]) uint8 images, rectified, and raw if that differs.

    Raw ones are uint16 where the sensor has more than 8 bits.
    """

    rectified: tuple[Image, Image]
    raw: tuple[Image, Image] | None


class StereoCamera:
    """Both cameras; captures frames in order, forms images in any order and thread.

    With H.264 (`sensor.h264_crf`) images are formed in order, as each depends on those before.
    """

    def __init__(self, world: World, settings: RecordSettings) -> None:
        """Prepare lenses and sensors.

        Raises:
            SettingsError: If the distortion folds inside the image, or the package for H.264 is
                missing.
        """
        self._world, self._settings = world, settings
        cameras: tuple[Literal[0, 1], ...] = (0, 1)
        rigs, dirt = (world.rig, world.render_rig), self._soiling
        self.sensors = [ImageSensor(settings, k, *rigs, dirt(k)) for k in cameras]
        perfect = SensorSettings(), CalibrationSettings()
        self._videos = _open_videos(settings)
        self._is_perfect = (settings.sensor, settings.calibration) == perfect

    def with_seed(self, seed: int) -> "StereoCamera":
        """Return this camera at its start, with noise and dirt of another seed.

        Clean lenses are shared.
        """
        settings = self._settings.model_copy(update={"seed": seed})
        if settings.sensor.soiling:
            return StereoCamera(self._world, settings)
        other = copy(self)
        other._settings = settings
        other._videos = _open_videos(settings)
        return other

    def _soiling(self, camera: int) -> Soiling | None:
        """Draw the dirt on a lens."""
        settings, rig = self._settings, self._world.rig
        if not settings.sensor.soiling:
            return None
        margin_px = 2 * raw_margin_px(settings, rig)
        size = rig.height_px + margin_px, rig.width_px + margin_px
        return Soiling(settings.sensor.soiling, size, stream(settings.seed, f"soiling/{camera}"))

    def captures(
        self, trip: Trip, renderer: StereoRenderer, labelled: bool = True
    ) -> Iterator[Capture]:
        """Render a trip's delivered frames; moves the world.

        Unless they are to be labelled, they have geometry only in fog or rain.
        """
        settings, world = self._settings, self._world
        exposure_ms = settings.exposure.time_ms
        automatic = AutoExposure(settings.sensor, exposure_ms or REFERENCE_EXPOSURE_MS)
        fixed = Exposure(exposure_ms, 1.0, 1.0)
        for index in range(len(trip)):
            if not trip.delivered[index]:  # read in its turn: a live trip decides it late
                continue
            control = automatic.next() if settings.sensor.auto_exposure else fixed
            time_ns = int(trip.timestamps_ns[index])
            time_s = time_ns * 1e-9
            world.place(time_s, trip.states.at(world.model, time_ns))
            truth = world.T_world_cam, world.T_world_bodies
            rendered = cache(partial(place_and_render, world, trip, renderer, time_ns))
            is_hazy = not settings.weather.is_clear
            geometry = rendered() if labelled or is_hazy else NO_GEOMETRY
            cropped = cropped_geometry(world, geometry)
            is_raw = labelled and settings.labels.are_raw
            whole = renderer.render_whole_geometry(geometry) if is_raw or is_hazy else geometry
            raw = (whole.depth_left_m, whole.geoms_left) if is_raw else None
            rows, open_s = world.render_rig.height_px, control.time_ms * 1e-3
            shutter = open_shutter(settings.exposure, time_s, open_s, rows)
            light, count = expose(world, trip, renderer, settings.exposure, shutter, rendered)
            light = self.through_air(light, whole, truth[0], open_s, int(index))
            brightness = control.brightness * mean_brightness(world, shutter)
            level = float(brightness.mean())
            exposure = FrameExposure(time_ns, control.time_ms, control.gain, count, level)
            if settings.sensor.auto_exposure:
                automatic.update(self._mean_grey(light[0], exposure.level))
            yield Capture(int(index), exposure, light, brightness, cropped, *truth, raw)

    def through_air(
        self,
        light: tuple[Array, Array],
        whole: GeometryBuffers,
        T_world_cam: Array,
        open_s: float,
        index: int,
    ) -> tuple[Array, Array]:
        """Return the light of both images of a frame in the weather, exposed for `open_s`.

        The geometry is all that is rendered.
        """
        weather, rig = self._settings.weather, self._world.render_rig
        if weather.is_clear:
            return light
        depths_m = whole.depth_left_m, whole.depth_right_m
        ranges_m = (self._world.lens.range_m(k, x) for k, x in enumerate(depths_m))
        rain = weather.rain_mm_h
        ends_m = [x for x in (weather.fog_m, rain and rain_visibility_m(rain)) if x]
        visibility_m = ends_m[0] if len(ends_m) == 1 else 1 / sum(1 / x for x in ends_m)
        left, right = (foggy(x, y, visibility_m) for x, y in zip(light, ranges_m, strict=True))
        if not rain:
            return left, right
        rng = stream(self._settings.seed, f"rain/{index}")
        drops = draw_drops(rain, rig, open_s, -T_world_cam[2, :3], rng)
        left = streaked(left, depths_m[0], rig, drops, 0.0)
        return left, streaked(right, depths_m[1], rig, drops, rig.baseline_m)

    def form_images(self, capture: Capture) -> StereoImages:
        """Convert light to grey levels; noise depends on seed, frame and camera only."""
        rendered = capture.light[0].dtype == np.uint8
        if self._is_perfect and rendered and (capture.brightness == 1).all():
            return StereoImages(capture.light, None)
        raw: list[Image] = []
        for k, (sensor, light) in enumerate(zip(self.sensors, capture.light, strict=True)):
            light = decode(light) if rendered else light
            level = float(capture.brightness.mean())
            rows = capture.brightness / level if level > 0 else capture.brightness
            if (rows != 1).any():
                light = light * rows.astype(np.float32).reshape(-1, *(1,) * (light.ndim - 1))
            rng = stream(self._settings.seed, f"noise/{k}/{capture.index}")
            image = sensor.expose(light, level, capture.exposure.gain, rng)
            raw.append(self._videos[k].through(image) if self._videos else image)
        left, right = (s.undistort(image) for s, image in zip(self.sensors, raw, strict=True))
        if left is raw[0]:  # no distortion, and 8 bits
            return StereoImages((left, right), None)
        margin_px = self.sensors[0].raw_margin_px
        return StereoImages((left, right), (_crop(raw[0], margin_px), _crop(raw[1], margin_px)))

    def _mean_grey(self, light: Array, factor: float) -> float:
        """Predict the mean grey level of the image, from every 8th pixel."""
        few = light[::8, ::8]
        few = decode(np.ascontiguousarray(few)) if few.dtype == np.uint8 else few
        return float(self.sensors[0].encode(few * np.float32(factor)).mean())


def _open_videos(settings: RecordSettings) -> tuple[Video, ...]:
    crf = settings.sensor.h264_crf
    return (Video(crf), Video(crf)) if crf else ()


def place_and_render(
    world: World, trip: Trip, renderer: StereoRenderer, time_ns: int
) -> GeometryBuffers:
    """Bring the world to a time of the trip; return depth and objects in the rendered size."""
    world.place(time_ns * 1e-9, trip.states.at(world.model, time_ns))
    return renderer.render_geometry()


def cropped_geometry(world: World, geometry: GeometryBuffers) -> GeometryBuffers:
    """Return depth and objects in the delivered size; all but the left depth are views."""
    margin_px = (world.render_rig.width_px - world.rig.width_px) // 2
    left_m, *others = (_inner(x, margin_px) for x in vars(geometry).values())
    return GeometryBuffers(np.ascontiguousarray(left_m), *others)


def _crop(image: Array, margin_px: int) -> Array:
    return np.ascontiguousarray(_inner(image, margin_px))


def _inner(image: Array, margin_px: int) -> Array:
    inner = slice(margin_px, -margin_px) if margin_px else slice(None)
    return image[inner, inner]
