"""Normal equations as GTSAM factors (docs/decisions/0006).

GTSAM's Pose3 tangents are (w, v): so are the equations here. Covariances leave it as (v, w).
"""

from collections.abc import Callable, Sequence

import gtsam
import numpy as np

from vo.bundle_adjustment.single_camera import LIFT
from vo.contract.arrays import Array

Linearize = Callable[[Array, bool], tuple[Array, Array, float]]
"""From (S, 4, 4) poses to (6 S, 6 S) information H, (6 S,) gradient g and cost f.

H and g may be anything where the second argument, whether derivatives are needed, is false.
"""


def factor(keys: Sequence[int], linearize: Linearize) -> gtsam.CustomFactor:
    """Make a factor whose residuals e and derivatives J have J'J = H, J'e = g and e'e = 2 f."""
    keys, size = list(keys), 6 * len(keys)

    def residuals(_: object, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        here = np.array([values.atPose3(key).matrix() for key in keys])
        H, g, cost = linearize(here, jacobians is not None)
        e = np.zeros(size + 1)
        if jacobians is None:
            e[-1] = np.sqrt(2 * cost)
            return e
        L = _cholesky(H)
        e[:-1] = np.linalg.solve(L, g)
        e[-1] = np.sqrt(max(2 * cost - e @ e, 0.0))
        J = np.vstack([L.T, np.zeros(size)])
        for i in range(len(keys)):
            jacobians[i] = np.asfortranarray(J[:, 6 * i : 6 * i + 6])
        return e

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(size + 1), keys, residuals)


def _lifted(H: Array) -> Array:
    return H + np.diag(LIFT * np.diag(H) + 1e-12)


def _cholesky(H: Array) -> Array:
    try:
        return np.linalg.cholesky(_lifted(H))
    except np.linalg.LinAlgError:  # rounding made it indefinite
        values, vectors = np.linalg.eigh(_lifted(H))
        return vectors * np.sqrt(np.maximum(values, LIFT * values[-1] + 1e-12))
