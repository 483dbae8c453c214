"""Observations of landmarks in one frame."""

from dataclasses import dataclass, field

import numpy as np

from vo.contract.arrays import Array, Indices, Mask, Table


@dataclass(frozen=True)
class Observations(Table):
    """Landmarks seen in one frame, row by row.

    Attributes:
        ids: (N,) landmark identifiers, unique over the whole run.
        pixels: (N, 2) left-image (u, v), px.
        disparity_px: (N,) u_left - u_right; NaN where unknown.
        inlier: (N,) whether the landmark agrees with the frame's motion; by default, all do.
        sigma_px: (N, 3) standard deviations of u, v and disparity; by default NaN, unknown.
        shift_px: (N, 3) what carries u, v and disparity from the time of their row to the frame's;
            by default zero, as with a global shutter.

    Example:
        >>> seen = dy.Observations(np.array([7]), np.array([[31.5, 23.5]]), np.array([4.0]))
        >>> seen.measured.tolist(), seen.inlier.tolist()
        ([[31.5, 23.5, 4.0]], [True])
    """

    ids: Indices
    pixels: Array
    disparity_px: Array
    inlier: Mask = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))
    sigma_px: Array = field(default_factory=lambda: np.zeros((0, 3)))
    shift_px: Array = field(default_factory=lambda: np.zeros((0, 3)))

    def __post_init__(self) -> None:
        n = len(self.ids)
        if len(self.inlier) < n:
            object.__setattr__(self, "inlier", np.ones(n, dtype=np.bool_))
        if len(self.sigma_px) < n:
            object.__setattr__(self, "sigma_px", np.full((n, 3), np.nan))
        if len(self.shift_px) < n:
            object.__setattr__(self, "shift_px", np.zeros((n, 3)))

    @property
    def measured(self) -> Array:
        """(N, 3) left-image u, v and disparity, px."""
        measured = np.empty((len(self.ids), 3))
        measured[:, :2], measured[:, 2] = self.pixels, self.disparity_px
        return measured

    @property
    def at_instant(self) -> Array:
        """(N, 3) the same at the instant of the frame, px."""
        return self.measured + self.shift_px
