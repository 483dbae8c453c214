"""Dense disparity by OpenCV: block correlation (thesis 3.1) and semi-global matching (F9).

Source: Hirschmüller, Stereo Processing by Semiglobal Matching and Mutual Information, PAMI 2008.
"""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from vo.config import StereoSettings
from vo.contract.arrays import Array, Image

FIXED_POINT = 16.0
"""Units of a pixel in the disparities of OpenCV."""

BLOCK_PX = 15
"""Side of the block of block matching, pixels."""


def _block_matcher(disparities: int) -> Any:
    matcher = cv2.StereoBM.create(disparities, BLOCK_PX)
    matcher.setUniquenessRatio(8)
    matcher.setTextureThreshold(5)
    return matcher


def _semi_global_matcher(disparities: int) -> Any:
    return cv2.StereoSGBM.create(
        minDisparity=0, numDisparities=disparities, blockSize=5, P1=8 * 25, P2=32 * 25,
        disp12MaxDiff=1, uniquenessRatio=8, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip


MATCHERS: dict[str, Callable[[int], Any]] = {
    "block_matching": _block_matcher,
    "semi_global": _semi_global_matcher,
}
"""OpenCV's matchers for a number of disparities, by `stereo.method`; "sparse" needs none."""


class DenseStereo:
    """Dense matcher, on images reduced by `settings.downscale`."""

    def __init__(self, settings: StereoSettings) -> None:
        """Size the search so that it covers `settings.max_disparity_px`."""
        self._downscale = settings.downscale
        self.disparities = 16 * int(np.ceil(settings.max_disparity_px / self._downscale / 16))
        create = MATCHERS.get(settings.method)
        self._matcher = create(self.disparities) if create else None

    def __call__(self, left: Image, right: Image) -> Array:
        """Return the disparity u_left - u_right at each left pixel of the reduced image.

        In pixels of the full image, (H / downscale, W / downscale) float32, NaN where unknown; of
        size zero where the method is sparse.
        """
        if self._matcher is None:
            return np.zeros((0, 0), dtype=np.float32)
        if self._downscale > 1:
            size = (left.shape[1] // self._downscale, left.shape[0] // self._downscale)
            left, right = (
                np.asarray(cv2.resize(x, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
                for x in (left, right)
            )
        if left.shape[1] <= self.disparities:
            return np.full(left.shape, np.nan, dtype=np.float32)
        raw = self._matcher.compute(left, right)
        return np.where(raw > 0, raw * np.float32(self._downscale / FIXED_POINT), np.nan)


def sample_nearest(dense: Array, pixels: Array, shape: tuple[int, ...]) -> Array:
    """Read the values (N,) nearest to pixels (N, 2) of an image of `shape`, NaN outside."""
    rows = np.floor((pixels[:, 1] + 0.5) * dense.shape[0] / shape[0])
    columns = np.floor((pixels[:, 0] + 0.5) * dense.shape[1] / shape[1])
    with np.errstate(invalid="ignore"):
        inside = (rows >= 0) & (rows < dense.shape[0])
        inside &= (columns >= 0) & (columns < dense.shape[1])
    values = np.full(len(pixels), np.nan)
    values[inside] = dense[rows[inside].astype(int), columns[inside].astype(int)]
    return values
