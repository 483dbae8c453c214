"""The image sensor: from linear light at the lens to grey levels."""

from collections.abc import Callable
from functools import lru_cache
from typing import Literal

import cv2
import numpy as np

from sim.imaging import lens
from sim.imaging.chromatic import lateral_colour
from sim.imaging.distortion import has_distortion, is_equidistant
from sim.imaging.linear_light import (
    Curve,
    Encoding,
    curve_of,
    levels_to_light,
    light_to_levels,
    of_each_value,
)
from sim.imaging.resample import sample
from sim.imaging.rescaling import log_of_share, rescale
from sim.imaging.soiling import Soiling
from sim.settings import RecordSettings
from vo.contract.arrays import Array, Image
from vo.contract.rig import StereoRig

WELL = 10_000.0
"""Electrons at the brightest grey level where `full_well` is 0, for the read noise alone."""


class ImageSensor:
    """Lens, pixels and electronics of one camera, without state.

    Its raw images are (H + 2 m, W + 2 m), m = `raw_margin_px`: 0 without distortion.
    """

    def __init__(
        self,
        settings: RecordSettings,
        camera: Literal[0, 1],
        rig: StereoRig,
        rendered: StereoRig,
        soiling: Soiling | None = None,
    ) -> None:
        """Prepare all maps and tables of the left camera, 0, or the right one, 1.

        The rig is the true geometry in the delivered size, the rendered one has a margin of at
        least `lens.margin_px` on each side.

        Raises:
            SettingsError: If the distortion folds inside the image.
        """
        sensor = settings.sensor
        self._sensor = sensor
        self._encoding = Encoding(curve_of(sensor))
        self._sensitivity = sensor.right_gain if camera else 1.0
        self._fixed_gain = 10 ** (sensor.gain_db / 20)
        self._well = sensor.full_well or WELL
        self._read_noise = sensor.read_noise * (sensor.right_noise if camera else 1.0)
        self.raw_margin_px = lens.raw_margin_px(settings, rig)
        self._optics = self._optics_of(settings, camera, rig, rendered)
        self._soiling = soiling
        self._falloff = _vignetting_falloff(sensor.vignetting, rig, self.raw_margin_px)
        self._rectification: tuple[Array, Array] | None = None
        if has_distortion(sensor):
            places = lens.delivered_to_raw(settings, rig, lens.pixel_grid(rig))
            u_px, v_px = (a + self.raw_margin_px for a in places)
            self._rectification = u_px.astype(np.float32), v_px.astype(np.float32)
        self._log_share: Array | None = None
        if self._falloff is not None:
            self._log_share = log_of_share(self._rectified(self._falloff))

    def expose(
        self, light: Array, brightness: float, gain: float, rng: np.random.Generator
    ) -> Image:
        """Take a raw image; with default settings, the image that `light` was decoded from.

        It is uint8, or uint16 of 0 to 2^bits - 1 where the sensor has more bits.

        The light (H', W'[, 3]) is float32 and linear, in the rendered size; 1 is the brightest
        level. The exposure is `brightness` times the one for which it holds; the gain is that of
        the automatic exposure, besides `gain_db`. The generator is of this camera alone.
        """
        light = self._optics(light)
        if self._soiling is not None:
            light = self._soiling(light)
        amplified = np.float32(brightness * self._sensitivity * gain * self._fixed_gain)
        is_noisy = self._sensor.full_well > 0 or self._read_noise > 0
        noise = (*self._variances(gain), rng) if is_noisy else None
        share = amplified if self._falloff is None else amplified * self._falloff
        if noise and self._sensor.bits == 8:
            image = self._encoding.encode_noisy(light, *noise, share)
        else:
            if share.ndim or share != 1:
                light = light * of_each_value(share, light.shape).reshape(light.shape)
            if self._sensor.bits > 8:
                return self._encoding.encode_deep(light, self._sensor.bits, noise)
            image = self._encoding(light)
        return _compressed(image, self._sensor.jpeg_quality) if self._sensor.jpeg_quality else image

    def encode(self, light: Array) -> Image:
        """Return grey levels, uint8, of linear light, for metering: no noise, lens or falloff."""
        return self._encoding(light * np.float32(self._sensitivity * self._fixed_gain))

    def undistort(self, raw: Image) -> Image:
        """Rectify a raw image by the delivered calibration: (H, W[, 3]) uint8.

        Without distortion, return `raw` itself, if it has 8 bits.
        """
        if self._rectification is None and raw.dtype == np.uint8:
            return raw
        image, scale = self._rectified(raw.astype(np.float32)), 255 / (2**self._sensor.bits - 1)
        return np.asarray(cv2.convertScaleAbs(np.maximum(image, 0), None, scale), np.uint8)

    def corrected(self, image: Image, exposed: float = 1.0) -> tuple[Array, Array]:
        """Undo vignetting, sensitivity and an exposure (with gain) in a rectified image.

        Returns:
            (H, W[, 3]) grey levels, uint8 if there is nothing to undo, else float32, and float32 in
                the same shape, by which factor each multiplies small differences.
        """
        light = np.float32(self._sensitivity * exposed)
        log_share = self._log_share
        if log_share is None:
            if light == 1:
                return image, np.broadcast_to(np.float32(1), image.shape)
            log_share = np.zeros(image.shape[:2], np.float32)
        return rescale(curve_of(self._sensor), image, log_share, float(light))

    def noise_sigma(self, gain: float) -> Array:
        """Return the standard deviation (256,) of the noise at each noise-free grey level.

        It holds for the raw image, with clipping and without rounding; exposure settings besides
        the gain only change the level. The array is float32 and read-only.
        """
        return _noise_table(curve_of(self._sensor), *self._variances(gain))

    def _rectified(self, raw: Array) -> Array:
        return raw if self._rectification is None else sample(raw, *self._rectification)

    def _variances(self, gain: float) -> tuple[float, float]:
        """Noise of the amplified light y, as variances per y and at y = 0.

        With e electrons, y = G e / well and var(e) = e + read^2, so
        var(y) = (G / well) y + (G read / well)^2.
        """
        per_electron = gain * self._fixed_gain / self._well
        shot = per_electron if self._sensor.full_well > 0 else 0.0
        return shot, (per_electron * self._read_noise) ** 2

    def _optics_of(
        self, settings: RecordSettings, camera: int, rig: StereoRig, rendered: StereoRig
    ) -> Callable[[Array], Array]:
        """Return the map of rendered light to the sensor: distortion, crop and blur."""
        R = lens.miscalibration_rotation(settings.calibration) if camera else np.eye(3)
        blur = lens.psf_radius_px(settings.sensor)
        pad = blur + self.raw_margin_px
        rows, columns = rendered.height_px - rig.height_px, rendered.width_px - rig.width_px
        top, left = rows // 2, columns // 2
        bends = has_distortion(settings.sensor) or not np.array_equal(R, np.eye(3))
        bends &= not is_equidistant(settings.sensor)  # its views are drawn as raw light
        grid, shift_px = lens.pixel_grid(rig, pad), settings.sensor.chromatic_px
        coloured = lateral_colour(rig, pad, shift_px) if shift_px else None
        places = lens.raw_to_nominal(settings.sensor, rig, R, grid) if bends else None
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
            if coloured:
                light = coloured(light)
            if blur:
                size, sigma = (2 * blur + 1, 2 * blur + 1), settings.sensor.softness_px
                light = cv2.GaussianBlur(light, size, sigma)[blur:-blur, blur:-blur]
            return light

        return optics


def _compressed(image: Image, quality: int) -> Image:
    """Return what remains of (H, W[, 3]) uint8 after JPEG with chroma 4:2:2."""
    options = (
        *(cv2.IMWRITE_JPEG_QUALITY, quality),
        *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422),
    )
    data = cv2.imencode(".jpg", image[..., ::-1] if image.ndim == 3 else image, options)[1]
    decoded = np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED), np.uint8)
    return np.ascontiguousarray(decoded[..., ::-1]) if image.ndim == 3 else decoded


@lru_cache(maxsize=64)  # called for both cameras and every frame; the gain changes rarely
def _noise_table(curve: Curve, shot: float, floor: float) -> Array:
    """Standard deviation (256,) of each level of light y whose variance is shot y + floor."""
    light = levels_to_light(curve, np.arange(256))[:, None]
    z = np.linspace(-6, 6, 241)
    share = np.exp(-z * z / 2) / np.exp(-z * z / 2).sum()
    levels = light_to_levels(curve, light + np.sqrt(shot * np.maximum(light, 0) + floor) * z)
    mean = (levels * share).sum(axis=1, keepdims=True)
    table = np.sqrt(((levels - mean) ** 2 * share).sum(axis=1)).astype(np.float32)
    table.flags.writeable = False
    return table


def _vignetting_falloff(vignetting: float, rig: StereoRig, margin_px: int) -> Array | None:
    """(H + 2 m, W + 2 m) float32 fraction of light, 1 - vignetting in the image's corner."""
    if vignetting == 0:
        return None
    u = np.arange(-margin_px, rig.width_px + margin_px) - rig.cx_px
    v = np.arange(-margin_px, rig.height_px + margin_px) - rig.cy_px
    r2 = (u * u + (v * v)[:, None]) / (rig.cx_px**2 + rig.cy_px**2)
    return np.maximum(1 - vignetting * r2, 0).astype(np.float32)
