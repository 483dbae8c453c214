"""Highlights: pixels that look different from each side by more than the noise."""

from collections.abc import Sequence

from sim.certificate.photometric import BINS_PER_GREY, MEDIAN_OF_NORMAL, Residual

DEVIATIONS = 4.0
"""Difference, in standard deviations of noise and rounding, above which a pixel counts."""


def beyond_noise_fraction(residuals: Sequence[Residual]) -> float:
    """Return the share of pixels whose residual exceeds the noise by DEVIATIONS.

    Outlines, and texture that the interpolation of a warp loses, are among them.
    """
    factor = DEVIATIONS / MEDIAN_OF_NORMAL * BINS_PER_GREY
    beyond = sum(int(r.histogram[round(factor * r.noise_median) + 1 :].sum()) for r in residuals)
    return round(beyond / max(sum(int(r.histogram.sum()) for r in residuals), 1), 5)
