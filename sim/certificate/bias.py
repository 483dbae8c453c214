"""Bias of disparity and flow, with its standard error, from residuals against gradients.

A label that is wrong by a shift s leaves at every pixel the residual r = x . s, where x is the
gradient of the warped image, up to noise. The gradient z of the image that is labelled serves as an
instrument: its noise is independent of that of r and x, so that s = (sum z x^T)^-1 sum z r has no
bias from noise, however strong. The standard error is that of sums over squares of the image, whose
residuals may be correlated within. A label that is wrong by more than the grain of the texture has
no gradients in common with the pixels; this is found as the lack of sum z . x, by comparison with
the gradients of neighbouring pixels.

Source: instrumental variables and sandwich covariance, Greene, Econometric Analysis, 2018, ch. 8.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from sim.imaging.resample import sample_with_gradient
from vo.contract.arrays import Array, Mask
from vo.contract.compilation import compiled

RUN_PX, PIXELS_EACH_ROW_STEP = 4, 75_000
"""Of every run of so many pixels, the one with the steepest grey is used, in every fourth row of an
image with four times so many pixels, and in more rows of smaller ones."""
NOISY_GREY, NOISY_ROWS = 2.0, 4
"""Noise of an image in grey levels, from which so many times as many rows are used."""
SHADING_PX, STEEP_MIN = 15, 1.0
"""Gradients are less their mean over so many pixels, and at least so many grey levels per pixel:
the rest may be the shading of shiny surfaces, which differs between two views."""
SMOOTHED_PX = 2
"""Radius of the Sobel operator of 5 x 5 pixels, which averages noise."""
MARGIN_PX = 7
"""Border of both images without pixels."""
BEND_MAX_PX = 0.2
"""Largest second difference of the label within two pixels: at outlines, antialiasing mixes
surfaces."""
MODEL_PX = 0.5
"""Standard deviation of the place of an edge in an image: weight of steep edges and of noise. Steep
edges, with their aliasing, decide little even where noise is strong."""
SIGMAS = 4.0
"""Largest residual in standard deviations, besides that of a shift by one pixel."""
PRIOR_PIXELS = 8
"""Weight of the whole image's noise in that of a square."""
SQUARE_PX, ALIASING_PX = 16, 0.2
"""Side of the squares of pixels that count as one observation, and standard deviation of what
aliasing shifts all edges of one: a few edges of shadows do not determine a bias."""
COMMON_SHARE = 0.6
"""Smallest fraction of its neighbours' gradients that a pixel has in common with its match."""
SINGULAR = 1e-9
FRAME_MAX_PX, DATASET_MAX_PX = 0.06, 0.03
"""Largest shift of a label in a frame, and over all frames, besides its standard error: aliasing
and interpolation leave up to half of them in good datasets."""
FRAME_ERRORS, DATASET_ERRORS = 4.5, 4.0
"""Standard errors that are added to them, and by which gradients in common must not be lacking."""
GROWTH_ERRORS = 1.5
"""Standard errors by which a shift may increase the standard error of its estimate."""


@dataclass(frozen=True)
class Shift:
    """Sums over pixels that determine the shift of a label in C directions; sums of them add up.

    Attributes:
        information: (C, C) sum of z x^T.
        product: (C,) sum of z r.
        variance: (C, C) of the product.
        lack: (C,) COMMON_SHARE of the sum of z times that of neighbours, less the sum of z x.
        lack_variance: (C,) of the lack.
    """

    information: Array
    product: Array
    variance: Array
    lack: Array
    lack_variance: Array

    def __add__(self, other: "Shift") -> "Shift":
        """Return the sums over the pixels of both."""
        return Shift(
            self.information + other.information,
            self.product + other.product,
            self.variance + other.variance,
            self.lack + other.lack,
            self.lack_variance + other.lack_variance,
        )

    def estimate(self) -> tuple[Array, Array]:
        """Return the shift (C,) in pixels, label less truth, and its standard errors (C,).

        Both are NaN without texture.
        """
        inverse = _inverse(self.information)
        covariance = inverse @ self.variance @ inverse.T
        return inverse @ self.product, np.sqrt(np.diag(covariance))

    def is_found(self, limit_px: float, errors: float, steady: bool = True) -> bool:
        """Whether the label is wrong: shifted by more than a limit, or by more than the grain.

        The latter cannot be told where blur is not steady from one image to the other.
        """
        shift, error = self.estimate()
        beyond = bool((np.abs(shift) > limit_px + errors * error).any())  # NaN is not beyond
        lacking = self.lack > errors * np.sqrt(self.lack_variance)
        return beyond or (steady and bool(lacking.any()))

    def smallest_found_px(self, limit_px: float, errors: float) -> float:
        """Smallest further shift, of either sign, that `is_found` finds; NaN if none."""
        shift, error = self.estimate()
        return float(limit_px + (np.abs(shift) + (errors + GROWTH_ERRORS) * error).max())


def _inverse(information: Array) -> Array:
    """Return the inverse (C, C), NaN without texture."""
    trace = float(np.trace(information))
    if trace <= 0 or np.linalg.det(information) <= SINGULAR * trace ** len(information):
        return np.full(information.shape, np.nan)
    return np.linalg.inv(information)


def row_step(pixels: int, sigma: float) -> int:
    """Return 1, 2, 4 or 8: every so many rows of an image with noise of sigma grey are used."""
    enough = PIXELS_EACH_ROW_STEP * (NOISY_ROWS if sigma > NOISY_GREY else 1)
    return 1 << int(np.clip(pixels // enough, 1, 8)).bit_length() - 1


def shift_of(
    image: Array, other: Array, motion: Array, visible: Mask, H: Array, channels: int, lag: int
) -> Shift:
    """Sum up how a label of motion is shifted, from as many evenly spaced rows as are `visible`.

    Args:
        image: (H, W) float32 grey of the pixels that are labelled.
        other: (H, W) float32 grey of the image that they are found in.
        motion: (H, W, C) float32, contiguous, pixels along u and, from two channels on, v; NaN
            where unknown.
        visible: (R, W) whether the other image shows the pixel, for every so many rows, as of
            `row_step`.
        H: (3, 3) homography from positions by the labels to those in the other image.
        channels: 1 or 2 directions.
        lag: Distance in pixels from which the noise of two pixels is independent.
    """
    rows, columns = (length // SQUARE_PX + 1 for length in image.shape)
    seen = np.empty((len(visible) * (image.shape[1] // RUN_PX), 2 + 3 * channels), np.float32)
    slopes = _slopes(image, channels)
    seen = seen[: _observe(image, other, slopes, motion, visible, H, SMOOTHED_PX + lag, seen)]
    noise2 = _noise_variance(seen, rows * columns)
    information = np.zeros((len(noise2), channels, channels))
    product, lack = np.zeros((2, len(noise2), channels))
    _sum_up(seen, noise2, information, product, lack)
    total = information.sum(axis=0), product.sum(axis=0)
    # The variance is that of what the shift does not explain.
    shift = np.nan_to_num(_inverse(total[0]) @ total[1]).clip(-1, 1)
    # By einsum: sums of BLAS depend on where arrays lie in memory, in their last digits.
    noise = product - np.einsum("kij,j->ki", information, shift)
    variance = np.einsum("ki,kj->ij", noise, noise)
    variance += np.diag(ALIASING_PX**2 * np.einsum("kii->ki", information**2).sum(axis=0))
    return Shift(*total, variance, lack.sum(axis=0), (lack**2).sum(axis=0))


def _slopes(image: Array, channels: int) -> Array:
    """Return slopes (C, H, W) along u and v, less their mean over SHADING_PX."""
    along, middle = np.zeros(SHADING_PX, np.float32), SHADING_PX // 2
    along[[0, -1]] = 1 / (2 * middle), -1 / (2 * middle)
    along[middle - 2 : middle + 3] += np.array([-1, -2, 0, 2, 1], np.float32) / 8
    across = np.array([1, 4, 6, 4, 1], np.float32) / 16
    slopes = np.empty((channels, *image.shape), np.float32)
    for c, kernels in zip(range(channels), ((along, across), (across, along)), strict=False):
        cv2.sepFilter2D(image, -1, *kernels, dst=slopes[c])
    return slopes


def _noise_variance(seen: Array, count: int) -> Array:
    """Return the variance of the noise in each of a number of squares, from what is seen there."""
    squares, r = seen[:, 0].astype(np.int64), seen[:, 1]
    sigma = max(1.0, 1.4826 * float(np.median(np.abs(r[::8])))) if len(r) else 1.0
    sums = np.bincount(squares, np.minimum(r * r, (SIGMAS * sigma) ** 2), count)
    number = np.bincount(squares, minlength=count) + PRIOR_PIXELS
    return np.maximum(1.0, (sums + PRIOR_PIXELS * sigma**2) / number)


@compiled(nogil=True)
def _observe(
    image: Array,
    other: Array,
    slopes: Array,
    label: Array,
    visible: Mask,
    H: Array,
    lag: int,
    seen: Array,
) -> int:
    """Write for each chosen pixel its square, residual, slopes, slopes beside and warped slopes.

    Return the number of pixels.
    """
    channels, height, width = slopes.shape
    steep, found = np.empty(width, np.float32), 0
    for row in range(len(visible)):
        v = row * -(-height // len(visible))
        if v < MARGIN_PX or v >= height - MARGIN_PX:
            continue
        for u in range(width):
            steep[u] = slopes[0, v, u] * slopes[0, v, u] if visible[row, u] else 0
        for c in range(1, channels):
            for u in range(width):
                steep[u] += slopes[c, v, u] * slopes[c, v, u] if visible[row, u] else 0
        for start in range(MARGIN_PX, width - MARGIN_PX - RUN_PX, RUN_PX):
            u = _steepest(steep, start)
            while u >= 0 and not _is_even(label, channels, v, u):
                steep[u] = 0
                u = _steepest(steep, start)
            if u < 0:
                continue
            x, y = u + label[v, u, 0], v + (label[v, u, 1] if channels > 1 else np.float32(0))
            w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
            x_w, y_w = H[0, 0] * x + H[0, 1] * y + H[0, 2], H[1, 0] * x + H[1, 1] * y + H[1, 2]
            x, y = x_w / w, y_w / w
            if not (MARGIN_PX <= x < width - MARGIN_PX and MARGIN_PX <= y < height - MARGIN_PX):
                continue
            warped = sample_with_gradient(other, x, y)
            seen[found, 0] = v // SQUARE_PX * (width // SQUARE_PX + 1) + u // SQUARE_PX
            seen[found, 1] = warped[0] - image[v, u]
            for c in range(channels):
                seen[found, 2 + 3 * c] = slopes[c, v, u]
                seen[found, 3 + 3 * c] = _slope_beside(image, v, u, c, 1 - c, lag)
                seen[found, 4 + 3 * c] = warped[1 + c]
            found += 1
    return found


@compiled(nogil=True)
def _steepest(steep: Array, start: int) -> int:
    """Return the column of the largest of a run of squared slopes, or -1 if all are small."""
    best, u = np.float32(STEEP_MIN**2), -1
    for k in range(start, start + RUN_PX):
        if steep[k] > best:
            best, u = steep[k], k
    return u


@compiled(nogil=True)
def _sum_up(seen: Array, noise2: Array, information: Array, product: Array, lack: Array) -> None:
    """Add weighted products of what is seen to the sums of each square."""
    channels = product.shape[1]
    for i in range(len(seen)):
        k, r, steep2 = int(seen[i, 0]), seen[i, 1], 0.0
        for c in range(channels):
            steep2 += seen[i, 2 + 3 * c] * seen[i, 2 + 3 * c]
        if abs(r) > SIGMAS * np.sqrt(noise2[k]) + np.sqrt(steep2):
            continue
        weight = 1 / (noise2[k] + MODEL_PX**2 * steep2)
        for c in range(channels):
            z = weight * seen[i, 2 + 3 * c]
            product[k, c] += z * r
            lack[k, c] += z * (COMMON_SHARE * seen[i, 3 + 3 * c] - seen[i, 4 + 3 * c])
            for d in range(channels):
                information[k, c, d] += z * seen[i, 4 + 3 * d]


@compiled(nogil=True)
def _slope_beside(image: Array, v: int, u: int, dv: int, du: int, lag: int) -> float:
    """Mean slope along (dv, du) of the pixels `lag` and `lag + 1` away across it."""
    total = 0.0
    for at in (lag, lag + 1):
        for k in (-at, at):
            y, x = v + k * du, u + k * dv
            total += image[y + dv, x + du] - image[y - dv, x - du]
    return total / 8


@compiled(nogil=True)
def _is_even(label: Array, channels: int, v: int, u: int) -> bool:
    """Tell whether the label has no outline within two pixels."""
    for c in range(channels):
        bend = label[v - 1, u, c] - 2 * label[v, u, c] + label[v + 1, u, c]
        if not abs(bend) <= BEND_MAX_PX:
            return False
        for k in range(u - 1, u + 2):
            bend = label[v, k - 1, c] - 2 * label[v, k, c] + label[v, k + 1, c]
            if not abs(bend) <= BEND_MAX_PX:
                return False
    return True
