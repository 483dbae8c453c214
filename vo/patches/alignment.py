"""Sub-pixel alignment of patches by Gauss–Newton on their intensities.

One aligner serves tracking and stereo: a template is warped as its surface demands, moved by an
unknown (du, dv), and compared at zero mean and unit norm, which cancels gain and offset.

Source: Baker and Matthews, Lucas–Kanade 20 Years On, IJCV 2004 (inverse compositional form);
normalisation after Evangelidis and Psarakis, enhanced correlation coefficient, PAMI 2008.
"""

from typing import NamedTuple

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled
from vo.patches.sampling import (
    GU,
    GV,
    PATCH,
    correlate,
    is_inside,
    noise_kept,
    words,
    workspace,
    write_offsets,
)  # fmt: skip
from vo.patches.templates import Templates

MAX_STEPS = 12
"""Largest number of Gauss–Newton steps."""

CONVERGED_PX = 0.02
"""Length of the last step."""

MIN_NORM = 1.0
"""Smallest norm, grey levels, of a centred patch that is not flat."""

MIN_DETERMINANT = 1e-9
"""Smallest determinant of the normal equations of a normalised patch with texture both ways."""

MIN_SIGNAL = 0.1
"""Smallest share of the gradients' energy that counts as signal, not as noise."""

PARAMETERS = 4
"""Degrees of freedom that alignment takes from the residual: du, dv, gain and offset."""


class Alignment(NamedTuple):
    """Pixels (N, 2) of templates in an image, and the correlation (N,) there; NaN where none.

    The covariance (N, 2, 2) of the pixels is by the noise of the grey levels; the variance of v is
    zero where the search was along the row.
    """

    pixels: Array
    zncc: Array
    covariance_px2: Array


def identity_warps(count: int) -> Array:
    """Build warps (N, 3, 2) that change nothing."""
    return np.tile(np.eye(3, 2), (count, 1, 1))


def align(
    templates: Templates,
    image: Image,
    start: Array,
    warp: Array | None = None,
    horizontal_only: bool = False,
) -> Alignment:
    """Move each start position to where the image is most like the template.

    The covariance is the Cramér–Rao bound s² (JᵀJ)⁻¹, with the noise s from the residual.

    The starts (N, 2) are right to within about two pixels. By a warp (N, 3, 2), an offset o in the
    template becomes warp[:2] @ o / (1 + warp[2] @ o) in the image, which is exact for a plane: an
    affine map alone makes the error of a match grow with the square of the patch's size. With
    `horizontal_only` the search is along the row, as in a rectified pair. The positions are NaN
    where the patch leaves an image, is flat, or moves more than half its side from the start.

    Raises:
        ValueError: If the shapes disagree; the compiled loop would not notice.
    """
    n = len(templates.norms)
    warp = identity_warps(n) if warp is None else warp
    if (np.shape(start), np.shape(warp)) != ((n, 2), (n, 3, 2)):
        raise ValueError(f"{n} templates, but shapes {np.shape(start)} and {np.shape(warp)}")
    start, warp = (np.ascontiguousarray(x, dtype=np.float64) for x in (start, warp))
    size = (int(image.shape[0]), int(image.shape[1]))
    return _align_all(templates, words(image), size, start, warp, horizontal_only)


@compiled(fastmath={"reassoc", "contract"})  # sums in any order; NaN stays NaN
def _align_all(
    templates: Templates, grey: Array, size: tuple[int, int], start: Array, warp: Array,
    horizontal_only: bool,
) -> Alignment:  # fmt: skip
    patches, gradients, norms, kept = templates
    n, side = len(norms), patches.shape[1]
    pixels, zncc, covariance = (
        np.full((n, 2), np.nan),
        np.full(n, np.nan),
        np.full((n, 2, 2), np.nan),
    )
    work = workspace(side)
    for i in range(n):
        for j in range(side):
            for k in range(side):
                at = j * (side + 2) + k
                work[PATCH, at] = patches[i, j, k]
                work[GU, at], work[GV, at] = gradients[i, 0, j, k], gradients[i, 1, j, k]
        template, at = (norms[i], kept[i], side), (start[i, 0], start[i, 1])
        u, v, score, uu, uv, vv = align_patch(
            template, grey, size, at, warp[i], horizontal_only, work
        )
        pixels[i, 0], pixels[i, 1], zncc[i] = u, v, score
        covariance[i, 0, 0], covariance[i, 1, 1] = uu, vv
        covariance[i, 0, 1] = covariance[i, 1, 0] = uv
    return Alignment(pixels, zncc, covariance)


@compiled(fastmath={"reassoc", "contract"})
def align_patch(
    template: tuple[float, float, int], grey: Array, size: tuple[int, int],
    start: tuple[float, float], warp: Array, horizontal_only: bool, work: Array,
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """Align the patch in a workspace, as `align` does, from a start (u, v).

    Of the template, its norm, share of noise kept, and side are given; of the image, its grey
    levels as words, height and width. Returns u, v, the correlation, and the covariance uu, uv, vv;
    all NaN where there is none.
    """
    none = (np.nan, np.nan, np.nan, np.nan, np.nan, np.nan)
    norm, kept, side = template
    if not norm > MIN_NORM:
        return none
    radius, width = side // 2, size[1]
    reach_u, reach_v = write_offsets(warp, side, work)
    a, b, d = _energies(work)
    if horizontal_only:
        b, d = 0.0, 1.0
    determinant = a * d - b * b
    if not determinant > MIN_DETERMINANT:
        return none
    u, v = start
    zncc, now_norm = 0.0, 0.0
    found = False
    for _ in range(MAX_STEPS):
        if not is_inside(u, v, (reach_u, reach_v), size):
            return none
        # The gradients sum to zero and are orthogonal to the patch: subtracting the mean
        # and the template from what is sampled would not change their products with it.
        now_norm, c, p, q = correlate(grey, width, u, v, side, work)
        if not now_norm > MIN_NORM:
            return none
        zncc = c / now_norm
        p, q = p / now_norm, (0.0 if horizontal_only else q / now_norm)
        du, dv = (d * p - b * q) / determinant, (a * q - b * p) / determinant
        step_u = -(warp[0, 0] * du + warp[0, 1] * dv)
        step_v = -(warp[1, 0] * du + warp[1, 1] * dv)
        u += step_u
        v += step_v
        if abs(u - start[0]) > radius or abs(v - start[1]) > radius:
            return none
        found = True
        if step_u * step_u + step_v * step_v < CONVERGED_PX * CONVERGED_PX:
            break
    if not found:
        return none
    shares = kept, noise_kept(u, v, side, work)
    variance = noise_variance(zncc, (norm, now_norm), shares, side * side)
    # Noise of the template is in its gradients too: it adds to their energy, not to the signal.
    of_template = variance * now_norm * now_norm / (now_norm * now_norm + norm * norm)
    bias = of_template * kept * side * side / 2
    return u, v, zncc, *_covariance((a, b, d), variance, bias, warp, horizontal_only)


@compiled(fastmath={"reassoc", "contract"})
def _energies(work: Array) -> tuple[float, float, float]:
    """Sum the products of the template's derivatives: uu, uv, vv."""
    uu = uv = vv = np.float32(0)
    for k in range(np.uint64(work.shape[1])):
        gu, gv = work[GU, k], work[GV, k]
        uu += gu * gu
        uv += gu * gv
        vv += gv * gv
    return float(uu), float(uv), float(vv)


@compiled(fastmath={"reassoc", "contract"})
def _covariance(
    energy: tuple[float, float, float], variance: float, bias: float, warp: Array,
    horizontal_only: bool,
) -> tuple[float, float, float]:  # fmt: skip
    """Covariance uu, uv, vv in the image, by the template's gradient energies uu, uv, vv."""
    a, b, d = energy
    if horizontal_only:
        signal = max(a - bias, MIN_SIGNAL * a)
        uu, uv, vv = variance * a / (signal * signal), 0.0, 0.0
    else:
        least = (a + d) / 2 - np.sqrt((a - d) ** 2 / 4 + b * b)
        bias = min(bias, (1 - MIN_SIGNAL) * least)
        determinant = (a - bias) * (d - bias) - b * b
        uu, uv, vv = (d - bias) / determinant, -b / determinant, (a - bias) / determinant
        uu, uv, vv = (
            variance * (uu + bias * (uu * uu + uv * uv)),
            variance * (uv + bias * uv * (uu + vv)),
            variance * (vv + bias * (vv * vv + uv * uv)),
        )
    w00, w01, w10, w11 = warp[0, 0], warp[0, 1], warp[1, 0], warp[1, 1]
    return (
        w00 * (uu * w00 + uv * w01) + w01 * (uv * w00 + vv * w01),
        w00 * (uu * w10 + uv * w11) + w01 * (uv * w10 + vv * w11),
        w10 * (uu * w10 + uv * w11) + w11 * (uv * w10 + vv * w11),
    )


@compiled()
def noise_variance(
    zncc: float, norms: tuple[float, float], kept: tuple[float, float], count: int
) -> float:
    """Estimate the variance of the difference of two normalised patches before interpolation.

    |a - b|² = 2 - 2 zncc for unit a and b of so many samples. Interpolation takes a share of the
    noise out of this residual, and keeps the rest, but not out of the slow part of the noise, which
    moves the match: it weighs as the noise of the pixels does.
    """
    weight_a, weight_b = 1 / (norms[0] * norms[0]), 1 / (norms[1] * norms[1])
    share = (kept[0] * weight_a + kept[1] * weight_b) / (weight_a + weight_b)
    return max(2 - 2 * zncc, 0.0) / (count - PARAMETERS) / share
