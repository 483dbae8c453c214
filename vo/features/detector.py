"""Detection of features: one interface over the detectors, and bucketing over the image."""

from collections.abc import Callable

import numpy as np

from vo.config import FeatureSettings
from vo.contract.arrays import Array, Image
from vo.features.candidates import select_corners
from vo.features.censure import censure
from vo.features.harris import harris

Detector = Callable[[Image, FeatureSettings], Array]
"""Function that finds all candidates of an image above `threshold`, as `select_corners` takes them.
The response is in grey levels, so that thresholds compare across detectors."""

DETECTORS: dict[str, Detector] = {"censure": censure, "harris": harris}
"""Detectors, by `features.detector`."""


def detect(image: Image, settings: FeatureSettings) -> Array:
    """Find the strongest features of an image of any size, bucketed into its cells.

    (N, 2) float64 sub-pixel (u, v), centres on integers, strongest first, at most `count`.
    """
    # A view, or an image that is read-only, would need machine code of its own.
    image = np.require(image, requirements=("C", "W"))
    candidates = DETECTORS[settings.detector](image, settings)
    return np.ascontiguousarray(select_corners(candidates, image, settings)[:, :2])
