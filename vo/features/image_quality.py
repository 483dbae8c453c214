"""Image quality: noise, signal-to-noise ratio of the texture, softness; settings adapted to it.

Source: Immerkær, Fast noise variance estimation, CVIU 1996, here by blocks, of which those with
the least variation give the noise.
"""

import math
from dataclasses import dataclass

import numpy as np

from vo.config import OdometrySettings
from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled

BLOCK_PX = 16
"""Side of a block."""

NOISE_QUANTILE = 0.1
"""Quantile of the blocks' noise that counts as that of the image."""

MIN_NOISE = 0.3
"""Smallest standard deviation of the noise, grey levels: that of rounding."""

NEXT_PX, NEAR_PX, FAR_PX = 1, 2, 4
"""Distances whose differences of grey levels are compared to measure softness."""

LINE_STEP = 8
"""Rows, or columns, from one measured line to the next."""

SMEARED = 3.2
"""Softness in one direction alone above which an image is smeared by motion: sharp images of all
scenes have at most 2.6, of real recordings 2.9, a path of 8 px gives 3.2, one of 20 px 3.7."""

SMEAR_WINDOW_SCALE = 2.1
"""Factor on the sides of aligned patches in smeared images: texture is coarse in one direction."""

DEFOCUS_DISPARITY_SCALE = 2.0
"""Factor on the largest uncertainty and disagreement of disparities out of focus."""

MIN_SIGNAL = 0.25
"""Smallest share of a difference's energy that counts as texture, not as noise."""

MAX_SIDE_PX = 31
"""Largest side of a window."""


@dataclass(frozen=True)
class VeryLowSnr:
    """Adaptation to noisy images whose texture is buried in noise, as at dusk (decision 53).

    There, correlations of what is the same are low, and features are hardly found twice.
    """

    texture_to_noise: float = 0.5
    """Limit, over that of a low SNR."""
    ends: float = 1.3
    """Factor on the limit at which the adaptation ends: it does not begin and end in turn."""
    smoothing: float = 1.5
    """Factor on the standard deviation of the Gaussian for noisy images."""
    window_scale: float = 2.8
    """Factor on the sides of aligned patches."""
    sigma_scale: float = 6.0
    """Factor on the largest uncertainty of disparities: many weak landmarks determine a pose."""
    min_zncc: float = 0.6
    """Minimum correlation of a match."""
    min_align_zncc: float = 0.5
    """Minimum correlation after alignment: large windows tell false matches from true ones."""
    variance: float = 1.5
    """Factor on the covariance of a pose: smoothed noise is alike in neighbouring pixels."""


VERY_LOW_SNR = VeryLowSnr()


@dataclass(frozen=True)
class ImageQuality:
    """Noise, texture and softness of an image.

    Attributes:
        noise: Standard deviation, grey levels.
        texture_to_noise: Ratio of the energies of texture and noise, median over blocks; infinite
            without a block.
        softness: Energy of differences over FAR_PX to that over NEAR_PX, the smaller of the ratios
            along rows and columns: 4, the square of the distances, where all is smooth, 1 to 2.5
            where it is sharp. Motion blurs one direction, a lens out of focus both.
        smear: The larger of these ratios.
    """

    noise: float
    texture_to_noise: float
    softness: float
    smear: float


def measure_image_quality(image: Image) -> ImageQuality:
    """Measure noise, texture and softness of an image (H, W) uint8."""
    noise, texture_to_noise = measure_noise(image)
    if not noise:
        return ImageQuality(0.0, np.inf, 1.0, 1.0)
    columns = np.ascontiguousarray(image[:, ::LINE_STEP].T)
    lines = image[::LINE_STEP], columns
    softness, smear = zip(*(_softness(x, noise) for x in lines), strict=True)
    return ImageQuality(noise, texture_to_noise, min(softness), max(smear))


def measure_noise(image: Image) -> tuple[float, float]:
    """Measure noise and texture to noise of an image (H, W) uint8, as in `ImageQuality`."""
    found = _measure_blocks(image)
    if not len(found):
        return 0.0, np.inf
    ordered = np.sort(found, axis=0)
    noise = max(_quantile(ordered[:, 0], NOISE_QUANTILE), MIN_NOISE)
    return noise, max(_quantile(ordered[:, 1], 0.5) / noise**2 - 1, 0.0)


def _quantile(ordered: Array, quantile: float) -> float:
    """Interpolate linearly in ascending values (N,), N >= 1."""
    low, share = divmod(quantile * (len(ordered) - 1), 1)
    high = min(int(low) + 1, len(ordered) - 1)
    return float(ordered[int(low)] * (1 - share) + ordered[high] * share)


def _softness(lines: Image, noise: float) -> tuple[float, float]:
    """Compare the energy of differences over FAR_PX with that over NEAR_PX along lines (N, L).

    Second, less a known noise, which is underrated where brighter parts have more. First, without
    the part that does not grow with the distance, if that is more: rounding does grow with it.
    """
    next_, near, far = (_mean_squares(lines, x) for x in (NEXT_PX, NEAR_PX, FAR_PX))
    growth = max(near - next_, MIN_SIGNAL * near / 4, MIN_NOISE**2 / 4)
    smooth = 1 + max(far - near, 0) / growth * (NEAR_PX**2 - NEXT_PX**2) / NEAR_PX**2
    floor = max(MIN_SIGNAL * near, MIN_NOISE**2)
    ratio = max(far - 2 * noise**2, floor) / max(near - 2 * noise**2, floor)
    return max(smooth, ratio), ratio


@compiled()
def _mean_squares(lines: Image, distance: int) -> float:
    """Average the squared differences of pixels at a distance along lines (N, L)."""
    total, step = 0, np.uint64(distance)
    for i in range(lines.shape[0]):
        line = np.int32(0)
        for k in range(np.uint64(lines.shape[1] - distance)):
            difference = np.int32(lines[i, k + step]) - np.int32(lines[i, k])
            line += np.int32(difference * difference)
        total += line
    return total / (lines.shape[0] * (lines.shape[1] - distance))


@compiled()
def _measure_blocks(image: Image) -> Array:
    """Measure noise in grey levels, and variance, of every other block each way: (B, 2)."""
    rows, columns = (image.shape[0] - 2) // BLOCK_PX, (image.shape[1] - 2) // BLOCK_PX
    count, one, two = BLOCK_PX * BLOCK_PX, np.uint64(1), np.uint64(2)
    found = np.empty(((rows + 1) // 2 * ((columns + 1) // 2), 2))
    block = 0
    for row in range(0, rows, 2):
        for column in range(0, columns, 2):
            curved = total = squares = np.int32(0)
            for v in range(np.uint64(row * BLOCK_PX), np.uint64((row + 1) * BLOCK_PX)):
                first = np.uint64(column * BLOCK_PX)
                for u in range(first, first + np.uint64(BLOCK_PX)):
                    around = np.int32(0)  # the mask (1, -2, 1), each way
                    here = np.int32(image[v + one, u + one])
                    around += np.int32(image[v, u]) + np.int32(image[v, u + two])
                    around += np.int32(image[v + two, u]) + np.int32(image[v + two, u + two])
                    sides = np.int32(image[v, u + one]) + np.int32(image[v + two, u + one])
                    sides += np.int32(image[v + one, u]) + np.int32(image[v + one, u + two])
                    curved += np.int32(abs(np.int32(around - 2 * sides + 4 * here)))
                    total += here
                    squares += here * here
            found[block, 0] = np.sqrt(np.pi / 2) / 6 * curved / count
            found[block, 1] = squares / count - (total / count) ** 2
            block += 1
    return found


def adapt_settings(
    settings: OdometrySettings, low_snr: bool, defocus: bool, smeared: bool = False,
    very_low_snr: bool = False,
) -> OdometrySettings:  # fmt: skip
    """Widen windows and admit less exact disparities and weaker features, as an image demands.

    Where noise is as strong as texture, or texture is coarse, a patch of the usual size holds
    little information: windows grow (Kanade and Okutomi, PAMI 1994), by one factor for the image,
    by both where it is noisy and out of focus. A smeared image is coarse in one direction. A very
    low SNR is a low one, too.
    """
    windows, searches, s, very_low = [1.0], [1.0], settings.defocus, VERY_LOW_SNR
    if low_snr:
        scale = very_low.window_scale if very_low_snr else settings.low_snr.window_scale
        windows.append(scale)
        searches.append(settings.low_snr.search_scale)
    if defocus or smeared:
        windows.append(s.window_scale if defocus else SMEAR_WINDOW_SCALE)
        searches.append(s.search_scale)
    combined = math.prod if defocus else max
    window_scale, search_scale = combined(windows), combined(searches)
    threshold_scale = s.threshold_scale if defocus else 1.0
    sigma_scale = settings.low_snr.sigma_scale if low_snr else 1.0
    sigma_scale = very_low.sigma_scale if very_low_snr else sigma_scale
    disagreement_scale = DEFOCUS_DISPARITY_SCALE if defocus else 1.0
    sigma_scale = max(sigma_scale, disagreement_scale)
    features, matching, stereo = settings.features, settings.matching, settings.stereo
    features = features.model_copy(update={"threshold": threshold_scale * features.threshold})
    matching = matching.model_copy(update={"align_px": _widen(matching.align_px, window_scale)})
    if very_low_snr:
        least = {"min_zncc": very_low.min_zncc, "min_align_zncc": very_low.min_align_zncc}
        matching = matching.model_copy(update=least)
    stereo = stereo.model_copy(
        update={
            "patch_px": _widen(stereo.patch_px, search_scale),
            "align_px": _widen(stereo.align_px, window_scale),
            "max_sigma_px": sigma_scale * stereo.max_sigma_px,
            "max_disagreement_px": disagreement_scale * stereo.max_disagreement_px,
        }
    )
    adapted = {"features": features, "matching": matching, "stereo": stereo}
    return settings.model_copy(update=adapted)


def choose_smoothing(
    noise: float, texture_to_noise: float, faint: bool, before_px: float, s: OdometrySettings
) -> float:
    """Choose the standard deviation of the Gaussian for a pair of images, px; 0 for none.

    `before_px` is that of the frame before. After a noisy image, all are smoothed: templates of
    smoothed images match those of others less well. More than usual if the SNR is very low.
    """
    usual_px, very_low = s.features.smoothing_px, VERY_LOW_SNR
    is_noisy = noise > s.features.noise_threshold_grey
    limit = very_low.texture_to_noise * s.low_snr.texture_to_noise
    if before_px > usual_px:
        limit *= very_low.ends
    if (is_noisy or faint) and texture_to_noise < limit:
        return very_low.smoothing * usual_px
    return usual_px if is_noisy else min(before_px, usual_px)


def adapt_to_blur(settings: OdometrySettings) -> OdometrySettings:
    """Adapt settings to motion blur, which leaves coarse texture and little of it."""
    return adapt_settings(settings, low_snr=True, defocus=False, smeared=True)


def _widen(side_px: int, scale: float) -> int:
    return min(2 * int(side_px * scale / 2) + 1, MAX_SIDE_PX)
