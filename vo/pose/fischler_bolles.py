"""Three legs of a tetrahedron from a quartic in the ratio of two of them (thesis 2.6.2).

Source: Fischler and Bolles, Random Sample Consensus, CACM 1981, appendix A, eqs. A5 to A14.
"""

import numpy as np

from vo.contract.arrays import Array
from vo.contract.compilation import compiled
from vo.pose.polynomial import real_roots

MIN_RATIO = 1e-4
"""Smallest ratio of two legs: a camera whose legs differ by more stands in a point."""

SAME_LENGTH = 1e-2
"""Largest relative error of a root in the remaining law of cosines, before its refinement."""

ROUNDING = 1e-6
"""Squared ratios down to minus this are double roots of y that rounding makes complex."""


@compiled()
def legs_fischler_bolles(sides2: Array, cosines: Array, legs: Array) -> int:
    """Write candidates (8, 3) for the legs a, b, c, which the caller refines; return their number.

    The squared sides (3,) are AB, AC, BC; the cosines (3,) are of the angles between these legs.
    """
    ab2, ac2, bc2 = sides2
    cos_ab, cos_ac, cos_bc = cosines
    quartic = np.empty(5)
    _coefficients(bc2 / ac2, bc2 / ab2, cos_ab, cos_ac, cos_bc, quartic)
    work, x = np.empty(11), np.empty(4)
    found = 0
    for i in range(real_roots(quartic, MIN_RATIO, 1 / MIN_RATIO, work, x)):  # b = x a
        a2 = ab2 / (1 + x[i] ** 2 - 2 * x[i] * cos_ab)
        square = cos_ac**2 - 1 + ac2 / a2
        if square < -ROUNDING:
            continue
        root = np.sqrt(max(square, 0.0))
        # Two values of y = c / a from the law on AC; the law on BC says which is right.
        for y in (cos_ac + root, cos_ac - root):
            bc2_again = a2 * (x[i] ** 2 + y**2 - 2 * x[i] * y * cos_bc)
            if y > MIN_RATIO and abs(bc2_again / bc2 - 1) < SAME_LENGTH:
                a = np.sqrt(a2)
                legs[found, 0], legs[found, 1], legs[found, 2] = a, x[i] * a, y * a
                found += 1
    return found


@compiled()
def _coefficients(K1: float, K2: float, cab: float, cac: float, cbc: float, quartic: Array) -> None:
    """Write the coefficients G4 to G0 of eq. A8."""
    difference, mixed = K1 * K2 - K1 - K2, K1 * K2 + K1 - K2
    quartic[0] = difference**2 - 4 * K1 * K2 * cbc**2
    quartic[1] = 4 * difference * K2 * (1 - K1) * cab + 4 * K1 * cbc * (
        (K1 * K2 + K2 - K1) * cac + 2 * K2 * cab * cbc
    )
    quartic[2] = (
        (2 * K2 * (1 - K1) * cab) ** 2
        + 2 * mixed * difference
        + 4
        * K1
        * ((K1 - K2) * cbc**2 + (1 - K2) * K1 * cac**2 - 2 * K2 * (1 + K1) * cab * cac * cbc)
    )
    quartic[3] = 4 * mixed * K2 * (1 - K1) * cab + 4 * K1 * (
        (K1 * K2 - K1 + K2) * cac * cbc + 2 * K1 * K2 * cab * cac**2
    )
    quartic[4] = mixed**2 - 4 * K1**2 * K2 * cac**2
