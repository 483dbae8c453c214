"""Patches whose surface is no plane, such as edges of bricks, by what alignment leaves over.

Such a patch has no one disparity: alignment follows its contrast, mostly that of the nearest
surface, and elsewhere the two views differ. Of flat patches, noise leaves the same residual in grey
levels everywhere in an image, and interpolation the same share of the contrast.
"""

import numpy as np

from vo.contract.arrays import Mask
from vo.stereo.sparse import Disparities

FLAT_QUANTILE = 0.25
"""Quantile of the residuals of an image that is one of flat patches."""

MAX_RESIDUAL = 1.5
"""Largest residual of a flat patch, over that quantile."""


def has_relief(found: Disparities) -> Mask:
    """Return which (N,) of many patches of an image have relief: both residuals are large.

    False where the disparity is unknown, or was not refined.
    """
    known = ~np.isnan(found.residuals[:, 0])
    if not known.any():
        return known
    flat = np.quantile(found.residuals[known], FLAT_QUANTILE, axis=0)
    with np.errstate(invalid="ignore"):
        large = found.residuals > MAX_RESIDUAL * flat
    return large[:, 0] & large[:, 1]
