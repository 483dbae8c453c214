"""Three legs of a tetrahedron as the points where two conics meet, from one root of a cubic.

The laws of cosines say L^T M L = s for three matrices M, with L the legs and s a squared side.
Cross-multiplied by the sides, two conics L^T D1 L = L^T D2 L = 0 remain, and a combination of
them that is singular is a pair of lines. Each line meets D2 in up to two points.

Source: Persson and Nordberg, Lambda Twist, ECCV 2018; the pair is split through its adjugate
(Richter-Gebert, Perspectives on Projective Geometry, 2011, 11.1; for this problem Ding et al.,
Revisiting the P3P Problem, CVPR 2023), where Persson and Nordberg diagonalise.
"""

import numpy as np

from vo.contract.arrays import Array
from vo.contract.compilation import compiled
from vo.pose.polynomial import real_roots


@compiled(error_model="numpy")
def legs_lambda_twist(sides2: Array, cosines: Array, legs: Array) -> int:
    """Find the candidates for the legs, four at most, as `legs_fischler_bolles` does."""
    ab2, ac2, bc2 = sides2 / sides2.max()
    cos_ab, cos_ac, cos_bc = cosines
    D1, D2 = np.zeros((3, 3)), np.zeros((3, 3))
    D1[0, 0], D1[1, 1], D1[2, 2] = bc2, bc2 - ab2, -ab2  # bc2 M_ab - ab2 M_bc
    D1[0, 1] = D1[1, 0] = -bc2 * cos_ab
    D1[1, 2] = D1[2, 1] = ab2 * cos_bc
    D2[0, 0], D2[1, 1], D2[2, 2] = bc2, -ac2, bc2 - ac2  # bc2 M_ac - ac2 M_bc
    D2[0, 2] = D2[2, 0] = -bc2 * cos_ac
    D2[1, 2] = D2[2, 1] = ac2 * cos_bc

    adjugate = np.empty((3, 3))
    cubic = np.empty(4)  # det(D1 + g D2)
    _adjugate(D1, adjugate)
    cubic[3], cubic[2] = (adjugate[0] * D1[0]).sum(), (adjugate * D2).sum()
    _adjugate(D2, adjugate)
    cubic[0], cubic[1] = (adjugate[0] * D2[0]).sum(), (adjugate * D1).sum()
    # A cubic has a real root within 1 of zero, or its reverse has.
    other = D2
    g = _simplest_root(cubic)
    if np.isnan(g):
        g, other = _simplest_root(cubic[::-1].copy()), D1
        if np.isnan(g):
            return 0
        pair = D2 + g * D1
    else:
        pair = D1 + g * D2

    _adjugate(pair, adjugate)
    k = 0
    for i in range(1, 3):
        if abs(adjugate[i, i]) > abs(adjugate[k, k]):
            k = i
    if adjugate[k, k] >= 0:
        return 0  # the lines are complex
    apex = adjugate[:, k] / np.sqrt(-adjugate[k, k])  # where they meet
    pair[0, 1] -= apex[2]
    pair[1, 0] += apex[2]
    pair[0, 2] += apex[1]
    pair[2, 0] -= apex[1]
    pair[1, 2] -= apex[0]
    pair[2, 1] += apex[0]
    largest = np.abs(pair).argmax()
    found = _meet(pair[largest // 3], other, sides2, cosines, legs, 0)
    return _meet(pair[:, largest % 3].copy(), other, sides2, cosines, legs, found)


@compiled(error_model="numpy")
def _simplest_root(cubic: Array) -> float:
    """Find the root within about 1 of zero that rounding moves least; NaN without one."""
    work, roots = np.empty(9), np.empty(3)
    best, steepest = np.nan, -1.0
    for i in range(real_roots(cubic, -1.1, 1.1, work, roots)):
        slope = abs((3 * cubic[0] * roots[i] + 2 * cubic[1]) * roots[i] + cubic[2])
        if slope > steepest:
            best, steepest = roots[i], slope
    return best


@compiled(error_model="numpy")
def _adjugate(S: Array, adjugate: Array) -> None:
    """Write the adjugate (3, 3) of a symmetric matrix."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for m in range(3):
            n, o = (m + 1) % 3, (m + 2) % 3
            adjugate[i, m] = S[j, n] * S[k, o] - S[j, o] * S[k, n]


@compiled(error_model="numpy")
def _meet(line: Array, conic: Array, sides2: Array, cosines: Array, legs: Array, found: int) -> int:
    """Append the positive legs where a line meets a conic, scaled to the sides' lengths."""
    k = np.abs(line).argmax()
    i, j = (k + 1) % 3, (k + 2) % 3
    if line[k] == 0:
        return found
    p, q = -line[i] / line[k], -line[j] / line[k]  # L_k = p L_i + q L_j
    a = conic[i, i] + 2 * p * conic[i, k] + p * p * conic[k, k]
    b = conic[i, j] + q * conic[i, k] + p * conic[j, k] + p * q * conic[k, k]
    c = conic[j, j] + 2 * q * conic[j, k] + q * q * conic[k, k]
    square = b * b - a * c
    if square < -1e-9 * (b * b + abs(a * c)):
        return found
    half = -b - np.copysign(np.sqrt(max(square, 0.0)), b)
    ratio = np.empty(3)
    for root in range(2):  # a L_i^2 + 2 b L_i L_j + c L_j^2 = 0 has roots half / a and c / half
        ratio[i], ratio[j] = (half, a) if root == 0 else (c, half)
        ratio[k] = p * ratio[i] + q * ratio[j]
        if ratio.sum() < 0:
            ratio = -ratio
        if ratio.min() <= 0:
            continue
        size = 2 * (ratio * ratio).sum()
        size -= 2 * (
            ratio[0] * ratio[1] * cosines[0]
            + ratio[0] * ratio[2] * cosines[1]
            + ratio[1] * ratio[2] * cosines[2]
        )
        if size > 0:
            scale = np.sqrt(sides2.sum() / size)
            for n in range(3):
                legs[found, n] = ratio[n] * scale
            found += 1
    return found
