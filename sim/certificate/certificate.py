"""The certificate: how well the labels explain the pixels, given the noise that was injected.

Right images are warped to left ones by the disparity, next images to present ones by the flow, on
the pixels that both see. What the sensor is known to do to one of the two images only (the right
eye's gain, another exposure, vignetting, a turn that calibration ignores) is undone or followed
first.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.camera.camera import FrameExposure
from sim.imaging.image_sensor import ImageSensor
from sim.imaging.lens import miscalibration_rotation
from sim.labels.labels import visible_in_right
from sim.labels.visibility import VISIBLE
from sim.labels.warp import expected_residual, residual
from sim.settings import RecordSettings
from vo.contract.arrays import Array, Image, Indices, Mask
from vo.contract.rig import StereoRig

SHIFT_PX = 0.5
SHARE = 0.8
FINE_GREY = 0.3
NOISE_FACTOR = 1.2
"""A frame passes if its median residual is at most FINE_GREY (what rounding two images leaves),
at most NOISE_FACTOR times what the injected noise explains, or less than SHARE of what a label
wrong by SHIFT_PX, to either side, would leave: texture decides how large a residual is, and no
constant fits every scene."""

DARK = 1e-6
"""Nothing is exposed less than this, in multiples of what is painted."""
ROW_STEP = 16
BINS_PER_GREY = 50
"""Resolution of the histograms: residuals are exact to 1/50 grey level."""
MEDIAN_OF_NORMAL = 0.67449
"""Median of the absolute value of a standard normal variable."""


@dataclass(frozen=True)
class Residual:
    """Photometric residuals of one warp, on the pixels that both images show.

    Attributes:
        histogram: (256 * BINS_PER_GREY + 1,) pixels by absolute residual.
        shifted_median: Median residual of the better of two labels wrong by SHIFT_PX.
        noise_median: Median residual that noise and rounding alone explain.
        visible_fraction: Pixels compared over all pixels.
    """

    histogram: Indices
    shifted_median: float
    noise_median: float
    visible_fraction: float

    @property
    def median(self) -> float:
        """In grey levels."""
        return quantile(self.histogram, 0.5)

    @property
    def passed(self) -> bool:
        """Whether the label explains the pixels."""
        limits = FINE_GREY, NOISE_FACTOR * self.noise_median, SHARE * self.shifted_median
        return self.median <= max(limits)


@dataclass(frozen=True)
class FrameResidual:
    """One frame's residuals.

    Attributes:
        timestamp_ns: The frame's.
        stereo: Left against right by the disparity.
        flow: Present against next left image by the flow; None where there is no such label.
    """

    timestamp_ns: int
    stereo: Residual
    flow: Residual | None


class PhotometricCheck:
    """Measures frames; knows what the sensor does to their pixels."""

    def __init__(
        self, settings: RecordSettings, rig: StereoRig, sensors: Sequence[ImageSensor]
    ) -> None:
        """Prepare.

        Args:
            settings: Of the recording.
            rig: True geometry.
            sensors: Left and right.
        """
        self._sensors = sensors
        R = miscalibration_rotation(settings.calibration)
        self._H_true_nominal = rig.K @ R.T @ np.linalg.inv(rig.K)
        self._is_turned = not np.array_equal(R, np.eye(3))

    def stereo(
        self, left: Image, right: Image, disparity_px: Array, shot: FrameExposure
    ) -> Residual:
        """Compare both eyes.

        Args:
            left: (H, W) or (H, W, 3) uint8.
            right: Like `left`.
            disparity_px: (H, W) label.
            shot: How the frame was exposed.
        """
        disparity_px = disparity_px[::ROW_STEP]
        v, u = _rows(left)
        visible = visible_in_right(disparity_px)
        first, second = (
            _view(sensor, image, shot.gain, 1.0)
            for sensor, image in zip(self._sensors, (left, right), strict=True)
        )

        def places(shift_px: float) -> tuple[Array, Array]:
            return self._in_true_right(u - disparity_px - np.float32(shift_px), v)

        shifted = [places(shift) for shift in (-SHIFT_PX, SHIFT_PX)]
        return _compare(first, second, places(0.0), shifted, visible)

    def flow(
        self,
        now: Image,
        following: Image,
        flow: Array,
        covisibility: Array,
        shots: tuple[FrameExposure, FrameExposure],
    ) -> Residual:
        """Compare two successive left images.

        Args:
            now: (H, W) or (H, W, 3) uint8.
            following: The next, like `now`.
            flow: (H, W, 3) label.
            covisibility: (H, W) label.
            shots: How both were exposed.
        """
        v, u = _rows(now)
        du, dv = flow[::ROW_STEP, :, 0], flow[::ROW_STEP, :, 1]
        visible = (covisibility[::ROW_STEP] == VISIBLE) & np.isfinite(du)
        brighter = max(shots[1].level, DARK) / max(shots[0].level, DARK)
        first, second = (
            _view(self._sensors[0], image, shot.gain, level)
            for image, shot, level in zip((now, following), shots, (1.0, brighter), strict=True)
        )
        half = SHIFT_PX / np.sqrt(2).astype(np.float32)
        shifted = [(u + du + s, v + dv + s) for s in (-half, half)]
        return _compare(first, second, (u + du, v + dv), shifted, visible)

    def _in_true_right(self, u: Array, v: Array) -> tuple[Array, Array]:
        """Follow the turn of the right eye that calibration does not know."""
        if not self._is_turned:
            return u, v
        x, y, w = np.einsum("ij,jhw->ihw", self._H_true_nominal, np.stack([u, v, np.ones_like(u)]))
        return (x / w).astype(np.float32), (y / w).astype(np.float32)


def _rows(image: Image) -> tuple[Array, Array]:
    """(v, u) float32 of every ROW_STEP-th row."""
    v, u = np.mgrid[: image.shape[0] : ROW_STEP, : image.shape[1]].astype(np.float32)
    return v, u


@dataclass(frozen=True)
class _View:
    """One of two images that are compared.

    Attributes:
        image: As delivered: its levels say how noisy it is.
        flat: (H, W[, 3]) levels as every eye would see them in the same light.
        correction_gain: (H, W[, 3]) by how much that multiplied small differences.
        sigma: (256,) noise by grey level.
    """

    image: Image
    flat: Array
    correction_gain: Array
    sigma: Array

    @property
    def rows(self) -> "_View":
        """Every ROW_STEP-th of them."""
        some = slice(None, None, ROW_STEP)
        return _View(self.image[some], self.flat[some], self.correction_gain[some], self.sigma)


def _view(sensor: ImageSensor, image: Image, gain: float, level: float) -> _View:
    flat, correction_gain = sensor.corrected(image, level), sensor.correction_gain(image, level)
    return _View(image, flat, correction_gain, sensor.noise_sigma(gain))


def _compare(
    first: _View,
    second: _View,
    places: tuple[Array, Array],
    shifted: Sequence[tuple[Array, Array]],
    visible: Mask,
) -> Residual:
    """Warp the second image to rows of the first.

    Args:
        first: All rows.
        second: All rows.
        places: Of the first image's rows in the second.
        shifted: Wrong ones, to compare with.
        visible: Which of them to compare.
    """
    first = first.rows

    def histogram(at: tuple[Array, Array]) -> Indices:
        absolute = np.abs(residual(first.flat, second.flat, *at, visible))
        bins = np.minimum(absolute * BINS_PER_GREY, 256 * BINS_PER_GREY).astype(np.int64)
        return np.bincount(bins, minlength=256 * BINS_PER_GREY + 1)

    expected = expected_residual(
        first.image,
        second.image,
        *places,
        visible,
        first.sigma,
        second.sigma,
        first.correction_gain,
        second.correction_gain,
    )
    noise = MEDIAN_OF_NORMAL * float(np.median(expected)) if len(expected) else 0.0
    shifted_median = min(quantile(histogram(at), 0.5) for at in shifted)
    return Residual(histogram(places), shifted_median, noise, float(visible.mean()))


def quantile(histogram: Indices, q: float) -> float:
    """Absolute residual in grey levels that a share q of the pixels stay within; 0 without any."""
    cumulative = np.cumsum(histogram)
    return float(np.searchsorted(cumulative, q * cumulative[-1]) / BINS_PER_GREY)


def exempt_parts(settings: RecordSettings) -> frozenset[str]:
    """Parts whose labels cannot explain the pixels, because not all were exposed at one time.

    Labels hold for both eyes at once and for the middle row; their residuals are stated, and no
    frame fails for them.
    """
    exposure = settings.exposure
    stereo = {"stereo"} if exposure.right_offset_ms != 0 else set[str]()
    return frozenset(stereo | ({"flow"} if exposure.line_time_us > 0 else set()))


def certify(
    frames: Iterable[FrameResidual],
    checks: dict[str, Any],
    lenient: frozenset[str] = frozenset(),
) -> dict[str, Any]:
    """Summarise all frames; the same images and labels always give the same numbers.

    Args:
        frames: In order.
        checks: From `plausibility.check_folder`; each with its own `passed`.
        lenient: Parts that no frame can fail, from `exempt_parts`.

    Returns:
        JSON-ready content of the manifest's `certificate`.
    """
    frames = list(frames)
    stereo = {frame.timestamp_ns: frame.stereo for frame in frames}
    flow = {frame.timestamp_ns: frame.flow for frame in frames if frame.flow is not None}
    parts = {"stereo": _summary(stereo, "stereo" not in lenient)}
    if flow:
        parts["flow"] = _summary(flow, "flow" not in lenient)
    return {
        "about": "absolute grey-level differences, warped bicubically, of every "
        f"{ROW_STEP}th row's pixels that both images show: left against right by the disparity, "
        "and present against next left image by the flow",
        "rule": f"a frame passes if its median is at most {FINE_GREY:g}, or {NOISE_FACTOR:g} times "
        f"what the injected noise explains, or {SHARE:g} times what a label wrong by "
        f"{SHIFT_PX:g} px leaves",
        **parts,
        **checks,
        "passed": all(part["passed"] for part in [*parts.values(), *checks.values()]),
    }


def _summary(residuals: dict[int, Residual], judged: bool) -> dict[str, Any]:
    total = np.sum([r.histogram for r in residuals.values()], axis=0)
    levels = np.arange(len(total)) / BINS_PER_GREY
    worst_ns, worst = max(residuals.items(), key=lambda item: (item[1].median, -item[0]))
    failed = [time_ns for time_ns, r in residuals.items() if judged and not r.passed]
    return {
        "median_grey": quantile(total, 0.5),
        "rms_grey": round(float(np.sqrt((total * levels**2).sum() / max(total.sum(), 1))), 4),
        "p95_grey": quantile(total, 0.95),
        "noise_median_grey": _middle([r.noise_median for r in residuals.values()]),
        "shifted_median_grey": _middle([r.shifted_median for r in residuals.values()]),
        "visible_fraction": round(
            float(np.mean([r.visible_fraction for r in residuals.values()])), 6
        ),
        "worst_frame_ns": worst_ns,
        "worst_frame_median_grey": worst.median,
        "judged": judged,
        "failed_frames_ns": failed,
        "passed": not failed,
    }


def _middle(values: Sequence[float]) -> float:
    return round(float(np.median(values)), 4)
