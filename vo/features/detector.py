"""Detection of features: one interface over the detectors, and bucketing over the image."""

from collections.abc import Callable

import numpy as np

from vo.config import FeatureSettings
from vo.contract.arrays import Array, Image, Indices
from vo.contract.compilation import compiled
from vo.features.censure import censure
from vo.features.harris import harris

Detector = Callable[[Image, FeatureSettings], Array]
"""Function that finds all features of an image above `threshold`: (N, 3) rows (u_px, v_px,
response), the response in grey levels, so that thresholds compare across detectors."""

DETECTORS: dict[str, Detector] = {"censure": censure, "harris": harris}
"""Detectors, by `features.detector`."""


def detect(image: Image, settings: FeatureSettings) -> Array:
    """Find the strongest features of an image of any size, bucketed into its cells.

    (N, 2) float64 sub-pixel (u, v), centres on integers, strongest first, at most `count`.
    """
    found = DETECTORS[settings.detector](image, settings)
    return np.ascontiguousarray(found[_select_by_cell(found, image.shape, settings)][:, :2])


def _select_by_cell(found: Array, shape: tuple[int, ...], settings: FeatureSettings) -> Indices:
    """Select at most `count` features, the best of each image cell in turn."""
    strength = np.abs(found[:, 2])
    column, row = (found[:, :2] // settings.cell_px).astype(np.int64).T
    cell = row * -(-shape[1] // settings.cell_px) + column
    order = np.argsort(-strength, kind="stable")
    return order[np.sort(np.argsort(_ranks(cell[order]), kind="stable")[: settings.count])]


@compiled()
def _ranks(cell: Indices) -> Indices:
    """Count the entries before each that have the same cell."""
    taken = np.zeros(cell.max() + 1 if len(cell) else 0, dtype=np.int64)
    ranks = np.empty_like(cell)
    for i in range(len(cell)):
        ranks[i] = taken[cell[i]]
        taken[cell[i]] += 1
    return ranks
