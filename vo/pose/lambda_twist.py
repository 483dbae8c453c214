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


@compiled()
def legs_lambda_twist(sides2: Array, cosines: Array, legs: Array) -> int:
    """Find the candidates for the legs, four at most, as `legs_fischler_bolles` does."""
    ab2, ac2, bc2 = sides2
    longest2 = max(ab2, ac2, bc2)
    ab2, ac2, bc2 = ab2 / longest2, ac2 / longest2, bc2 / longest2
    cos_ab, cos_ac, cos_bc = cosines
    D1, D2 = np.zeros((3, 3)), np.zeros((3, 3))
    D1[0, 0], D1[1, 1], D1[2, 2] = bc2, bc2 - ab2, -ab2  # bc2 M_ab - ab2 M_bc
    D1[0, 1] = D1[1, 0] = -bc2 * cos_ab
    D1[1, 2] = D1[2, 1] = ab2 * cos_bc
    D2[0, 0], D2[1, 1], D2[2, 2] = bc2, -ac2, bc2 - ac2  # bc2 M_ac - ac2 M_bc
    D2[0, 2] = D2[2, 0] = -bc2 * cos_ac
    D2[1, 2] = D2[2, 1] = ac2 * cos_bc

    adjugate, pair = np.empty((3, 3)), np.empty((3, 3))
    cubic = np.empty(4)  # det(D1 + g D2)
    _adjugate(D1, adjugate)
    cubic[3], cubic[2] = _inner(adjugate, D1, 1), _inner(adjugate, D2, 3)
    _adjugate(D2, adjugate)
    cubic[0], cubic[1] = _inner(adjugate, D2, 1), _inner(adjugate, D1, 3)
    # A cubic has a real root within 1 of zero, or its reverse has.
    first, other = D1, D2
    g = _simplest_root(cubic)
    if np.isnan(g):
        cubic[0], cubic[1], cubic[2], cubic[3] = cubic[3], cubic[2], cubic[1], cubic[0]
        first, other = D2, D1
        g = _simplest_root(cubic)
        if np.isnan(g):
            return 0
    for i in range(3):
        for j in range(3):
            pair[i, j] = first[i, j] + g * other[i, j]

    _adjugate(pair, adjugate)
    k = 0
    for i in range(1, 3):
        if abs(adjugate[i, i]) > abs(adjugate[k, k]):
            k = i
    if adjugate[k, k] >= 0:
        return 0  # the lines are complex
    root = np.sqrt(-adjugate[k, k])
    for i in range(3):
        j, n = (i + 1) % 3, (i + 2) % 3
        apex = adjugate[i, k] / root  # coordinate of the point where they meet
        pair[j, n] -= apex
        pair[n, j] += apex
    row, column = 0, 0
    for i in range(3):
        for j in range(3):
            if abs(pair[i, j]) > abs(pair[row, column]):
                row, column = i, j
    line, found = np.empty(3), 0
    for is_column in range(2):
        for i in range(3):
            line[i] = pair[i, column] if is_column else pair[row, i]
        found += _meet(line, other, sides2, cosines, legs[found:])
    return found


@compiled()
def _inner(A: Array, B: Array, rows: int) -> float:
    """Sum the products of the elements of the first rows of two matrices (3, 3)."""
    total = 0.0
    for i in range(rows):
        for j in range(3):
            total += A[i, j] * B[i, j]
    return total


@compiled()
def _simplest_root(cubic: Array) -> float:
    """Find the root within about 1 of zero that rounding moves least; NaN without one."""
    work, roots = np.empty(9), np.empty(3)
    best, steepest = np.nan, -1.0
    for i in range(real_roots(cubic, -1.1, 1.1, work, roots)):
        slope = abs((3 * cubic[0] * roots[i] + 2 * cubic[1]) * roots[i] + cubic[2])
        if slope > steepest:
            best, steepest = roots[i], slope
    return best


@compiled()
def _adjugate(S: Array, adjugate: Array) -> None:
    """Write the adjugate (3, 3) of a symmetric matrix."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for m in range(3):
            n, o = (m + 1) % 3, (m + 2) % 3
            adjugate[i, m] = S[j, n] * S[k, o] - S[j, o] * S[k, n]


@compiled()
def _meet(line: Array, conic: Array, sides2: Array, cosines: Array, legs: Array) -> int:
    """Write the positive legs where a line meets a conic, scaled to the sides; return how many."""
    k = 0
    for i in range(1, 3):
        if abs(line[i]) > abs(line[k]):
            k = i
    i, j = (k + 1) % 3, (k + 2) % 3
    if line[k] == 0:
        return 0
    p, q = -line[i] / line[k], -line[j] / line[k]  # L_k = p L_i + q L_j
    a = conic[i, i] + 2 * p * conic[i, k] + p * p * conic[k, k]
    b = conic[i, j] + q * conic[i, k] + p * conic[j, k] + p * q * conic[k, k]
    c = conic[j, j] + 2 * q * conic[j, k] + q * q * conic[k, k]
    square = b * b - a * c
    if square < -1e-9 * (b * b + abs(a * c)):
        return 0
    half = -b - np.copysign(np.sqrt(max(square, 0.0)), b)
    total2, ratio, found = sides2[0] + sides2[1] + sides2[2], np.empty(3), 0
    for root in range(2):  # a L_i^2 + 2 b L_i L_j + c L_j^2 = 0 has roots half / a and c / half
        ratio[i], ratio[j] = (half, a) if root == 0 else (c, half)
        ratio[k] = p * ratio[i] + q * ratio[j]
        x, y, z = ratio
        if x + y + z < 0:
            x, y, z = -x, -y, -z
        if min(x, y, z) <= 0:
            continue
        size = 2 * (x * x + y * y + z * z)
        size -= 2 * (x * y * cosines[0] + x * z * cosines[1] + y * z * cosines[2])
        if size > 0:
            scale = np.sqrt(total2 / size)
            legs[found, 0], legs[found, 1], legs[found, 2] = x * scale, y * scale, z * scale
            found += 1
    return found
