"""Features of an image: one interface over the detectors, and an even spread over the image."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vo.config import FeatureSettings
from vo.contract.arrays import Array, Image, Indices
from vo.contract.compilation import compiled
from vo.features.censure import censure
from vo.features.harris import harris

Detector = Callable[[Image, FeatureSettings], Array]
"""All features of an image above `threshold`, (N, 4) rows (u_px, v_px, scale_px, response), with
the response in grey levels, so that thresholds and strengths mean something across detectors."""

DETECTORS: dict[str, Detector] = {"censure": censure, "harris": harris}


@dataclass(frozen=True)
class Features:
    """Keypoints of one image, strongest first.

    Attributes:
        pixels: (N, 2) float64 (u, v), sub-pixel, centres on integers.
        scale_px: (N,) standard deviation of the Gaussian blob that would be found alike; of
            Harris, of the window.
        response: (N,) contrast, grey levels: of CenSurE that blob's, positive where it is brighter
            than its surround; of Harris, which measures gradients, grey levels per pixel.
    """

    pixels: Array
    scale_px: Array
    response: Array

    def __len__(self) -> int:
        return len(self.pixels)


def detect(image: Image, settings: FeatureSettings) -> Features:
    """Find the strongest features of an image, spread over its cells.

    Args:
        image: (H, W) uint8 of any size; too small a one has no features.
        settings: The detector, its thresholds and the number wanted.

    Returns:
        At most `settings.count` features.
    """
    found = DETECTORS[settings.detector](image, settings)
    u, v, scale_px, response = found[_spread(found, image.shape, settings)].T
    return Features(np.stack([u, v], axis=-1), scale_px, response)


def _spread(found: Array, shape: tuple[int, ...], settings: FeatureSettings) -> Indices:
    """Choose indices of at most `count` features, taking the best of each image cell in turn."""
    strength = np.abs(found[:, 3])
    column, row = (found[:, :2] // settings.cell_px).astype(np.int64).T
    cell = row * -(-shape[1] // settings.cell_px) + column
    order = np.argsort(-strength, kind="stable")
    place = _places(cell[order])
    return order[np.sort(np.argsort(place, kind="stable")[: settings.count])]


@compiled()
def _places(cell: Indices) -> Indices:
    """How many entries before each have the same cell."""
    taken = np.zeros(cell.max() + 1 if len(cell) else 0, dtype=np.int64)
    places = np.empty_like(cell)
    for i in range(len(cell)):
        places[i] = taken[cell[i]]
        taken[cell[i]] += 1
    return places
