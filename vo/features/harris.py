"""Harris corners at one scale, as a comparison with CenSurE (thesis 6).

Source: Harris and Stephens, A combined corner and edge detector, Alvey 1988.
"""

import cv2
import numpy as np

from vo.config import FeatureSettings
from vo.contract.arrays import Array, Image
from vo.features.subpixel import vertices

SIGMA_PX = 1.5
"""Standard deviation of the Gaussian window over which gradients are averaged."""

_BEFORE = np.array([[1, 1, 1], [1, 0, 0], [0, 0, 0]], dtype=np.uint8)
_AFTER = np.ascontiguousarray(_BEFORE[::-1, ::-1])


def harris(image: Image, settings: FeatureSettings) -> Array:
    """Find all corners: (N, 6) candidates, their response in grey levels per pixel."""
    response = harris_response(image, settings.line_ratio)
    v, u = np.nonzero(
        (response > settings.threshold)
        & (response > cv2.dilate(response, _BEFORE))  # of equal neighbours, the first wins
        & (response >= cv2.dilate(response, _AFTER))
    )
    inside = (u > 0) & (v > 0) & (u < image.shape[1] - 1) & (v < image.shape[0] - 1)
    found = np.stack([u, v], axis=-1)[inside]
    pixels = found + vertices(response, found)
    reach = np.zeros(len(found))
    return np.column_stack([pixels, response[found[:, 1], found[:, 0]], found, reach])


def harris_response(image: Image, line_ratio: float) -> Array:
    """Compute the fourth root of det A - k trace² A: (H, W) float32, 0 where negative.

    A is the mean outer product of the gradient, grey levels per pixel. The k that makes an edge of
    `line_ratio`, the ratio of A's eigenvalues, just vanish is r / (r + 1)²; 0.04 is a ratio of 23.
    """
    grey = image.astype(np.float32)
    du = cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=1, scale=0.5)
    dv = cv2.Sobel(grey, cv2.CV_32F, 0, 1, ksize=1, scale=0.5)
    uu, uv, vv = (cv2.GaussianBlur(x, (0, 0), SIGMA_PX) for x in (du * du, du * dv, dv * dv))
    k = line_ratio / (line_ratio + 1) ** 2
    return np.maximum(uu * vv - uv * uv - k * (uu + vv) ** 2, 0) ** np.float32(0.25)
