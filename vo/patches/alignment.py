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
    return _align_all(templates, image, start, warp, horizontal_only)


@compiled(fastmath={"reassoc", "contract"})  # sums in any order; NaN stays NaN
def _align_all(
    templates: Templates, image: Image, start: Array, warp: Array, horizontal_only: bool
) -> Alignment:
    patches, gradients, norms, noise_kept = templates
    n, side = len(norms), patches.shape[1]
    pixels, zncc, covariance = (
        np.full((n, 2), np.nan),
        np.full(n, np.nan),
        np.full((n, 2, 2), np.nan),
    )
    offsets = np.empty((2, side * side), dtype=np.float32)
    now = np.empty(side * side, dtype=np.float32)
    for i in range(n):
        at, there = (start[i, 0], start[i, 1]), (patches[i], gradients[i])
        u, v, score, uu, uv, vv = align_patch(
            there, norms[i], noise_kept[i], image, at, warp[i], horizontal_only, (offsets, now)
        )
        pixels[i, 0], pixels[i, 1], zncc[i] = u, v, score
        covariance[i, 0, 0], covariance[i, 1, 1] = uu, vv
        covariance[i, 0, 1] = covariance[i, 1, 0] = uv
    return Alignment(pixels, zncc, covariance)


@compiled(fastmath={"reassoc", "contract"})
def align_patch(
    template: tuple[Array, Array], norm: float, noise_kept: float, image: Image,
    start: tuple[float, float], warp: Array, horizontal_only: bool, work: tuple[Array, Array],
) -> tuple[float, float, float, float, float, float]:  # fmt: skip
    """Align a patch (S, S) with gradients (2, S, S), as `align` does, from a start (u, v).

    The work arrays (2, S * S) and (S * S,) are float32. Returns u, v, the correlation, and the
    covariance uu, uv, vv; all NaN where there is none.
    """
    none = (np.nan, np.nan, np.nan, np.nan, np.nan, np.nan)
    if not norm > MIN_NORM:
        return none
    offsets, now = work
    side = template[0].shape[0]
    radius, count = side // 2, side * side
    reach_u, reach_v = warp_offsets(warp, side, offsets)
    patch, gu, gv = template[0].ravel(), template[1][0].ravel(), template[1][1].ravel()
    a = b = d = np.float32(0)
    for k in range(count):
        a += gu[k] * gu[k]
        b += gu[k] * gv[k]
        d += gv[k] * gv[k]
    if horizontal_only:
        b, d = np.float32(0), np.float32(1)
    determinant = a * d - b * b
    if not determinant > MIN_DETERMINANT:
        return none
    u, v = start
    zncc, now_norm = 0.0, 0.0
    found = False
    for _ in range(MAX_STEPS):
        inside = u - reach_u >= 0 and u + reach_u < image.shape[1] - 1
        inside = inside and v - reach_v >= 0 and v + reach_v < image.shape[0] - 1
        if not inside:  # also where u, v or the warp is NaN
            return none
        now_norm = sample(image, u, v, offsets, now)
        if not now_norm > MIN_NORM:
            return none
        # The gradients sum to zero and are orthogonal to the patch: subtracting the mean
        # and the template from what is sampled would not change their products with it.
        p = q = c = np.float32(0)
        for k in range(count):
            p += gu[k] * now[k]
            q += gv[k] * now[k]
            c += patch[k] * now[k]
        zncc = float(c / now_norm)
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
    variance = noise_variance(zncc, norm, noise_kept, now_norm, offsets, u, v)
    # Noise of the template is in its gradients too: it adds to their energy, not to the signal.
    of_template = variance * now_norm * now_norm / (now_norm * now_norm + norm * norm)
    bias = of_template * noise_kept * count / 2
    energy = (float(a), float(b), float(d))
    return u, v, zncc, *_covariance(energy, variance, bias, warp, horizontal_only)


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


@compiled(fastmath={"reassoc", "contract"})
def warp_offsets(warp: Array, side: int, offsets: Array) -> tuple[float, float]:
    """Write the offsets (2, side * side) of the template's samples from its centre in the image.

    Return their largest sizes along u and v; NaN if the surface is seen almost edge-on.
    """
    r = side // 2
    shrink = 1 - r * (abs(warp[2, 0]) + abs(warp[2, 1]))
    if not shrink > 0.5:  # also where the warp is NaN
        return np.nan, np.nan
    for j in range(side):
        y = j - r
        for k in range(side):
            x = k - r
            scale = 1 / (1 + warp[2, 0] * x + warp[2, 1] * y)
            offsets[0, j * side + k] = scale * (warp[0, 0] * x + warp[0, 1] * y)
            offsets[1, j * side + k] = scale * (warp[1, 0] * x + warp[1, 1] * y)
    reach_u = r * (abs(warp[0, 0]) + abs(warp[0, 1])) / shrink
    reach_v = r * (abs(warp[1, 0]) + abs(warp[1, 1])) / shrink
    return reach_u, reach_v


@compiled(fastmath={"reassoc", "contract"})
def sample(image: Image, u: float, v: float, offsets: Array, out: Array) -> float:
    """Sample bilinearly at (u, v) + offsets (2, P), all inside the image.

    Write the grey levels (P,), less an arbitrary constant; return their norm about their mean.
    """
    width = image.shape[1]
    u0, v0 = int(u), int(v)
    fu, fv = np.float32(u - u0), np.float32(v - v0)
    origin = v0 * width + u0
    flat = image.ravel()
    pivot = np.float32(flat[origin])
    one = np.float32(1)
    total = squares = np.float32(0)
    for k in range(out.shape[0]):
        x, y = fu + offsets[0, k], fv + offsets[1, k]
        x_floor, y_floor = np.floor(x), np.floor(y)
        fx, fy = x - x_floor, y - y_floor
        at = origin + int(y_floor) * width + int(x_floor)
        top = flat[at] * (one - fx) + flat[at + 1] * fx
        bottom = flat[at + width] * (one - fx) + flat[at + width + 1] * fx
        value = top * (one - fy) + bottom * fy - pivot
        out[k] = value
        total += value
        squares += value * value
    return np.sqrt(max(squares - total * total / np.float32(out.shape[0]), np.float32(0)))


@compiled()
def noise_variance(
    zncc: float, norm_a: float, kept_a: float, norm_b: float, offsets: Array, u: float, v: float
) -> float:
    """Estimate the variance of the difference of two normalised patches before interpolation.

    |a - b|² = 2 - 2 zncc for unit a and b. Interpolation takes a share of the noise out of this
    residual, but not out of the slow part of the noise, which moves the match: it weighs as
    the noise of the pixels does.
    """
    kept = 0.0
    n = offsets.shape[1]
    for k in range(n):
        x, y = u + offsets[0, k], v + offsets[1, k]
        fx, fy = x - np.floor(x), y - np.floor(y)
        kept += (1 - 2 * fx * (1 - fx)) * (1 - 2 * fy * (1 - fy))
    weight_a, weight_b = 1 / (norm_a * norm_a), 1 / (norm_b * norm_b)
    share = (kept_a * weight_a + kept / n * weight_b) / (weight_a + weight_b)
    return max(2 - 2 * zncc, 0.0) / (n - PARAMETERS) / share
