"""Bicubic sampling at sub-pixel positions, and the variance of sampled noise.

OpenCV's cubic (a = -3/4) is faster, but shifts even a linear ramp by up to 0.05 pixels.
"""

import numpy as np

from vo.contract.arrays import Array
from vo.contract.compilation import compiled

TAPS_PX = 2
"""Pixels on each side of a position that its sample depends on."""


def sample(image: Array, u_px: Array, v_px: Array) -> Array:
    """Sample an (H, W[, C]) float32 image between its pixels, with its border continued.

    Positions u_px, v_px (M, N) and samples are float32; pixel centres are on integers, NaN is kept.

    Source: Keys, Cubic convolution interpolation for digital image processing, 1981, a = -1/2.
    """
    return _sampled(image, u_px, v_px, False)


def sample_variance(variance: Array, u_px: Array, v_px: Array) -> Array:
    """Return the variance of `sample` for independent noise of variance (H, W[, C]) in each pixel.

    The squared weights sum to 1 on a pixel and to 0.41 in the middle of four; shapes as `sample`.
    """
    return _sampled(variance, u_px, v_px, True)


def _sampled(image: Array, u_px: Array, v_px: Array, squared: bool) -> Array:
    channels = np.ascontiguousarray(image.reshape(*image.shape[:2], -1), dtype=np.float32)
    out = np.empty((*u_px.shape, channels.shape[2]), np.float32)
    _sample(channels, u_px, v_px, squared, out)
    return out.reshape(*u_px.shape, *image.shape[2:])


@compiled(nogil=True)
def _weights(t: np.float32, squared: bool) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Weights of the pixels at -1, 0, 1, 2 for a position t in [0, 1)."""
    half = np.float32(0.5)
    two, three, four, five = np.float32(2), np.float32(3), np.float32(4), np.float32(5)
    a = half * t * (t * (two - t) - np.float32(1))
    b = half * (t * t * (three * t - five) + two)
    c = half * t * (t * (four - three * t) + np.float32(1))
    d = half * t * t * (t - np.float32(1))
    return (a * a, b * b, c * c, d * d) if squared else (a, b, c, d)


@compiled(nogil=True)
def _sample(image: Array, u_px: Array, v_px: Array, squared: bool, out: Array) -> None:
    height, width, channels = image.shape
    for i in range(u_px.shape[0]):
        for j in range(u_px.shape[1]):
            u, v = u_px[i, j], v_px[i, j]
            if not (abs(u) < 1e6 and abs(v) < 1e6):
                out[i, j] = np.nan
                continue
            u0, v0 = int(np.floor(u)), int(np.floor(v))
            wu = _weights(np.float32(u - u0), squared)
            wv = _weights(np.float32(v - v0), squared)
            inside = u0 >= 1 and u0 < width - 2 and v0 >= 1 and v0 < height - 2
            for c in range(channels):
                total = np.float32(0)
                for m in range(4):
                    y = v0 + m - 1
                    x = u0 - 1
                    if inside:
                        row = (
                            wu[0] * image[y, x, c]
                            + wu[1] * image[y, x + 1, c]
                            + wu[2] * image[y, x + 2, c]
                            + wu[3] * image[y, x + 3, c]
                        )
                    else:
                        y = min(max(y, 0), height - 1)
                        row = np.float32(0)
                        for n in range(4):
                            row += wu[n] * image[y, min(max(x + n, 0), width - 1), c]
                    total += wv[m] * row
                out[i, j, c] = total


@compiled(nogil=True)
def _slopes(t: np.float32) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Derivatives of the `_weights` by t."""
    half, one, two, three = np.float32(0.5), np.float32(1), np.float32(2), np.float32(3)
    four, eight, nine, ten = np.float32(4), np.float32(8), np.float32(9), np.float32(10)
    a = half * (t * (four - three * t) - one)
    b = half * t * (nine * t - ten)
    c = half * (t * (eight - nine * t) + one)
    d = half * t * (three * t - two)
    return a, b, c, d


@compiled(nogil=True)
def sample_with_gradient(image: Array, u_px: float, v_px: float) -> tuple[float, float, float]:
    """Return sample, and its derivatives along u and v, of an (H, W) float32 image at a position.

    At least TAPS_PX within the outermost pixel centres; the kernel is that of `sample`.
    """
    u0, v0 = int(u_px), int(v_px)
    tu, tv = np.float32(u_px - u0), np.float32(v_px - v0)
    wu, wv, su, sv = _weights(tu, False), _weights(tv, False), _slopes(tu), _slopes(tv)
    value, along_u, along_v = np.float32(0), np.float32(0), np.float32(0)
    for m in range(4):
        row, slope = np.float32(0), np.float32(0)
        for n in range(4):
            pixel = image[v0 + m - 1, u0 + n - 1]
            row += wu[n] * pixel
            slope += su[n] * pixel
        value += wv[m] * row
        along_u += wv[m] * slope
        along_v += sv[m] * row
    return float(value), float(along_u), float(along_v)
