"""Disparity at features: searched, refined to sub-pixels along the surface's slant, and tested.

A window across the edge of something nearer has no one disparity. Two smaller windows, shifted to
either side, then disagree, which tells edges from surfaces and adds to the uncertainty.

Source: shifted windows after Fusiello, Roberto and Trucco, Efficient Stereo with Multiple
Windowing, CVPR 1997.
"""

from dataclasses import dataclass

import numpy as np

from vo.config import StereoSettings
from vo.contract.arrays import Array, Mask
from vo.contract.sequence import StereoFrame
from vo.patches.alignment import Alignment, align, identity_warps
from vo.patches.templates import Templates, extract_templates
from vo.stereo.dense import sample_nearest
from vo.stereo.epipolar_search import search_epipolar
from vo.stereo.plane_fit import fit_plane_slopes
from vo.stereo.slant import fit_patch_slopes

FARTHEST_PX = -2.0
"""Smallest disparity of the search, beyond infinity: far points are not taken for nearer ones."""

MAX_CORRECTION_PX = 2.0
"""Largest change of a disparity by alignment; beyond it, alignment has found another surface."""

SLANT_PATCH_PX = 13
"""Side of the patch that gives the slant of a feature without neighbours: slopes need a lever."""

DISAGREEMENT_SIGMAS = 3.0
"""Disagreement of the shifted windows, in standard deviations that it adds."""

UNREFINED_SIGMA_PX = 0.3
"""Standard deviation of a dense disparity that is not refined."""


@dataclass(frozen=True)
class Disparities:
    """Disparities (N,), u_left - u_right, of pixels of the left image; NaN where unknown.

    Attributes:
        sigma_px: (N,) standard deviation, by the noise of the grey levels and by the disagreement
            of neighbouring windows; NaN where unknown.
        slopes: (N, 2) slant of the surface: change of disparity per pixel along u and v; zero, a
            surface that faces the camera, where it is unknown.
    """

    values_px: Array
    sigma_px: Array
    slopes: Array

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
) -> Disparities:
    """Find the disparity at pixels (N, 2); NaN where unknown, unlike, ambiguous or beyond the gate.

    A dense map, possibly of a smaller image, is used unless the method is sparse, which searches
    about the expected disparities (N,), or over the whole range where they are NaN or not given.
    The slant (N, 2) of the surface comes, if it is not known already, from planes through the
    disparities of neighbours, to which the (K, 3) u, v and disparity of features nearby belong.
    """
    pixels = np.asarray(pixels, dtype=np.float64)
    start, distinct = _search(frame, dense, pixels, settings, expected_px)
    if not settings.refine:
        known = distinct & (start > settings.min_disparity_px)
        values_px = np.where(known, start, np.nan)
        sigma_px = np.where(known, UNREFINED_SIGMA_PX, np.nan)
        return Disparities(values_px, sigma_px, _plane_slopes(pixels, values_px, nearby))

    templates = extract_templates(frame.left, pixels, settings.align_px)
    slant = slopes
    if slant is None:
        facing = _align(frame, templates, pixels, start, np.zeros((len(pixels), 2)))
        first_px, _ = _accept(facing, pixels, start, distinct, settings)
        slant = _complete_slopes(frame, pixels, start, _plane_slopes(pixels, first_px, nearby))
    aligned = _align(frame, templates, pixels, start, slant)
    values_px, sigma_px = _accept(aligned, pixels, start, distinct, settings)
    disagreement_px = _measure_disagreement(frame, pixels, values_px, slant, settings)
    known = disagreement_px < settings.max_disagreement_px
    known &= values_px > settings.min_disparity_px
    values_px = np.where(known, values_px, np.nan)
    sigma_px = np.where(known, np.hypot(sigma_px, disagreement_px / DISAGREEMENT_SIGMAS), np.nan)
    if slopes is None:
        planes = _plane_slopes(pixels, values_px, nearby)
        slopes = np.where(planes.any(axis=1, keepdims=True), planes, slant)
    return Disparities(values_px, sigma_px, slopes)


def _search(
    frame: StereoFrame, dense: Array, pixels: Array, settings: StereoSettings,
    expected_px: Array | None,
) -> tuple[Array, Mask]:  # fmt: skip
    """Find disparities (N,) to within about a pixel, and where no other is nearly as likely."""
    if settings.method != "sparse":
        start = sample_nearest(dense, pixels, frame.left.shape)
        return start, ~np.isnan(start)
    limits = settings.max_disparity_px, FARTHEST_PX
    nearest, farthest = (np.full(len(pixels), limit) for limit in limits)
    if expected_px is not None:
        radius, known = settings.expected_search_radius_px, ~np.isnan(expected_px)
        nearest[known] = expected_px[known] + radius
        farthest[known] = np.maximum(expected_px[known] - radius, FARTHEST_PX)
    start, zncc, second = search_epipolar(
        frame.left, frame.right, pixels, nearest, farthest, settings.patch_px
    )
    return start, 1 - second > settings.min_distinctness * (1 - zncc)


def _plane_slopes(pixels: Array, disparity_px: Array, nearby: Array | None) -> Array:
    """Fit slopes (N, 2) to the disparities at pixels and nearby; zero without a plane."""
    known = np.column_stack([pixels, disparity_px])
    if nearby is not None:
        known = np.concatenate([known, nearby])
    return fit_plane_slopes(pixels, disparity_px, known[:, :2], known[:, 2])


def _complete_slopes(frame: StereoFrame, pixels: Array, start: Array, planes: Array) -> Array:
    """Complete slopes (N, 2) of planes, where there are none, by those of the patches, or zero."""
    lone = ~planes.any(axis=1) & ~np.isnan(start)
    right = np.stack([pixels[:, 0] - start, pixels[:, 1]], axis=-1)[lone]
    templates = extract_templates(frame.left, pixels[lone], SLANT_PATCH_PX)
    slopes = planes.copy()
    slopes[lone] = np.nan_to_num(fit_patch_slopes(templates, frame.right, right))
    return slopes


def _align(
    frame: StereoFrame, templates: Templates, pixels: Array, start: Array, slopes: Array
) -> Alignment:
    """Align templates of the left image with the right one from disparities (N,)."""
    right = np.stack([pixels[:, 0] - start, pixels[:, 1]], axis=-1)
    warp = identity_warps(len(slopes))
    warp[:, 0] -= slopes  # u_right = u_left - d(u_left, v)
    return align(templates, frame.right, right, warp, horizontal_only=True)


def _accept(
    aligned: Alignment, pixels: Array, start: Array, distinct: Mask, settings: StereoSettings
) -> tuple[Array, Array]:
    """Compute disparities and standard deviations by noise, (N,) each; NaN where refused."""
    values_px = pixels[:, 0] - aligned.pixels[:, 0]
    sigma_px = np.sqrt(aligned.covariance_px2[:, 0, 0])
    good = distinct & (aligned.zncc > settings.min_align_zncc) & (sigma_px < settings.max_sigma_px)
    good &= np.abs(values_px - start) < MAX_CORRECTION_PX
    return np.where(good, values_px, np.nan), np.where(good, sigma_px, np.nan)


def _measure_disagreement(
    frame: StereoFrame, pixels: Array, disparity_px: Array, slopes: Array, settings: StereoSettings
) -> Array:
    """Measure the largest difference to the disparity of two smaller, shifted windows: (N,) px."""
    largest = np.zeros(len(pixels))
    for side in (-1, 1):
        shift = np.array([side * (settings.align_px // 3), 0])
        expected = disparity_px + slopes @ shift
        templates = extract_templates(frame.left, pixels + shift, settings.align_px - 2)
        aligned = _align(frame, templates, pixels + shift, expected, slopes)
        found = pixels[:, 0] + shift[0] - aligned.pixels[:, 0]
        largest = np.maximum(largest, np.abs(found - expected))  # NaN stays
    return largest
