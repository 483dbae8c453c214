"""Structure and motion by the reduced camera system (docs/decisions/0006).

The measurements of each block of points become one factor on its cameras, from which
`vo.bundle_adjustment.schur` has eliminated the points: GTSAM then solves for the cameras alone, and
Python is entered once an iteration and factor instead of once a measurement.
"""

from collections.abc import Sequence

import numpy as np

from vo.bundle_adjustment.point_estimates import PointEstimates
from vo.bundle_adjustment.problem import Bundle
from vo.bundle_adjustment.solver import CostTerm, optimize
from vo.config import RefinementSettings
from vo.contract.arrays import Array, Mask


def optimize_reduced(
    bundle: Bundle, estimates: Sequence[PointEstimates], settings: RefinementSettings
) -> tuple[Array, int]:
    """Minimise the cost of a bundle with Huber weights that are renewed after the first step.

    Args:
        bundle: Initial cameras.
        estimates: Of all of its blocks; left at the solution.
        settings: Loss and iterations.

    Returns:
        (K, 4, 4) cameras and the number of Levenberg-Marquardt steps.
    """
    T, moving = bundle.T_world_cam.copy(), ~bundle.fixed
    terms = [_term(x, T, moving) for x in estimates if moving[x.block.cameras].any()]
    iterations, most = 0, settings.max_iterations
    for steps_left in (1, most - 1)[:most]:
        for x in estimates:
            x.reweight(T[x.block.cameras], settings.huber)
        T[moving], steps = optimize(T[moving], terms, steps_left)
        iterations += steps
    return T, iterations


def _term(estimates: PointEstimates, T: Array, moving: Mask) -> CostTerm:
    """Make the cost of a block by its moving cameras; the others stay as they are."""
    cameras = estimates.block.cameras
    here, own = T[cameras].copy(), moving[cameras]
    rows = (np.cumsum(moving) - 1)[cameras[own]]

    def linearize(poses: Array, derivatives: bool) -> tuple[Array, Array, float]:
        here[own] = poses
        return estimates.linearize(here, own, derivatives)

    return CostTerm(rows, linearize)
