"""Photometric check: how well the labels explain the pixels, given the injected noise.

Right images are warped to left ones by the disparity, next to present ones by the flow, where both
show a pixel, after correction of exposure, vignetting, the right camera's gain and its true turn.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from sim.camera.camera import FrameExposure
from sim.certificate import bias
from sim.certificate.bias import Shift
from sim.imaging.distortion import has_distortion
from sim.imaging.image_sensor import ImageSensor
from sim.imaging.lens import miscalibration_rotation
from sim.imaging.resample import sample, sample_variance
from sim.labels.labels import VISIBLE, visible_in_right
from sim.settings import RecordSettings
from vo.contract import se3
from vo.contract.arrays import Array, Image, Indices, Mask
from vo.contract.rig import StereoRig

SHIFT_PX = 0.5
SHARE = 0.8
FINE_GREY = 0.3
NOISE_FACTOR = 1.3
SHARE_OF_BIAS = 1.2
"""A frame passes if its median residual is at most FINE_GREY (the rounding of two images), at
most NOISE_FACTOR times that of the injected noise, or less than SHARE of that of a label wrong by
SHIFT_PX to either side: residuals depend on texture, so that no constant fits every scene. The
share is SHARE_OF_BIAS where four times SHIFT_PX would be found as a bias: what remains is a change
of blur or of highlights."""
VISIBLE_MIN = 0.01
"""Smallest visible fraction that has a median: of less, most pixels are outlines."""
ROW_STEP = 16
METHOD = {
    "about": "absolute grey-level differences, warped bicubically, of every "
    f"{ROW_STEP}th row's pixels that both images show: left against right by the disparity, "
    "and present against next left image by the flow",
    "rule": f"a frame passes if its median is at most {FINE_GREY:g}, or {NOISE_FACTOR:g} times "
    f"what the injected noise explains, or {SHARE:g} times what a label wrong by "
    f"{SHIFT_PX:g} px leaves ({SHARE_OF_BIAS:g} times, where four times that bias would be "
    "found), and if no bias is found",
}

MIN_LEVEL = 1e-6
"""Smallest exposure level, as a multiple of the rendered brightness."""
BINS_PER_GREY = 50
"""Resolution of the histograms: residuals are exact to 1/50 grey level."""
MEDIAN_OF_NORMAL = 0.67449
"""Median of the absolute value of a standard normal variable."""
ROUNDING_VARIANCE = 1 / 12
"""Variance of a level rounded to an integer."""
GREY_WEIGHTS = np.array([0.299, 0.587, 0.114], np.float32)
"""Weights of red, green and blue (ITU-R BT.601), as in OpenCV."""


@dataclass(frozen=True)
class Residual:
    """Photometric residuals of one warp, on the visible fraction of pixels that both images show.

    The histogram (256 * BINS_PER_GREY + 1,) is of absolute residuals. The other medians are those
    of the better of two labels wrong by SHIFT_PX, and of noise and rounding alone. The displacement
    is how far blurred images may be from their labels.
    """

    histogram: Indices
    shifted_median: float
    noise_median: float
    visible_fraction: float
    shift: Shift
    displacement_px: float = 0.0

    @property
    def median(self) -> float:
        """Median absolute residual in grey levels."""
        return quantile(self.histogram, 0.5)

    @property
    def passed(self) -> bool:
        """Whether the label explains the pixels."""
        found_px = self.shift.smallest_found_px(bias.FRAME_MAX_PX, bias.FRAME_ERRORS)
        share = SHARE_OF_BIAS if found_px <= 4 * SHIFT_PX else SHARE
        limits = FINE_GREY, NOISE_FACTOR * self.noise_median, share * self.shifted_median
        steady = self.displacement_px <= bias.FRAME_MAX_PX
        is_shifted = self.shift.is_found(self.shift_max_px, bias.FRAME_ERRORS, steady)
        is_explained = self.median <= max(limits) or self.visible_fraction < VISIBLE_MIN
        return is_explained and not is_shifted

    @property
    def shift_max_px(self) -> float:
        """Largest shift of a right label, pixels."""
        return bias.FRAME_MAX_PX + self.displacement_px


@dataclass(frozen=True)
class FrameResidual:
    """Residuals of a frame: of the right image by the disparity, of the next by any flow.

    The median error of the flow's static part against depth and poses is in pixels.
    """

    timestamp_ns: int
    stereo: Residual
    flow: Residual | None
    geometry_px: float | None = None


class PhotometricCheck:
    """Residuals of frames, corrected for the known effects of the sensors."""

    def __init__(
        self, settings: RecordSettings, rig: StereoRig, sensors: Sequence[ImageSensor]
    ) -> None:
        """Prepare the check for the true rig and the left and right sensors."""
        self._sensors = sensors
        R = miscalibration_rotation(settings.calibration)
        self._H_true_nominal = np.ascontiguousarray(rig.K @ R.T @ np.linalg.inv(rig.K))
        self._is_interpolated = has_distortion(settings.sensor)
        self._is_turned = not np.array_equal(R, np.eye(3))

    def stereo(
        self, left: Image, right: Image, disparity_px: Array, exposure: FrameExposure
    ) -> Residual:
        """Compare left and right (H, W[, 3]) uint8 image by the disparity label (H, W)."""
        first = self._corrected(0, left, exposure.gain)
        second = self._corrected(1, right, exposure.gain)
        step = _row_step(first[1], second[1])
        visible = visible_in_right(disparity_px[::step])
        motion = -disparity_px[..., None]
        disparity_px = disparity_px[::ROW_STEP]
        v, u = _rows(left)

        def positions(shift_px: float) -> tuple[Array, Array]:
            return self._in_true_right(u - disparity_px - np.float32(shift_px), v)

        shifted = [positions(shift) for shift in (-SHIFT_PX, SHIFT_PX)]
        shift = self._shift(first[0], second[0], motion, visible, self._H_true_nominal)
        visible = visible[:: ROW_STEP // step]
        return _compare(first, second, positions(0.0), shifted, visible, shift)

    def flow(
        self,
        now: Image,
        following: Image,
        flow: Array,
        covisibility: Array,
        exposures: tuple[FrameExposure, FrameExposure],
        displacement_px: float = 0.0,
    ) -> Residual:
        """Compare successive left images (H, W[, 3]) uint8 by flow and covisibility labels.

        Blurred images may be displaced from their labels.
        """
        v, u = _rows(now)
        du, dv = flow[::ROW_STEP, :, 0], flow[::ROW_STEP, :, 1]
        brighter = max(exposures[1].level, MIN_LEVEL) / max(exposures[0].level, MIN_LEVEL)
        first = self._corrected(0, now, exposures[0].gain)
        second = self._corrected(0, following, exposures[1].gain, brighter)
        step = _row_step(first[1], second[1])
        visible = covisibility[::step] == VISIBLE
        half = SHIFT_PX / np.sqrt(2).astype(np.float32)
        shifted = [(u + du + s, v + dv + s) for s in (-half, half)]
        motion = np.ascontiguousarray(flow)
        shift = self._shift(first[0], second[0], motion, visible, np.eye(3))
        visible = visible[:: ROW_STEP // step] & np.isfinite(du)
        compared = _compare(first, second, (u + du, v + dv), shifted, visible, shift)
        return replace(compared, displacement_px=displacement_px)

    def _shift(self, levels: Array, others: Array, motion: Array, visible: Mask, H: Array) -> Shift:
        lag = 2 if self._is_interpolated else 1
        return bias.shift_of(levels, others, motion, visible, H, min(motion.shape[2], 2), lag)

    def _corrected(
        self, camera: int, image: Image, gain: float, level: float = 1.0
    ) -> tuple[Array, "NoisyImage"]:
        """Return (H, W) corrected grey levels, and the delivered image with its noise."""
        sensor = self._sensors[camera]
        levels, factor = sensor.corrected(image, level)
        return _grey(levels), NoisyImage(image, sensor.noise_sigma(gain), factor)

    def _in_true_right(self, u: Array, v: Array) -> tuple[Array, Array]:
        """Map nominal right pixels to the true right camera, which may be turned."""
        if not self._is_turned:
            return u, v
        x, y, w = np.einsum(
            "ij,j...->i...", self._H_true_nominal, np.stack([u, v, np.ones_like(u)])
        )
        return (x / w).astype(np.float32), (y / w).astype(np.float32)


def flow_error(rig: StereoRig, depth_m: Array, flow: Array, T_next_now: Array) -> float:
    """Return the median error, px, of a flow label (H, W, 3) against depth (H, W) and motion.

    The motion (4, 4) is that of the camera; few pixels show things that move. NaN without depth.
    """
    v, u = np.mgrid[: rig.height_px : ROW_STEP, : rig.width_px].reshape(2, -1)
    depth = depth_m[v, u].astype(np.float64)
    known = np.isfinite(depth) & np.isfinite(flow[v, u, 0])
    v, u = v[known], u[known]
    pixels = np.column_stack([u, v])
    points = np.column_stack([rig.normalized(pixels), np.ones(len(u))]) * depth[known, None]
    moved = rig.project(se3.transform(T_next_now, points))[:, :2] - pixels
    return float(np.median(np.abs(moved - flow[v, u, :2]).max(axis=1))) if len(u) else np.nan


def quantile(histogram: Indices, q: float) -> float:
    """Return the absolute residual, grey levels, below which a share q of the pixels lies."""
    cumulative = np.cumsum(histogram)
    return float(np.searchsorted(cumulative, q * cumulative[-1]) / BINS_PER_GREY)


@dataclass(frozen=True)
class NoisyImage:
    """An image as delivered, (H, W[, 3]) uint8, with the standard deviation (256,) of its noise.

    The gain multiplied each pixel's noise and rounding afterwards, in the image's shape.
    """

    image: Image
    sigma: Array
    gain: Array | float = 1.0

    @property
    def grey_variance(self) -> Array:
        """(H, W) float32 variance of the grey of each pixel, rounding included."""
        table = (np.asarray(self.sigma, np.float64) ** 2 + ROUNDING_VARIANCE).astype(np.float32)
        variance = cv2.LUT(self.image, table) * np.square(self.gain, dtype=np.float32)
        return variance if self.image.ndim == 2 else variance @ GREY_WEIGHTS**2


def residual(image: Image, other: Image, u_px: Array, v_px: Array, visible: Mask) -> Array:
    """Return image minus the other image warped to it, bicubic, in grey levels.

    Both are (H, W[, 3]); (u_px, v_px) are (H, W) positions in the other one, the right image for a
    disparity, the next for a flow. (N,) float32 of the visible pixels, row by row.
    """
    warped = sample(_grey(other), *_positions(u_px, v_px, visible))[0]
    return _grey(image)[visible] - warped


def expected_residual(
    image: NoisyImage, other: NoisyImage, u_px: Array, v_px: Array, visible: Mask
) -> Array:
    """Return the standard deviation (N,) float32 of each `residual` from noise and rounding."""
    own = image.grey_variance[visible]
    return np.sqrt(own + sample_variance(other.grey_variance, *_positions(u_px, v_px, visible))[0])


def _positions(u_px: Array, v_px: Array, visible: Mask) -> tuple[Array, Array]:
    """(1, N) float32 each."""
    return u_px[visible][None].astype(np.float32), v_px[visible][None].astype(np.float32)


def _grey(image: Image) -> Array:
    """(H, W) float32."""
    levels: Array = image.astype(np.float32, copy=False)
    return levels if levels.ndim == 2 else np.asarray(cv2.cvtColor(levels, cv2.COLOR_RGB2GRAY))


def _row_step(image: NoisyImage, other: NoisyImage) -> int:
    """Return the `row_step` of two images."""
    sigma = max(float(x.sigma[len(x.sigma) // 2]) for x in (image, other))
    return bias.row_step(image.image.shape[0] * image.image.shape[1], sigma)


def _rows(image: Image) -> tuple[Array, Array]:
    """(v, u) float32 of every ROW_STEP-th row."""
    v, u = np.mgrid[: image.shape[0] : ROW_STEP, : image.shape[1]].astype(np.float32)
    return v, u


def _compare(
    first: tuple[Array, NoisyImage],
    second: tuple[Array, NoisyImage],
    positions: tuple[Array, Array],
    shifted: Sequence[tuple[Array, Array]],
    visible: Mask,
    shift: Shift,
) -> Residual:
    """Warp the second image to every ROW_STEP-th row of the first, where it is visible.

    Positions are those of the compared rows in the second image; shifted ones are wrong.
    """
    levels, noisy = first
    noisy = NoisyImage(noisy.image[::ROW_STEP], noisy.sigma, np.asarray(noisy.gain)[::ROW_STEP])

    def histogram(at: tuple[Array, Array]) -> Indices:
        absolute = np.abs(residual(levels[::ROW_STEP], second[0], *at, visible))
        bins = np.minimum(absolute * BINS_PER_GREY, 256 * BINS_PER_GREY).astype(np.int64)
        return np.bincount(bins, minlength=256 * BINS_PER_GREY + 1)

    expected = expected_residual(noisy, second[1], *positions, visible)
    noise = MEDIAN_OF_NORMAL * float(np.median(expected)) if len(expected) else 0.0
    shifted_median = min(quantile(histogram(at), 0.5) for at in shifted)
    return Residual(histogram(positions), shifted_median, noise, float(visible.mean()), shift)
