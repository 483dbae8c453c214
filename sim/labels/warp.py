"""Photometric residuals: one image warped to another by a label, and the residuals of noise."""

from dataclasses import dataclass

import cv2
import numpy as np

from sim.imaging.resample import sample, sample_variance
from vo.contract.arrays import Array, Image, Mask

ROUNDING_VARIANCE = 1 / 12
"""Variance of a level rounded to an integer."""
GREY_WEIGHTS = np.array([0.299, 0.587, 0.114], np.float32)
"""Weights of red, green and blue (ITU-R BT.601), as in OpenCV."""


@dataclass(frozen=True)
class NoisyImage:
    """An image with the noise model of its grey levels.

    Attributes:
        image: (H, W) or (H, W, 3) RGB uint8, as delivered.
        sigma: (256,) standard deviation of the noise at each grey level.
        gain: Factor by which each pixel's noise and rounding were multiplied afterwards, in the
            image's shape.
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

    Args:
        image: (H, W) or (H, W, 3) RGB.
        other: The right image for a disparity, the next for a flow.
        u_px: (H, W) positions in `other` of the pixels of `image`: u - disparity, or u + du.
        v_px: Like `u_px`.
        visible: (H, W) pixels to compare.

    Returns:
        (N,) float32 signed residuals of the visible pixels, row by row.
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
    levels: Array = image.astype(np.float32)
    return levels if levels.ndim == 2 else np.asarray(cv2.cvtColor(levels, cv2.COLOR_RGB2GRAY))
