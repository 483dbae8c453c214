"""Distance of every pixel of a stereo pair, estimated, for what depends on distance.

Source: Hirschmüller, Stereo Processing by Semiglobal Matching and Mutual Information, PAMI 2008.
"""

import numpy as np

from vo.config import StereoSettings
from vo.contract.arrays import Array, Image
from vo.contract.rig import StereoRig
from vo.stereo.dense import DenseStereo

MAX_SHARE = 5
"""The largest disparity is the width over this."""


def estimate_ranges(rig: StereoRig, left: Image, right: Image) -> tuple[Array, Array]:
    """Estimate the distance along the ray of every pixel of both images, (H, W) float32, m.

    Pixels without a match have the farther distance of the nearest ones with a match in their row,
    as occlusions have; rows without any are NaN, without end as the sky.
    """
    largest = max(rig.width_px / MAX_SHARE, 16.0)
    settings = StereoSettings(method="semi_global", downscale=1, max_disparity_px=largest)
    match = DenseStereo(settings)
    mirrored = match(*(np.ascontiguousarray(x[:, ::-1]) for x in (right, left)))[:, ::-1]
    return _range(rig, match(left, right)), _range(rig, mirrored)


def _range(rig: StereoRig, disparity_px: Array) -> Array:
    filled = _filled(disparity_px)
    v, u = np.mgrid[: filled.shape[0], : filled.shape[1]]
    ray = np.hypot(np.hypot(u - rig.cx_px, v - rig.cy_px) / rig.f_px, 1)
    with np.errstate(invalid="ignore"):
        return (rig.f_px * rig.baseline_m * ray / filled).astype(np.float32)


def _filled(values: Array) -> Array:
    """Replace NaN in rows (H, W) by the smaller of the nearest values before and after it."""
    known = np.isfinite(values)
    column = np.arange(values.shape[1])
    before = np.maximum.accumulate(np.where(known, column, 0), axis=1)
    after = np.minimum.accumulate(np.where(known, column, len(column) - 1)[:, ::-1], axis=1)
    pair = (np.take_along_axis(values, x, axis=1) for x in (before, after[:, ::-1]))
    return np.fmin(*pair)
