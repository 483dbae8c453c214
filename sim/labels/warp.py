"""How well a label explains the pixels: one image warped to another, and what noise would leave."""

import cv2
import numpy as np

from sim.imaging.resample import sample, sample_variance
from vo.contract.arrays import Array, Image, Mask

ROUNDING_VARIANCE = 1 / 12
"""Of a level rounded to an integer."""
GREY_WEIGHTS = np.array([0.299, 0.587, 0.114], np.float32)
"""Of red, green and blue (ITU-R BT.601), as OpenCV's."""


def residual(image: Image, other: Image, u_px: Array, v_px: Array, visible: Mask) -> Array:
    """Image minus the other image warped to it, bicubic, in grey levels.

    Args:
        image: (H, W) or (H, W, 3) RGB uint8.
        other: The right image for a disparity, the next for a flow.
        u_px: (H, W) places in `other` of the pixels of `image`: u - disparity, or u + du.
        v_px: Like `u_px`.
        visible: (H, W) pixels to compare.

    Returns:
        (N,) float32 signed residuals of the visible pixels, row by row.
    """
    warped = sample(_grey(other), *_places(u_px, v_px, visible))[0]
    return _grey(image)[visible] - warped


def expected_residual(
    image: Image,
    other: Image,
    u_px: Array,
    v_px: Array,
    visible: Mask,
    sigma_image: Array,
    sigma_other: Array,
    stretch_image: Array | float = 1.0,
    stretch_other: Array | float = 1.0,
) -> Array:
    """Standard deviation of each residual that noise and rounding of both images alone cause.

    Args:
        image: As for `residual`.
        other: As for `residual`.
        u_px: As for `residual`.
        v_px: As for `residual`.
        visible: As for `residual`.
        sigma_image: (256,) deviation of the noise in `image` at each grey level.
        sigma_other: (256,) of that in `other`.
        stretch_image: By how much noise and rounding of each pixel of `image` were multiplied
            afterwards, in its shape.
        stretch_other: Of those of `other`.

    Returns:
        (N,) float32 in grey levels; compare the root of the mean square with that of `residual`.
    """
    own = _grey_variance(image, sigma_image, stretch_image)[visible]
    places = _places(u_px, v_px, visible)
    return np.sqrt(
        own + sample_variance(_grey_variance(other, sigma_other, stretch_other), *places)[0]
    )


def _places(u_px: Array, v_px: Array, visible: Mask) -> tuple[Array, Array]:
    """(1, N) float32 each."""
    return u_px[visible][None].astype(np.float32), v_px[visible][None].astype(np.float32)


def _grey(image: Image) -> Array:
    """(H, W) float32."""
    levels: Array = image.astype(np.float32)
    return levels if levels.ndim == 2 else np.asarray(cv2.cvtColor(levels, cv2.COLOR_RGB2GRAY))


def _grey_variance(image: Image, sigma: Array, stretch: Array | float) -> Array:
    """(H, W) float32 variance of the grey of each pixel."""
    table = (np.asarray(sigma, np.float64) ** 2 + ROUNDING_VARIANCE).astype(np.float32)
    variance = cv2.LUT(image, table) * np.square(stretch, dtype=np.float32)
    return variance if image.ndim == 2 else variance @ GREY_WEIGHTS**2
