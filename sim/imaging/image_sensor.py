"""The sensor: from linear light at the lens to grey levels in the picture."""

from collections.abc import Callable
from functools import lru_cache
from typing import Literal

import cv2
import numpy as np

from sim.imaging.lens import (
    blur_px,
    chip_map,
    chip_margin_px,
    is_distorting,
    picture_map,
    unknown_rotation,
)
from sim.imaging.linear_light import Encoding, Response, levels_to_light, light_to_levels
from sim.imaging.resample import sample, sample_variance
from sim.settings import RecordSettings
from vo.contract.arrays import Array, Image
from vo.contract.rig import StereoRig

WELL = 10_000.0
"""Electrons at the brightest grey level where `full_well` is 0, for the read noise alone."""


class Sensor:
    """One eye: its lens, its pixels, its electronics. Keeps no state between pictures."""

    def __init__(
        self, settings: RecordSettings, eye: Literal[0, 1], rig: StereoRig, rendered: StereoRig
    ) -> None:
        """Prepare all maps and tables.

        Args:
            settings: Of the recording; sensor and calibration are used.
            eye: 0 left, 1 right: the one with `right_gain`, `right_noise` and the unknown turn.
            rig: True geometry in the delivered size.
            rendered: The same with a margin of at least `margin_px` on each side.

        Raises:
            SettingsError: If the lens folds inside the picture.
        """
        sensor = settings.sensor
        self._sensor = sensor
        self._encoding = Encoding(sensor.response)
        self._sensitivity = sensor.right_gain if eye else 1.0
        self._fixed_gain = 10 ** (sensor.gain_db / 20)
        self._well = sensor.full_well or WELL
        self._read_noise = sensor.read_noise * (sensor.right_noise if eye else 1.0)
        self.chip_margin_px = chip_margin_px(settings, rig)
        self._blur_px = blur_px(sensor)
        self._optics = self._optics_of(settings, eye, rig, rendered)
        self._fall_off = _fall_off(sensor.vignetting, rig, self.chip_margin_px)
        self._picture_map: tuple[Array, Array] | None = None
        if is_distorting(sensor):
            u_px, v_px = (a + self.chip_margin_px for a in picture_map(settings, rig))
            self._picture_map = u_px.astype(np.float32), v_px.astype(np.float32)

    @property
    def is_noisy(self) -> bool:
        """Whether pictures need random numbers."""
        return self._sensor.full_well > 0 or self._read_noise > 0

    def expose(
        self, light: Array, brightness: float, gain: float, rng: np.random.Generator
    ) -> Image:
        """Take a picture.

        Args:
            light: (H', W'[, 3]) float32 linear light in the rendered size, 1 the brightest that
                is shown when brightness and all gains are 1.
            brightness: Exposure, as a multiple of the one for which `light` holds.
            gain: Of the automatic exposure, on top of `gain_db`.
            rng: Draws the noise; one for each eye. Untouched if there is no noise.

        Returns:
            (H + 2 m, W + 2 m[, 3]) uint8 chip, m = `chip_margin_px`: 0 without distortion. If
            nothing is set, exactly the image that `light` was decoded from.
        """
        light = self._optics(light)
        amplified = np.float32(brightness * self._sensitivity * gain * self._fixed_gain)
        if self._fall_off is not None:
            factor = amplified * self._fall_off
            light = light * (factor if light.ndim == 2 else factor[..., None])
        elif amplified != 1:
            light = light * amplified
        if not self.is_noisy:
            return self._encoding(light)
        return self._encoding.encode_noisy(light, *self._variances(gain), rng)

    def encode(self, light: Array) -> Image:
        """Grey levels, uint8, without noise, lens and fall-off, for metering.

        Args:
            light: Linear, any shape; `gain_db` and the eye's sensitivity are still to come.
        """
        return self._encoding(light * np.float32(self._sensitivity * self._fixed_gain))

    def undistort(self, chip: Image) -> Image:
        """Make the chip's picture a pinhole's by the delivered calibration.

        Args:
            chip: (H + 2 m, W + 2 m[, 3]) uint8 as `expose` returns it.

        Returns:
            (H, W[, 3]) uint8; `chip` itself if the lens does not distort.
        """
        if self._picture_map is None:
            return chip
        picture = self._delivered(chip.astype(np.float32))
        return np.asarray(cv2.convertScaleAbs(np.maximum(picture, 0)), np.uint8)

    @property
    def noise_share(self) -> Array | None:
        """Share of the chip's noise variance that `undistort` leaves; None if it does nothing.

        (H, W) float32. What is left is correlated between neighbours.
        """
        if self._picture_map is None:
            return None
        u_px, v_px = self._picture_map
        return sample_variance(np.ones((2, 2), np.float32), u_px, v_px)

    def flattened(self, picture: Image, exposed: float = 1.0) -> Array:
        """Undo vignetting, this eye's own sensitivity and an exposure in a rectified picture.

        Args:
            picture: (H, W[, 3]) uint8.
            exposed: Exposure and gain, as a multiple of what they should have been.

        Returns:
            (H, W[, 3]) grey levels, uint8 if there is nothing to undo, else float32.
        """
        share = self._share(picture, exposed)
        if share is None:
            return picture
        response = self._sensor.response
        light = levels_to_light(response, np.arange(256)).astype(np.float32)
        return light_to_levels(response, light[picture] / share).astype(np.float32)

    def stretch(self, picture: Image, exposed: float = 1.0) -> Array:
        """By how much `flattened` multiplies a small difference at each pixel of a picture.

        Args:
            picture: As for `flattened`.
            exposed: As for `flattened`.

        Returns:
            (H, W[, 3]) float32; the slope of light over grey levels before and after.
        """
        share = self._share(picture, exposed)
        if share is None:
            return np.broadcast_to(np.float32(1), picture.shape)
        levels = np.arange(256)
        slope = np.gradient(levels_to_light(self._sensor.response, levels))
        after = np.interp(self.flattened(picture, exposed), levels, slope)
        return (slope[picture] / (share * after)).astype(np.float32)

    def _share(self, picture: Image, exposed: float) -> Array | None:
        """Share of the light that a picture should have; None where it has it all."""
        light = np.float32(self._sensitivity * exposed)
        if self._fall_off is None:
            return None if light == 1 else np.asarray(light)
        share = light * self._delivered(self._fall_off)
        return share if picture.ndim == 2 else share[..., None]

    def noise_sigma(self, gain: float) -> Array:
        """Standard deviation in grey levels that noise adds at each noise-free grey level.

        On the chip, clipping included and rounding excluded; brightness, sensitivity and
        vignetting matter only through the level they lead to.

        Args:
            gain: Of the automatic exposure, as in `expose`.

        Returns:
            (256,) float32, read-only.
        """
        return _noise_table(self._sensor.response, *self._variances(gain))

    def _delivered(self, chip: Array) -> Array:
        """Resample (H + 2 m, W + 2 m[, 3]) float32 of the chip for the picture, (H, W[, 3])."""
        return chip if self._picture_map is None else sample(chip, *self._picture_map)

    def _variances(self, gain: float) -> tuple[float, float]:
        """Noise of the amplified light y, as variances per y and at y = 0.

        With e electrons, y = G e / well and var(e) = e + read^2, so
        var(y) = (G / well) y + (G read / well)^2.
        """
        per_electron = gain * self._fixed_gain / self._well
        shot = per_electron if self._sensor.full_well > 0 else 0.0
        return shot, (per_electron * self._read_noise) ** 2

    def _optics_of(
        self, settings: RecordSettings, eye: int, rig: StereoRig, rendered: StereoRig
    ) -> Callable[[Array], Array]:
        """Return what takes rendered light to the chip: bend, crop and blur, where they do much."""
        R = unknown_rotation(settings.calibration) if eye else np.eye(3)
        blur, pad = self._blur_px, self._blur_px + self.chip_margin_px
        rows, columns = rendered.height_px - rig.height_px, rendered.width_px - rig.width_px
        top, left = rows // 2, columns // 2
        bends = is_distorting(settings.sensor) or not np.array_equal(R, np.eye(3))
        places = chip_map(settings, rig, R, pad) if bends else None
        if places is None and min(top, left) < pad:
            raise ValueError(f"rendered margin of {min(top, left)} px, needed {pad} px")
        if places is not None:
            places = (places[0] + left).astype(np.float32), (places[1] + top).astype(np.float32)

        def optics(light: Array) -> Array:
            if light.shape[:2] != (rendered.height_px, rendered.width_px):
                raise ValueError(f"light of {light.shape}, rendered are {rendered}")
            if places is not None:
                light = sample(light, *places)
            else:
                height, width = rig.height_px + 2 * pad, rig.width_px + 2 * pad
                light = light[top - pad :, left - pad :][:height, :width]
            if blur:
                size, deviation = (2 * blur + 1, 2 * blur + 1), settings.sensor.softness_px
                light = cv2.GaussianBlur(light, size, deviation)[blur:-blur, blur:-blur]
            return light

        return optics


@lru_cache(maxsize=64)  # both eyes of every frame ask; the gain changes rarely, if at all
def _noise_table(response: Response, shot: float, floor: float) -> Array:
    """Standard deviation (256,) of each level of light y whose variance is shot y + floor."""
    light = levels_to_light(response, np.arange(256))[:, None]
    z = np.linspace(-6, 6, 241)
    share = np.exp(-z * z / 2) / np.exp(-z * z / 2).sum()
    levels = light_to_levels(response, light + np.sqrt(shot * light + floor) * z)
    mean = (levels * share).sum(axis=1, keepdims=True)
    table = np.sqrt(((levels - mean) ** 2 * share).sum(axis=1)).astype(np.float32)
    table.flags.writeable = False
    return table


def _fall_off(vignetting: float, rig: StereoRig, margin_px: int) -> Array | None:
    """(H + 2 m, W + 2 m) float32 share of light, 1 - vignetting in the picture's corner."""
    if vignetting == 0:
        return None
    u = np.arange(-margin_px, rig.width_px + margin_px) - rig.cx_px
    v = np.arange(-margin_px, rig.height_px + margin_px) - rig.cy_px
    r2 = (u * u + (v * v)[:, None]) / (rig.cx_px**2 + rig.cy_px**2)
    return np.maximum(1 - vignetting * r2, 0).astype(np.float32)
