"""Camera pose from three points: the perspective-three-point problem (thesis 2.6.2).

Source: Fischler and Bolles, Random Sample Consensus, CACM 1981, appendix A: the law of cosines
on the three legs of the tetrahedron gives a quartic in the ratio of two leg lengths.
"""

import numpy as np

from vo.contract.arrays import Array, Indices
from vo.orientation import absolute_orientation

SAME_LENGTH = 1e-5
"""Relative error up to which the remaining law of cosines counts as satisfied."""

LEAST_RATIO = 1e-4
"""Legs shorter than this share of another mean a camera that stands in a point."""

REAL = 1e-4
"""Largest imaginary part of a quartic root that rounding may have made complex."""


def solve_p3p(points_ref: Array, rays_cam: Array) -> tuple[Array, Indices]:
    """Find every camera pose that sees three points along three rays, for many triplets at once.

    Args:
        points_ref: (B, 3, 3): B triplets of points in a reference frame, metres.
        rays_cam: (B, 3, 3): unit rays towards them in the camera frame.

    Returns:
        (S, 4, 4) solutions T_ref_cam, at most four per triplet, and (S,) the triplet of each.
        Degenerate triplets (collinear or coincident points) have none.
    """
    legs, triplet = leg_lengths(points_ref, rays_cam)
    points_cam = legs[..., None] * rays_cam[triplet]
    return absolute_orientation(points_ref[triplet], points_cam), triplet


def leg_lengths(points_ref: Array, rays_cam: Array) -> tuple[Array, Indices]:
    """Distances of the camera centre to three points: (S, 3) metres, and (S,) their triplets."""
    A, B, C = np.moveaxis(points_ref, -2, 0)
    ab2, ac2, bc2 = (((p - q) ** 2).sum(axis=-1) for p, q in ((A, B), (A, C), (B, C)))
    ja, jb, jc = np.moveaxis(rays_cam, -2, 0)
    cos_ab, cos_ac, cos_bc = ((p * q).sum(axis=-1) for p, q in ((ja, jb), (ja, jc), (jb, jc)))
    area2 = (np.cross(B - A, C - A) ** 2).sum(axis=-1)
    longest2 = np.maximum(np.maximum(ab2, ac2), bc2)
    solvable = area2 > 1e-12 * longest2**2

    with np.errstate(divide="ignore", invalid="ignore"):
        x = _ratios(bc2 / ac2, bc2 / ab2, cos_ab, cos_ac, cos_bc, solvable)  # (B, 4) b over a
        a2 = ab2[:, None] / (1 + x**2 - 2 * x * cos_ab[:, None])
        # Two values of y = c / a from the law on AC; the law on BC says which is right.
        root = np.sqrt(cos_ac[:, None] ** 2 - 1 + ac2[:, None] / a2)
        y = cos_ac[:, None, None] + np.stack([root, -root], axis=-1)  # (B, 4, 2)
        x, a2 = np.broadcast_to(x[..., None], y.shape), np.broadcast_to(a2[..., None], y.shape)
        bc2_again = a2 * (x**2 + y**2 - 2 * x * y * cos_bc[:, None, None])
        found = np.abs(bc2_again / bc2[:, None, None] - 1) < SAME_LENGTH
        found &= (a2 > 0) & (x > LEAST_RATIO) & (y > LEAST_RATIO)
    ratios = np.stack([np.ones_like(x), x, y], axis=-1)[found]
    triplet = np.broadcast_to(np.arange(len(A))[:, None, None], found.shape)[found]
    return np.sqrt(a2[found])[:, None] * ratios, triplet


def _ratios(K1: Array, K2: Array, cab: Array, cac: Array, cbc: Array, solvable: Array) -> Array:
    """Real roots x of the quartic, NaN for the rest: (B, 4). Fischler and Bolles, eq. A8."""
    G4 = (K1 * K2 - K1 - K2) ** 2 - 4 * K1 * K2 * cbc**2
    G3 = 4 * (K1 * K2 - K1 - K2) * K2 * (1 - K1) * cab + 4 * K1 * cbc * (
        (K1 * K2 + K2 - K1) * cac + 2 * K2 * cab * cbc
    )
    G2 = (
        (2 * K2 * (1 - K1) * cab) ** 2
        + 2 * (K1 * K2 + K1 - K2) * (K1 * K2 - K1 - K2)
        + 4
        * K1
        * ((K1 - K2) * cbc**2 + (1 - K2) * K1 * cac**2 - 2 * K2 * (1 + K1) * cab * cac * cbc)
    )
    G1 = 4 * (K1 * K2 + K1 - K2) * K2 * (1 - K1) * cab + 4 * K1 * (
        (K1 * K2 - K1 + K2) * cac * cbc + 2 * K1 * K2 * cab * cac**2
    )
    G0 = (K1 * K2 + K1 - K2) ** 2 - 4 * K1**2 * K2 * cac**2
    coefficients = np.stack([G3, G2, G1, G0], axis=-1) / G4[:, None]
    solvable = solvable & np.isfinite(coefficients).all(axis=-1)
    monic = np.where(solvable[:, None], coefficients, 0.0)
    companion = np.zeros((len(monic), 4, 4))
    companion[:, 1:, :3] = np.eye(3)
    companion[:, 0] = -monic
    roots = np.linalg.eigvals(companion)
    real = solvable[:, None] & (np.abs(roots.imag) < REAL * (1 + np.abs(roots.real)))
    return _polish(np.where(real, roots.real, np.nan), monic)


def _polish(x: Array, monic: Array) -> Array:
    """Two Newton steps on each root of x^4 + c3 x^3 + c2 x^2 + c1 x + c0."""
    c3, c2, c1, c0 = (c[:, None] for c in monic.T)
    for _ in range(2):
        value = (((x + c3) * x + c2) * x + c1) * x + c0
        slope = ((4 * x + 3 * c3) * x + 2 * c2) * x + c1
        x = np.where(np.abs(slope) > 1e-12, x - value / slope, x)
    return x
