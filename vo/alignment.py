"""Sub-pixel alignment of patches by Gauss–Newton on their intensities.

One aligner serves time and stereo: a template patch is warped as its surface demands, moved by
an unknown (du, dv), and compared after both sides were given zero mean and unit norm, which
cancels gain and offset.

Source: Baker and Matthews, Lucas–Kanade 20 Years On, IJCV 2004 (inverse compositional form);
normalisation after Evangelidis and Psarakis, enhanced correlation coefficient, PAMI 2008.
"""

import numba
import numpy as np

from vo.contract.arrays import Array, Image

MOST_STEPS = 12
CONVERGED_PX = 0.005
FLAT = 1e-6


def align(
    template: Image,
    pixels: Array,
    image: Image,
    start: Array,
    warp: Array,
    patch_px: int,
    horizontal_only: bool = False,
) -> tuple[Array, Array]:
    """Move each start position to where the image looks most like the template.

    Args:
        template: (H, W) uint8.
        pixels: (N, 2) patch centres in the template, sub-pixel.
        image: (H', W') uint8.
        start: (N, 2) first guess in the image, within about two pixels.
        warp: (N, 3, 2): an offset o in the template becomes warp[:2] @ o / (1 + warp[2] @ o) in
            the image, which is exact for a plane. An affine map alone makes the error of a match
            grow with the square of the patch's size.
        patch_px: Side of the template patch, odd.
        horizontal_only: Search along the row, as in a rectified pair.

    Returns:
        (N, 2) aligned pixels and (N,) their ZNCC; both NaN where the patch left an image, was
        flat, or moved more than half its side from the start.

    Raises:
        ValueError: If the shapes disagree; the compiled loop would not notice.
    """
    n = len(pixels)
    if (np.shape(pixels), np.shape(start), np.shape(warp)) != ((n, 2), (n, 2), (n, 3, 2)):
        raise ValueError(f"shapes {np.shape(pixels)}, {np.shape(start)} and {np.shape(warp)}")
    aligned = np.full((len(pixels), 2), np.nan)
    zncc = np.full(len(pixels), np.nan)
    _align_all(
        template, np.asarray(pixels, dtype=np.float64), image, np.asarray(start, dtype=np.float64),
        np.asarray(warp, dtype=np.float64), patch_px // 2, horizontal_only, aligned, zncc,
    )  # fmt: skip
    return aligned, zncc


@numba.njit(cache=True)
def _align_all(
    template: Image,
    pixels: Array,
    image: Image,
    start: Array,
    warp: Array,
    radius: int,
    horizontal_only: bool,
    aligned: Array,
    zncc: Array,
) -> None:
    side = 2 * radius + 1
    unwarped = np.eye(3, 2)
    padded = np.empty((side + 2, side + 2))
    patch = np.empty((side, side))
    now = np.empty((side, side))
    gu = np.empty((side, side))
    gv = np.empty((side, side))
    for i in range(len(pixels)):
        if not _sample(template, pixels[i, 0], pixels[i, 1], unwarped, padded):
            continue
        _gradients(padded, patch, gu, gv)
        if not _normalise(patch, gu, gv):
            continue
        a, b, d = (gu * gu).sum(), (gu * gv).sum(), (gv * gv).sum()
        if horizontal_only:
            b, d = 0.0, 1.0
        determinant = a * d - b * b
        if determinant < FLAT * FLAT:
            continue
        u, v = start[i]
        for _ in range(MOST_STEPS):
            if not _sample(image, u, v, warp[i], now) or not _normalise_only(now):
                u = np.nan
                break
            e = now - patch
            p, q = (gu * e).sum(), (gv * e).sum()
            if horizontal_only:
                q = 0.0
            du, dv = (d * p - b * q) / determinant, (a * q - b * p) / determinant
            step_u = -(warp[i, 0, 0] * du + warp[i, 0, 1] * dv)
            step_v = -(warp[i, 1, 0] * du + warp[i, 1, 1] * dv)
            u += step_u
            v += step_v
            if abs(u - start[i, 0]) > radius or abs(v - start[i, 1]) > radius:
                u = np.nan
                break
            if step_u * step_u + step_v * step_v < CONVERGED_PX * CONVERGED_PX:
                break
        if np.isnan(u) or not _sample(image, u, v, warp[i], now) or not _normalise_only(now):
            continue
        aligned[i, 0], aligned[i, 1] = u, v
        zncc[i] = (now * patch).sum()


@numba.njit(cache=True)
def _sample(image: Image, u: float, v: float, warp: Array, out: Array) -> bool:
    """Sample a warped unit grid about (u, v), bilinearly; False if it leaves the image."""
    side = out.shape[0]
    r = (side - 1) / 2
    height, width = image.shape
    shrink = 1 - r * (abs(warp[2, 0]) + abs(warp[2, 1]))
    if not shrink > 0.5:  # the surface is seen almost edge-on; also where the warp is NaN
        return False
    reach_u = r * (abs(warp[0, 0]) + abs(warp[0, 1])) / shrink
    reach_v = r * (abs(warp[1, 0]) + abs(warp[1, 1])) / shrink
    inside = u - reach_u >= 0 and u + reach_u < width - 1
    inside = inside and v - reach_v >= 0 and v + reach_v < height - 1
    if not inside:  # also where u or v is NaN
        return False
    for j in range(side):
        for k in range(side):
            scale = 1 / (1 + warp[2, 0] * (k - r) + warp[2, 1] * (j - r))
            x = u + scale * (warp[0, 0] * (k - r) + warp[0, 1] * (j - r))
            y = v + scale * (warp[1, 0] * (k - r) + warp[1, 1] * (j - r))
            x0, y0 = int(x), int(y)
            fx, fy = x - x0, y - y0
            top = image[y0, x0] * (1 - fx) + image[y0, x0 + 1] * fx
            bottom = image[y0 + 1, x0] * (1 - fx) + image[y0 + 1, x0 + 1] * fx
            out[j, k] = top * (1 - fy) + bottom * fy
    return True


@numba.njit(cache=True)
def _gradients(padded: Array, patch: Array, gu: Array, gv: Array) -> None:
    """Cut the margin of one sample off, with central differences, grey levels per pixel."""
    side = patch.shape[0]
    for j in range(side):
        for k in range(side):
            patch[j, k] = padded[j + 1, k + 1]
            gu[j, k] = (padded[j + 1, k + 2] - padded[j + 1, k]) / 2
            gv[j, k] = (padded[j + 2, k + 1] - padded[j, k + 1]) / 2


@numba.njit(cache=True)
def _normalise(patch: Array, gu: Array, gv: Array) -> bool:
    """Bring the patch to zero mean and unit norm, and its gradients along; False if flat.

    The derivative of the normalised patch is the gradient without its parts along the constant
    and along the patch itself.
    """
    mean = patch.mean()
    patch -= mean
    norm = np.sqrt((patch * patch).sum())
    if norm < FLAT:
        return False
    patch /= norm
    for g in (gu, gv):
        g -= g.mean()
        g /= norm
        g -= (g * patch).sum() * patch
    return True


@numba.njit(cache=True)
def _normalise_only(patch: Array) -> bool:
    patch -= patch.mean()
    norm = np.sqrt((patch * patch).sum())
    if norm < FLAT:
        return False
    patch /= norm
    return True
