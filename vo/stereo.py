"""Disparity: dense by OpenCV, made sub-pixel at the features (thesis 2.5, 3.1)."""

import cv2
import numba
import numpy as np

from vo.alignment import align
from vo.config import StereoSettings
from vo.contract.arrays import Array, Image, Indices
from vo.contract.sequence import StereoFrame
from vo.templates import cut

FIXED_POINT = 16.0
"""OpenCV's matchers return sixteenths of a pixel."""

MOST_CORRECTION_PX = 2.0
"""Alignment that moves a dense disparity further has found something else."""

PLANE_RADIUS = 4
"""Half side of the square of dense disparities to which a plane is fitted."""

PLANE_SHARE = 0.6
"""Share of that square that must be known."""

PLANE_RMS_PX = 0.7
"""Misfit above which the surface is not plane."""


class DenseStereo:
    """A dense matcher, on images reduced by `settings.shrink`."""

    def __init__(self, settings: StereoSettings) -> None:
        """Size the search so that it covers `settings.most_disparity_px`."""
        self._shrink = settings.shrink
        self.disparities = 16 * int(np.ceil(settings.most_disparity_px / self._shrink / 16))
        if settings.method == "block_matching":
            self._matcher = cv2.StereoBM.create(self.disparities, 15)
            self._matcher.setUniquenessRatio(8)
            self._matcher.setTextureThreshold(5)
        else:
            self._matcher = cv2.StereoSGBM.create(
                minDisparity=0, numDisparities=self.disparities, blockSize=5, P1=8 * 25,
                P2=32 * 25, disp12MaxDiff=1, uniquenessRatio=8,
                mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
            )  # fmt: skip

    def __call__(self, left: Image, right: Image) -> Array:
        """Return the disparity u_left - u_right at each left pixel.

        Args:
            left: (H, W) uint8.
            right: (H, W) uint8.

        Returns:
            (H / shrink, W / shrink) float32 in pixels of the full image; NaN where unknown.
        """
        if self._shrink > 1:
            size = (left.shape[1] // self._shrink, left.shape[0] // self._shrink)
            left, right = (
                np.asarray(cv2.resize(x, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
                for x in (left, right)
            )
        if left.shape[1] <= self.disparities:
            return np.full(left.shape, np.nan, dtype=np.float32)
        raw = self._matcher.compute(left, right)
        return np.where(raw > 0, raw * np.float32(self._shrink / FIXED_POINT), np.nan)


def disparity_at(
    frame: StereoFrame, dense: Array, pixels: Array, settings: StereoSettings
) -> Array:  # fmt: skip
    """Read the dense disparity at features and refine it by aligning their patches.

    Args:
        frame: The pair.
        dense: Disparity map, possibly of a smaller image; NaN where unknown.
        pixels: (N, 2) left-image (u, v).
        settings: The depth gate and the least correlation.

    Returns:
        (N,) u_left - u_right; NaN where unknown, unlike, or beyond the depth gate.
    """
    disparity = _lookup(dense, pixels, frame.left.shape)
    start = np.stack([pixels[:, 0] - disparity, pixels[:, 1]], axis=-1)
    warp = _left_to_right(disparity_slopes(dense, pixels, frame.left.shape))
    templates = cut(frame.left, pixels, settings.align_px)
    aligned = align(templates, frame.right, start, warp, horizontal_only=True)
    refined = pixels[:, 0] - aligned.pixels[:, 0]
    with np.errstate(invalid="ignore"):
        good = (
            (aligned.zncc > settings.align_zncc)
            & (np.abs(refined - disparity) < MOST_CORRECTION_PX)
            & (refined > settings.least_disparity_px)
        )
    return np.where(good, refined, np.nan)


def disparity_slopes(dense: Array, pixels: Array, shape: tuple[int, ...]) -> Array:
    """Slant of the surface at each pixel: (N, 2) change of disparity per pixel along u and v.

    A plane is fitted to the dense disparity nearby; zero, a surface that faces the camera, where
    there is too little of it or it is not plane.
    """
    scale = np.array([dense.shape[1] / shape[1], dense.shape[0] / shape[0]])
    centres = np.nan_to_num((pixels + 0.5) * scale, nan=-1.0).astype(np.int64)
    slopes = np.zeros((len(pixels), 2))
    _fit_planes(dense, centres, slopes)
    return slopes * scale


@numba.njit(cache=True)
def _fit_planes(dense: Array, centres: Indices, slopes: Array) -> None:
    """Least squares of d = c + a x + b y over a square; writes (a, b)."""
    height, width = dense.shape
    r = PLANE_RADIUS
    for i in range(len(centres)):
        u, v = centres[i]
        if u < r or v < r or u >= width - r or v >= height - r:
            continue
        n = sx = sy = sxx = sxy = syy = sd = sxd = syd = sdd = 0.0
        for y in range(-r, r + 1):
            for x in range(-r, r + 1):
                d = dense[v + y, u + x]
                if np.isnan(d):
                    continue
                n += 1.0
                sx, sy, sd = sx + x, sy + y, sd + d
                sxx, sxy, syy = sxx + x * x, sxy + x * y, syy + y * y
                sxd, syd, sdd = sxd + x * d, syd + y * d, sdd + d * d
        if n < PLANE_SHARE * (2 * r + 1) ** 2:
            continue
        sxx, sxy, syy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
        sxd, syd, sdd = sxd - sx * sd / n, syd - sy * sd / n, sdd - sd * sd / n
        determinant = sxx * syy - sxy * sxy
        if determinant <= 0.0:
            continue
        a = (syy * sxd - sxy * syd) / determinant
        b = (sxx * syd - sxy * sxd) / determinant
        if (sdd - a * sxd - b * syd) / n < PLANE_RMS_PX**2:
            slopes[i, 0], slopes[i, 1] = a, b


def _left_to_right(slopes: Array) -> Array:
    """Warps (N, 3, 2) of left offsets to right ones: u_right = u_left - d(u_left, v)."""
    warp = np.tile(np.eye(3, 2), (len(slopes), 1, 1))
    warp[:, 0] -= slopes
    return warp


def _lookup(dense: Array, pixels: Array, shape: tuple[int, ...]) -> Array:
    """Nearest value of a map that covers the image of `shape`, NaN outside."""
    rows = np.floor((pixels[:, 1] + 0.5) * dense.shape[0] / shape[0])
    columns = np.floor((pixels[:, 0] + 0.5) * dense.shape[1] / shape[1])
    with np.errstate(invalid="ignore"):
        inside = (rows >= 0) & (rows < dense.shape[0])
        inside &= (columns >= 0) & (columns < dense.shape[1])
    values = np.full(len(pixels), np.nan)
    values[inside] = dense[rows[inside].astype(int), columns[inside].astype(int)]
    return values
