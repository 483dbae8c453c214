"""Fences along plots: pickets, iron bars, wire panels; and a scaffold before a front."""

import numpy as np

from scenes.geometry.mesh import Vector, boxes
from scenes.pen import Pen, piece
from vo.contract.arrays import Array

KINDS: dict[str, tuple[float, tuple[float, float], float, str]] = {
    "pickets": (0.14, (0.085, 0.025), 1.0, "frame"),
    "bars": (0.12, (0.025, 0.025), 1.2, "iron"),
    "boards": (0.16, (0.15, 0.025), 1.7, "timber"),
    "wires": (0.1, (0.012, 0.012), 1.9, "steel"),
}
"""Pitch, width and thickness of what stands upright, its height, and its material; metres."""


@piece
def fence(put: Pen, rng: np.random.Generator, length_m: float, kind: str) -> None:
    """Put a fence of a kind along x from a place."""
    pitch, (wide, thick), high, material = KINDS[kind]
    along = np.arange(0, length_m - wide, pitch)
    low = np.column_stack([along, 0 * along, 0 * along + 0.06])
    top = high + (rng.normal(0, 0.01, len(along)) if kind in ("pickets", "boards") else 0)
    upright = low + np.column_stack([0 * along + wide, 0 * along + thick, top - low[:, 2]])
    put(material, boxes(low, upright, 0.9, rng.random(2)))
    posts = np.arange(0, length_m, 2.2)
    post = np.column_stack([posts, 0 * posts + thick, 0 * posts])
    put(material, boxes(post, post + np.array([0.08, 0.08, high + 0.05])))
    rails = np.array([(0.0, thick, z * high) for z in (0.18, 0.85)])
    put(material, boxes(rails, rails + np.array([length_m, 0.04, 0.06])))
    put.solid((length_m, 0.12, high), (length_m / 2, 0.06), shadow=False)
    put.shade(high / 2, (length_m, 0.04, high), min(1.0, wide / pitch), (length_m / 2, 0.06))


@piece
def scaffold(put: Pen, rng: np.random.Generator, length_m: float, height_m: float) -> None:
    """Put a scaffold along a front from a place: tubes, planks, rails and braces."""
    columns, levels = np.arange(0, length_m + 0.1, 2.2), np.arange(2.1, height_m, 2.0)
    tubes = [_row((x, y, 0.0), (0.05, 0.05, height_m)) for x in columns for y in (-1.35, -0.35)]
    for z in levels:
        tubes += [_row((0, -1.35, z + rise), (length_m, 0.05, 0.05)) for rise in (0.5, 1.0)]
        tubes += [_row((x, -1.35, z - 0.06), (0.05, 1.0, 0.05)) for x in columns]
    lows, highs = (np.concatenate(x) for x in zip(*tubes, strict=True))
    put("steel", boxes(lows, highs))
    planks = [
        _row((x, -1.3 + 0.32 * k, z), (2.16, 0.3, 0.045))
        for z in levels
        for x in columns[:-1]
        for k in range(3)
        if rng.random() < 0.9
    ]
    lows, highs = (np.concatenate(x) for x in zip(*planks, strict=True))
    put("timber", boxes(lows, highs, 1.1, rng.random(2)))
    for z in levels:
        put.shade(z, (length_m, 0.95, 0.05), 0.9, (length_m / 2, -0.85))
    put.solid((length_m, 1.1, height_m), (length_m / 2, -0.85), shadow=False)


def _row(low: Vector, size: Vector) -> tuple[Array, Array]:
    start = np.array([low], dtype=float)
    return start, start + np.asarray(size)
