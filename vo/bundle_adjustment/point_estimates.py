"""Points of a bundle as a function of the cameras, and the Huber weights of their measurements."""

import numpy as np

from vo.bundle_adjustment.problem import Bundle, as_cameras, sorted_measurements
from vo.bundle_adjustment.robust_covariance import score_products
from vo.bundle_adjustment.schur import (
    eliminate_points,
    point_information,
    residuals,
    robust_weights,
)
from vo.contract.arrays import Array, Indices, Mask


class PointEstimates:
    """Where the points of a bundle are, which follow the cameras wherever these are put.

    This is the state of an optimisation. `linearize` starts the points where its last call, be it
    for cameras that the optimiser then rejected, left them: a warm start.

    Attributes:
        cameras: (C,) those of the bundle that see any point; below, cameras are these.
        data: The measurements, sorted by point.
        points: (J, 3) metres, as `linearize` found them last.
        weight: (M, 3) one over sigma, less for outliers; as `reweight` found them last.
    """

    def __init__(self, bundle: Bundle, use_disparity: bool = True) -> None:
        self.cameras, self.data = sorted_measurements(bundle, use_disparity)
        self.points, self.weight = bundle.points_world.astype(np.float64), self.data.weight

    def linearize(self, T: Array, moving: Mask, derivatives: bool) -> tuple[Array, Array, float]:
        """Solve for the points and eliminate them, given the cameras (C, 4, 4).

        As `vo.bundle_adjustment.solver.Linearize`, for the cameras that a mask (C,) says move.
        """
        slot = unknowns(moving) if derivatives else np.full(len(T), -1)
        size = int(moving.sum()) if derivatives else 0
        data = self.data._replace(weight=self.weight)
        H, g, cost, self.points = eliminate_points(as_cameras(T), self.points, data, slot, size)
        return H, g, cost

    def score_products(self, T: Array, moving: Mask) -> Array:
        """Sum the outer products of the scores of the points."""
        data = self.data._replace(weight=self.weight)
        size = int(moving.sum())
        return score_products(as_cameras(T), self.points, data, unknowns(moving), size)

    def reweight(self, T: Array, huber: float) -> None:
        """Take the Huber weights of the residuals at cameras (C, 4, 4)."""
        self.weight = robust_weights(as_cameras(T), self.points, self.data, huber)

    def residuals(self, T: Array) -> Array:
        """Residuals (M, 3) in sigmas, zero where nothing was measured."""
        return residuals(as_cameras(T), self.points, self.data)

    def information(self, T: Array) -> Array:
        """Information (J, 3, 3) of each point, 1/m², given the cameras."""
        data = self.data._replace(weight=self.weight)
        return point_information(as_cameras(T), self.points, data)


def unknowns(moving: Mask) -> Indices:
    """Place (C,) of each moving camera among the unknowns; -1 for one that is fixed."""
    return np.where(moving, np.cumsum(moving) - 1, -1)
