"""The stereo camera: frame by frame, what both eyes gather and what is true at mid-exposure."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sim.camera.exposure import expose, mean_brightness, open_shutter
from sim.camera.render import GeometryBuffers, StereoRenderer
from sim.imaging.auto_exposure import AutoExposure, Exposure
from sim.imaging.image_sensor import Sensor
from sim.imaging.linear_light import decode
from sim.settings import RecordSettings
from sim.world.random_streams import stream
from sim.world.trip import Trip
from sim.world.world import World
from vo.contract.arrays import Array, Image

PAINTED_MS = 10.0
"""Exposure that gives the painted brightness where `exposure.time_ms` does not say."""


@dataclass(frozen=True)
class FrameExposure:
    """How a frame was exposed.

    Attributes:
        timestamp_ns: Mid-exposure.
        exposure_ms: Open shutter.
        gain: Of the automatic exposure.
        subframes: Renders that it took.
        brightness: Light that the left eye received, as a multiple of what is painted; mean of
            the rows.
    """

    timestamp_ns: int
    exposure_ms: float
    gain: float
    subframes: int
    brightness: float

    @property
    def level(self) -> float:
        """Of the picture, as a multiple of what is painted, in linear light."""
        return self.brightness * self.gain


@dataclass(frozen=True)
class Capture:
    """One frame before it is developed, and the truth at its mid-exposure.

    Attributes:
        index: Of the frame on the trip.
        exposure: How it was exposed.
        light: Left and right images in the rendered size; uint8 as painted if there was a single
            sub-frame, else float32 linear light.
        brightness: (H',) light on each row, as a multiple of what is painted.
        geometry: Depth and identity, in the delivered size.
        T_world_cam: (4, 4) left camera.
        T_world_bodies: (nbody, 4, 4) of MuJoCo's bodies.
    """

    index: int
    exposure: FrameExposure
    light: tuple[Array, Array]
    brightness: Array
    geometry: GeometryBuffers
    T_world_cam: Array
    T_world_bodies: Array


@dataclass(frozen=True)
class StereoImages:
    """One frame as it is delivered.

    Attributes:
        rectified: Left and right (H, W) grey or (H, W, 3) RGB, uint8.
        raw: The same before rectification; None where the lens does not distort.
    """

    rectified: tuple[Image, Image]
    raw: tuple[Image, Image] | None


class StereoCamera:
    """Both eyes behind one shutter; captures in order, develops in any order and thread."""

    def __init__(self, world: World, settings: RecordSettings) -> None:
        """Prepare lenses and electronics.

        Raises:
            SettingsError: If the lens folds inside the picture.
        """
        self._world, self._settings = world, settings
        eyes: tuple[Literal[0, 1], ...] = (0, 1)
        self.sensors = [Sensor(settings, eye, world.rig, world.render_rig) for eye in eyes]
        self._perfect = (
            settings.sensor == type(settings.sensor)()
            and settings.calibration == type(settings.calibration)()
        )
        self._margin_px = (world.render_rig.width_px - world.rig.width_px) // 2

    def captures(self, trip: Trip, renderer: StereoRenderer) -> Iterator[Capture]:
        """Go through a trip's delivered frames; moves the world and draws."""
        settings, world = self._settings, self._world
        painted_ms = settings.exposure.time_ms or PAINTED_MS
        automatic = AutoExposure(settings.sensor, painted_ms)
        fixed = Exposure(settings.exposure.time_ms, 1.0, 1.0)
        for index in np.flatnonzero(trip.delivered):
            control = automatic.next() if settings.sensor.auto_exposure else fixed
            time_s = trip.timestamps_ns[index] * 1e-9
            world.place(time_s, trip.states.at(world.model, trip.timestamps_ns[index]))
            geometry = renderer.render_geometry()
            truth = world.T_world_cam, world.T_world_bodies
            shutter = open_shutter(
                settings.exposure, time_s, control.time_ms * 1e-3, world.render_rig.height_px
            )
            light, count = expose(world, trip, renderer, settings.exposure, shutter, geometry)
            brightness = control.brightness * mean_brightness(world, shutter)
            exposure = FrameExposure(
                int(trip.timestamps_ns[index]),
                control.time_ms,
                control.gain,
                count,
                float(brightness.mean()),
            )
            if settings.sensor.auto_exposure:
                automatic.update(self._mean_grey(light[0], exposure.level))
            yield Capture(
                int(index),
                exposure,
                light,
                brightness,
                self._cropped(geometry),
                *truth,
            )

    def form_images(self, capture: Capture) -> StereoImages:
        """Turn light into grey levels; the noise depends on seed, frame and eye only."""
        if self._perfect and capture.light[0].dtype == np.uint8 and (capture.brightness == 1).all():
            return StereoImages(capture.light, None)
        chips: list[Image] = []
        for eye, (sensor, light) in enumerate(zip(self.sensors, capture.light, strict=True)):
            light = decode(light) if light.dtype == np.uint8 else light
            level = float(capture.brightness.mean())
            bands = capture.brightness / level if level > 0 else capture.brightness
            if (bands != 1).any():
                light = light * bands.astype(np.float32).reshape(-1, *(1,) * (light.ndim - 1))
            rng = stream(self._settings.seed, f"noise/{eye}/{capture.index}")
            chips.append(sensor.expose(light, level, capture.exposure.gain, rng))
        left, right = (s.undistort(c) for s, c in zip(self.sensors, chips, strict=True))
        if left is chips[0]:
            return StereoImages((left, right), None)
        raw_left, raw_right = (
            self._within(chip, sensor.chip_margin_px)
            for chip, sensor in zip(chips, self.sensors, strict=True)
        )
        return StereoImages((left, right), (raw_left, raw_right))

    def _mean_grey(self, light: Array, factor: float) -> float:
        """Mean grey level that a picture will have, from every 8th pixel."""
        few = light[::8, ::8]
        few = decode(np.ascontiguousarray(few)) if few.dtype == np.uint8 else few
        return float(self.sensors[0].encode(few * np.float32(factor)).mean())

    def _cropped(self, geometry: GeometryBuffers) -> GeometryBuffers:
        if self._margin_px == 0:
            return geometry
        cut = {name: self._within(a, self._margin_px) for name, a in vars(geometry).items()}
        return replace(geometry, **cut)

    @staticmethod
    def _within(image: Array, margin_px: int) -> Array:
        inner = slice(margin_px, -margin_px) if margin_px else slice(None)
        return np.ascontiguousarray(image[inner, inner])
