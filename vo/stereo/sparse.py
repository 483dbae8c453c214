"""Disparity at features: searched, refined to sub-pixels along the surface's slant, and tested.

A window across the edge of something nearer has no one disparity. Two smaller windows, shifted to
either side, then disagree, which tells edges from surfaces and adds to the uncertainty.

Source: shifted windows after Fusiello, Roberto and Trucco, Efficient Stereo with Multiple
Windowing, CVPR 1997.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vo.config import StereoSettings
from vo.contract.arrays import Array, Mask
from vo.contract.compilation import compiled
from vo.contract.sequence import StereoFrame
from vo.patches.alignment import align_patch
from vo.patches.sampling import words, workspace
from vo.patches.templates import extract_patch, extract_templates, square_workspace
from vo.stereo.dense import sample_nearest
from vo.stereo.epipolar_search import search_epipolar
from vo.stereo.plane_fit import fit_plane_slopes
from vo.stereo.right_camera import right_camera_of
from vo.stereo.slant import fit_patch_slopes

FARTHEST_PX = -2.0
"""Smallest disparity of the search, beyond infinity: far points are not taken for nearer ones."""

TYPICAL_PX = 10.0
"""Disparity for the row in the right image where none is expected."""

MAX_CORRECTION_PX = 2.0
"""Largest change of a disparity by alignment; beyond it, alignment has found another surface."""

SLANT_PATCH_PX = 13
"""Side of the patch that gives the slant of a feature without neighbours: slopes need a lever."""

DISAGREEMENT_SIGMAS = 3.0
"""Disagreement of the shifted windows, in standard deviations that it adds."""

UNREFINED_SIGMA_PX = 0.3
"""Standard deviation of a dense disparity that is not refined."""


class Limits(NamedTuple):
    """Smallest correlation, largest standard deviation and disagreement, smallest disparity."""

    min_zncc: float
    max_sigma_px: float
    max_disagreement_px: float
    min_disparity_px: float


@dataclass(frozen=True)
class Disparities:
    """Disparities (N,), u_left - u_right, of pixels of the left image; NaN where unknown.

    Attributes:
        sigma_px: (N,) standard deviation, by the noise of the grey levels and by the disagreement
            of neighbouring windows; NaN where unknown.
        slopes: (N, 2) slant of the surface: change of disparity per pixel along u and v; zero, a
            surface that faces the camera, where it is unknown.
        residuals: (N, 2) root mean square difference of the aligned patches, in grey levels of the
            left one and as a share of its contrast; NaN where unknown.
    """

    values_px: Array
    sigma_px: Array
    slopes: Array
    residuals: Array

    @property
    def known(self) -> Mask:
        """(N,) where there is a disparity."""
        return ~np.isnan(self.values_px)


def measure_disparities(
    frame: StereoFrame,
    dense: Array,
    pixels: Array,
    settings: StereoSettings,
    expected_px: Array | None = None,
    slopes: Array | None = None,
    nearby: Array | None = None,
    is_exact: bool = False,
) -> Disparities:
    """Find the disparity at pixels (N, 2); NaN where unknown, unlike, ambiguous or beyond the gate.

    A dense map, possibly of a smaller image, is used unless the method is sparse, which searches
    about the expected disparities (N,), or over the whole range where they are NaN or not given. If
    these are exact, to about a pixel, there is no search.
    The slant (N, 2) of the surface comes, if it is not known already, from planes through the
    disparities of neighbours, to which the (K, 3) u, v and disparity of features nearby belong.

    All disparities are those of a rectified pair, also of a frame that is misaligned.
    """
    pixels = np.asarray(pixels, dtype=np.float64)
    if expected_px is not None and (right := right_camera_of(frame)):
        expected_px = pixels[:, 0] - right.see(pixels, expected_px)[:, 0]
    if is_exact and expected_px is not None and settings.refine and settings.method == "sparse":
        start, distinct = expected_px, np.isfinite(expected_px)
    else:
        start, distinct = _search(frame, dense, pixels, settings, expected_px)
    if not settings.refine:
        start = _rectified(frame, pixels, start)
        known = distinct & (start > settings.min_disparity_px)
        values_px = np.where(known, start, np.nan)
        sigma_px = np.where(known, UNREFINED_SIGMA_PX, np.nan)
        slopes, none = _plane_slopes(pixels, values_px, nearby), np.full((len(pixels), 2), np.nan)
        return Disparities(values_px, sigma_px, slopes, none)

    start = np.where(distinct, start, np.nan)
    if expected_px is not None:  # to a fraction of a pixel, where the search has confirmed it
        with np.errstate(invalid="ignore"):
            start = np.where(np.abs(start - expected_px) < 1, expected_px, start)
    slant = slopes
    if slant is None:
        facing = np.zeros((len(pixels), 2))
        first_px, _, _ = _refine(frame, pixels, start, facing, settings, shifted_windows=False)
        slant = _complete_slopes(frame, pixels, start, _plane_slopes(pixels, first_px, nearby))
    values_px, sigma_px, residuals = _refine(
        frame, pixels, start, slant, settings, shifted_windows=True
    )
    if slopes is None:
        planes = _plane_slopes(pixels, values_px, nearby)
        slopes = np.where(planes.any(axis=1, keepdims=True), planes, slant)
    return Disparities(values_px, sigma_px, slopes, residuals)


def _search(
    frame: StereoFrame, dense: Array, pixels: Array, settings: StereoSettings,
    expected_px: Array | None,
) -> tuple[Array, Mask]:  # fmt: skip
    """Find distances of columns (N,) to about a pixel, and where no other is nearly as likely."""
    if settings.method != "sparse":
        start = sample_nearest(dense, pixels, frame.left.shape)
        return start, ~np.isnan(start)
    limits = settings.max_disparity_px, FARTHEST_PX
    nearest, farthest = (np.full(len(pixels), limit) for limit in limits)
    typical_px = np.full(len(pixels), TYPICAL_PX)
    if expected_px is not None:
        radius, known = settings.expected_search_radius_px, ~np.isnan(expected_px)
        nearest[known] = expected_px[known] + radius
        farthest[known] = np.maximum(expected_px[known] - radius, FARTHEST_PX)
        typical_px[known] = expected_px[known]
    rows = _right_rows(frame, pixels, typical_px)
    start, zncc, second = search_epipolar(
        frame.left, frame.right, pixels, nearest, farthest, settings.patch_px, rows
    )
    return start, 1 - second > settings.min_distinctness * (1 - zncc)


def _plane_slopes(pixels: Array, disparity_px: Array, nearby: Array | None) -> Array:
    """Fit slopes (N, 2) to the disparities at pixels and nearby; zero without a plane."""
    known = np.column_stack([pixels, disparity_px])
    if nearby is not None:
        known = np.concatenate([known, nearby])
    return fit_plane_slopes(pixels, disparity_px, known[:, :2], known[:, 2])


def _rectified(frame: StereoFrame, pixels: Array, apart_px: Array) -> Array:
    """Turn distances of columns (N,) into disparities of a rectified pair."""
    right = right_camera_of(frame)
    return apart_px if right is None else right.disparity(pixels, pixels[:, 0] - apart_px)


def _right_rows(frame: StereoFrame, pixels: Array, apart_px: Array) -> Array:
    """Rows (N,) in the right image, by the distances of columns (N,)."""
    right = right_camera_of(frame)
    if right is None:
        return pixels[:, 1]
    return right.see(pixels, _rectified(frame, pixels, apart_px))[:, 1]


def _complete_slopes(frame: StereoFrame, pixels: Array, start: Array, planes: Array) -> Array:
    """Complete slopes (N, 2) of planes, where there are none, by those of the patches, or zero."""
    lone = ~planes.any(axis=1) & ~np.isnan(start)
    right = np.stack([pixels[:, 0] - start, _right_rows(frame, pixels, start)], axis=-1)[lone]
    templates = extract_templates(frame.left, pixels[lone], SLANT_PATCH_PX)
    slopes = planes.copy()
    slopes[lone] = np.nan_to_num(fit_patch_slopes(templates, frame.right, right))
    return slopes


def _refine(
    frame: StereoFrame, pixels: Array, start: Array, slopes: Array, settings: StereoSettings,
    shifted_windows: bool,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Align patches, columns (N,) apart: as the first two and the last of `Disparities`, or NaN.

    Without the shifted windows, nothing tests whether the patches lie on one surface.
    """
    misaligned = right_camera_of(frame) is not None
    limits = Limits(
        settings.min_align_zncc, settings.max_sigma_px, settings.max_disagreement_px,
        -np.inf if misaligned else settings.min_disparity_px,
    )  # fmt: skip
    places = np.column_stack([pixels, _right_rows(frame, pixels, start)])
    start, slopes = (np.ascontiguousarray(x, dtype=np.float64) for x in (start, slopes))
    size, side = (int(frame.left.shape[0]), int(frame.left.shape[1])), settings.align_px
    pair = words(frame.left), words(frame.right)
    values_px, sigma_px, residuals = _refine_all(
        pair, size, places, start, slopes, side, limits, shifted_windows
    )
    if misaligned:
        values_px = _rectified(frame, pixels, values_px)
        values_px[~(values_px > settings.min_disparity_px)] = np.nan
        sigma_px[np.isnan(values_px)] = np.nan
    return values_px, sigma_px, residuals


@compiled(fastmath={"reassoc", "contract"})  # sums in any order; NaN stays NaN
def _refine_all(
    pair: tuple[Array, Array], size: tuple[int, int], places: Array, start: Array, slopes: Array,
    side: int, limits: Limits, shifted_windows: bool,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Align the patches about u, v of the left image, in rows v of the right: places (N, 3)."""
    n, small = len(places), side - 2
    values, sigmas, residuals = np.full(n, np.nan), np.full(n, np.nan), np.full((n, 2), np.nan)
    whole = workspace(side), square_workspace(side, size[1])
    part = workspace(small), square_workspace(small, size[1])
    warp = np.eye(3, 2)
    for i in range(n):
        if not np.isfinite(start[i]):
            continue
        at = places[i, 0], places[i, 1], places[i, 2]
        warp[0, 0], warp[0, 1] = 1 - slopes[i, 0], -slopes[i, 1]  # u_right = u_left - d(u_left, v)
        value, zncc, variance, norm = _align_pixel(pair, size, at, start[i], warp, whole)
        sigma = np.sqrt(variance)
        good = zncc > limits.min_zncc and sigma < limits.max_sigma_px
        if not (good and abs(value - start[i]) < MAX_CORRECTION_PX):
            continue
        if shifted_windows:
            largest = 0.0
            for shift in (-(side // 3), side // 3):
                expected = value + slopes[i, 0] * shift
                beside = at[0] + shift, at[1], at[2]
                found, _, _, _ = _align_pixel(pair, size, beside, expected, warp, part)
                largest = max(largest, abs(found - expected)) if found == found else np.inf
            if not (largest < limits.max_disagreement_px and value > limits.min_disparity_px):
                continue
            sigma = np.hypot(sigma, largest / DISAGREEMENT_SIGMAS)
        values[i], sigmas[i] = value, sigma
        residuals[i, 1] = np.sqrt(max(2 - 2 * zncc, 0.0))  # of unit vectors
        residuals[i, 0] = residuals[i, 1] * norm / side
    return values, sigmas, residuals


@compiled(fastmath={"reassoc", "contract"})
def _align_pixel(
    pair: tuple[Array, Array], size: tuple[int, int], place: tuple[float, float, float],
    disparity: float, warp: Array, arrays: tuple[Array, tuple[Array, Array, int]],
) -> tuple[float, float, float, float]:  # fmt: skip
    """Disparity of the patch about u, v, its correlation and variance, NaN if none; its norm."""
    u, v, row = place
    work, square = arrays
    norm, kept = extract_patch(pair[0], size, u, v, square, work)
    template, start = (norm, kept, square[2]), (u - disparity, row)
    found, _, zncc, variance, _, _ = align_patch(template, pair[1], size, start, warp, True, work)
    return u - found, zncc, variance, norm
