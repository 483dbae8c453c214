"""Real roots of a polynomial inside an interval, also those that nearly coincide.

Between two neighbouring roots of its derivative a polynomial is monotone, so that it has at most
one root there, which bisection cannot miss. The derivatives' roots are found in the same way,
from the lowest degree upwards.
"""

from vo.contract.arrays import Array
from vo.contract.compilation import compiled

MAX_STEPS = 100
"""Largest number of steps to one root."""

TOUCHING = 1e-9
"""Largest value of an extremum that is a double root, relative to the terms that cancel there."""


@compiled()
def real_roots(coefficients: Array, low: float, high: float, work: Array, roots: Array) -> int:
    """Write the roots (D,) inside [low, high] in increasing order; return their number.

    The coefficients (D + 1,) have the highest power first; (2 D + 3,) is working memory. A double
    root is written at least once.
    """
    degree = len(coefficients) - 1
    polynomial, edges = work[: degree + 1], work[degree + 1 :]
    found = 0
    for d in range(1, degree + 1):
        for k in range(d + 1):  # the derivative of degree d
            factor = coefficients[k]
            for power in range(d - k + 1, degree - k + 1):
                factor *= power
            polynomial[k] = factor
        p = polynomial[: d + 1]
        edges[0], edges[found + 1] = low, high
        for i in range(found):
            edges[i + 1] = roots[i]
        pieces, found = found + 1, 0
        at_high, crossed_before = _value(p, low), True
        for i in range(pieces):
            at_low, at_high = at_high, _value(p, edges[i + 1])
            crosses = (at_low < 0) != (at_high < 0)
            alone = d == degree and not crosses and not crossed_before
            if alone and abs(at_low) <= TOUCHING * _terms(p, edges[i]):
                roots[found] = edges[i]
                found += 1
            if crosses:
                roots[found] = _bracketed(p, edges[i], edges[i + 1], at_low < 0)
                found += 1
            crossed_before = crosses
    return found


@compiled()
def _bracketed(p: Array, low: float, high: float, rises: bool) -> float:
    """Find the root in a bracket by Newton's method, bisecting where a step leaves the bracket."""
    x = 0.5 * (low + high)
    for _ in range(MAX_STEPS):
        value, slope = 0.0, 0.0
        for c in p:
            slope = slope * x + value
            value = value * x + c
        if (value < 0) == rises:
            low = x
        else:
            high = x
        following = x - value / slope if slope != 0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - x) <= 4e-16 * abs(x):
            return following
        x = following
    return x


@compiled()
def _value(p: Array, x: float) -> float:
    value = 0.0
    for c in p:
        value = value * x + c
    return value


@compiled()
def _terms(p: Array, x: float) -> float:
    """Sum the absolute values of the terms."""
    total = 0.0
    for c in p:
        total = total * abs(x) + abs(c)
    return total
