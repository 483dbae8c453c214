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

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sim.imaging.resample import sample_with_gradient
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.compilation import compiled

RUN_PX, PIXELS_EACH_ROW_STEP = 8, 75_000
"""Of every run of so many pixels, the one with the steepest grey is used, in every fourth row of an
image with four times so many pixels, and in more rows of smaller ones."""
SHADING_PX, STEEP_MIN = 15, 1.0
"""Gradients are less their mean over so many pixels, and at least so many grey levels per pixel:
the rest may be the shading of shiny surfaces, which differs between two views."""
MARGIN_PX = 7
"""Border of both images without pixels."""
BEND_MAX_PX = 0.2
"""Largest second difference of the label within two pixels: at outlines, antialiasing mixes
surfaces."""
MODEL_PX = 0.2
"""Standard deviation of the place of an edge in an image: weight of steep edges and of noise."""
SIGMAS = 4.0
"""Largest residual in standard deviations, besides that of a shift by one pixel."""
SQUARE_PX, ALIASING_PX = 16, 0.2
"""Side of the squares of pixels that count as one observation, and standard deviation of what
aliasing shifts all edges of one: a few edges of shadows do not determine a bias."""
COMMON_SHARE = 0.6
"""Smallest fraction of its neighbours' gradients that a pixel has in common with its match."""
SINGULAR = 1e-9
FRAME_MAX_PX, DATASET_MAX_PX = 0.08, 0.035
"""Largest shift of a label in a frame, and over all frames, besides its standard error: aliasing
and interpolation leave up to half of them in good datasets."""
FRAME_ERRORS, DATASET_ERRORS = 4.5, 4.0
"""Standard errors that are added to them, and by which gradients in common must not be lacking."""
POWER_ERRORS = 2.0
"""Standard errors beyond the limit from which a shift is found in 98 of 100 cases."""


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
        """Smallest shift in any direction that `is_found` finds almost always; NaN if none is."""
        return float(limit_px + (errors + POWER_ERRORS) * self.estimate()[1].max())


def _inverse(information: Array) -> Array:
    """Return the inverse (C, C), NaN without texture."""
    trace = float(np.trace(information))
    if trace <= 0 or np.linalg.det(information) <= SINGULAR * trace ** len(information):
        return np.full(information.shape, np.nan)
    return np.linalg.inv(information)


def row_step(image: Array) -> int:
    """Return 1, 2 or 4: every so many rows of an image (H, W) are used."""
    return 1 << int(np.clip(image.size // PIXELS_EACH_ROW_STEP, 1, 4)).bit_length() - 1


def shift_of(
    image: Array,
    other: Array,
    motion: Array,
    visible: Mask,
    channels: int,
    view: Callable[[Array, Array], tuple[Array, Array]],
    lag: int,
) -> Shift:
    """Sum up how a label of motion is shifted, from every `row_step`-th row.

    Args:
        image: (H, W) float32 grey of the pixels that are labelled.
        other: (H, W) float32 grey of the image that they are found in.
        motion: (H, W, C) float32, contiguous, pixels along u and, from two channels on, v; NaN
            where unknown.
        visible: (R, W) whether the other image shows the pixel, for every `row_step`-th row.
        channels: 1 or 2 directions.
        view: Maps positions u, v (N,) by their labels to those in the other image.
        lag: Distance in pixels of neighbours whose gradients, of 3 x 3 pixels, have independent
            noise.
    """
    count = len(visible) * (image.shape[1] // RUN_PX + 1)
    pixels, slopes = np.empty((count, 2), np.int64), np.empty((count, 2, channels))
    found = _steepest(image, motion, visible, row_step(image), lag, pixels, slopes)
    v, u = pixels[:found].T
    moved = np.zeros((2, found), np.float32)
    moved[:channels] = motion[v, u, :channels].T
    at_u, at_v = view(u + moved[0], v + moved[1])
    height, width = other.shape
    inside = (at_u >= MARGIN_PX) & (at_u <= width - 1 - MARGIN_PX)
    inside &= (at_v >= MARGIN_PX) & (at_v <= height - 1 - MARGIN_PX)
    v, u = v[inside], u[inside]
    warped = sample_with_gradient(other, at_u[inside], at_v[inside]).astype(np.float64)
    r, x = warped[:, 0] - image[v, u], warped[:, 1 : 1 + channels]
    z, beside = slopes[:found][inside].transpose(1, 0, 2)
    steep = np.sqrt((z * z).sum(axis=1))
    sigma = max(1.0, 1.4826 * float(np.median(np.abs(r)))) if len(r) else 1.0
    weight = (np.abs(r) <= SIGMAS * sigma + steep) / (sigma**2 + (MODEL_PX * steep) ** 2)
    z_weighted = weight[:, None] * z
    # By einsum: sums of BLAS depend on where arrays lie in memory, in their last digits.
    information = np.einsum("ni,nj->ij", z_weighted, x)
    product = np.einsum("ni,n->i", z_weighted, r)
    # The variance is that of what the shift does not explain.
    shift = np.nan_to_num(_inverse(information) @ product).clip(-1, 1)
    noise = z_weighted * (r - x @ shift)[:, None]
    lack = z_weighted * (COMMON_SHARE * beside - x)
    square = v // SQUARE_PX * (image.shape[1] // SQUARE_PX + 1) + u // SQUARE_PX
    terms = np.hstack([noise, lack, ALIASING_PX * z_weighted * x]).T
    sums = np.stack([np.bincount(square, term) for term in terms])
    of_noise, (of_lack, of_aliasing) = sums[:channels], np.split((sums**2).sum(axis=1), 3)[1:]
    variance = np.einsum("ik,jk->ij", of_noise, of_noise) + np.diag(of_aliasing)
    return Shift(information, product, variance, lack.sum(axis=0), of_lack)


@compiled(nogil=True)
def _steepest(
    image: Array, label: Array, visible: Mask, step: int, lag: int, pixels: Indices, slopes: Array
) -> int:
    """Write the chosen pixels (v, u), and slopes (2, C) at and beside them; return their number."""
    height, width, channels = image.shape[0], image.shape[1], slopes.shape[2]
    found = 0
    for row in range(len(visible)):
        v = row * step
        if v < MARGIN_PX or v >= height - MARGIN_PX:
            continue
        for start in range(MARGIN_PX, width - MARGIN_PX, RUN_PX):
            best, best_u = STEEP_MIN**2, -1
            for u in range(start, min(start + RUN_PX, width - MARGIN_PX)):
                if visible[row, u]:
                    steep = _slope(image, v, u, 0, 1) ** 2
                    if channels > 1:
                        steep += _slope(image, v, u, 1, 0) ** 2
                    if steep > best and _is_even(label, channels, v, u):
                        best, best_u = steep, u
            if best_u >= 0:
                pixels[found, 0], pixels[found, 1] = v, best_u
                for c in range(channels):
                    dv, du = c, 1 - c
                    slopes[found, 0, c] = _slope(image, v, best_u, dv, du)
                    slopes[found, 1, c] = _slope_beside(image, v, best_u, dv, du, lag)
                found += 1
    return found


@compiled(nogil=True)
def _slope(image: Array, v: int, u: int, dv: int, du: int) -> float:
    """Slope along (dv, du), smoothed across it, less its mean over SHADING_PX."""
    total = 2 * (image[v + dv, u + du] - image[v - dv, u - du])
    for k in (-1, 1):
        y, x = v + k * du, u + k * dv
        total += image[y + dv, x + du] - image[y - dv, x - du]
    far, shading = SHADING_PX // 2, 0.0
    for k in (-far, 0, far):
        y, x = v + k * du, u + k * dv
        shading += image[y + far * dv, x + far * du] - image[y - far * dv, x - far * du]
    return total / 8 - shading / (6 * far)


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
