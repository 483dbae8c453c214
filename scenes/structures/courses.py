"""Blocks and planks laid in courses: each with its own face from an atlas, flat and level."""

import itertools

import numpy as np

from scenes.geometry.mesh import Mesh, Vector
from scenes.structures.ground import level
from scenes.surfaces.atlas import Atlas
from vo.contract.arrays import Array

OVERLAP_M = 2e-4
"""Overlap of neighbouring courses, which share no vertices: without it hairlines open."""
_UNIT = np.array([(0.0, 1.0), (1, 1), (1, 0), (0, 0)])


def coursed(
    rng: np.random.Generator,
    half: Array,
    width_m: float,
    lengths_m: Vector,
    atlas: Atlas,
    cuts: int = 1,
) -> Mesh:
    """Cover (2,) half sizes about the origin, metres, with courses along x of a width.

    Pieces have random lengths between two, faces of the atlas with their length along u, and
    `cuts` quads each for baked light. The last course may reach beyond the half size in y.
    """
    x, y = half
    pieces: list[Array] = []
    for low, high in itertools.pairwise(np.arange(-y, y + width_m, width_m)):
        ends = _ends(rng, x, lengths_m)
        low_ = np.full(len(ends) - 1, low - OVERLAP_M)
        high_ = np.full(len(ends) - 1, high + OVERLAP_M)
        a, b = ends[:-1], ends[1:]
        pieces.append(np.stack([a, low_, b, low_, b, high_, a, high_], axis=1).reshape(-1, 4, 2))
    corners = np.concatenate(pieces)
    cell = atlas.pick(rng, len(corners))
    share = np.where(rng.random((len(corners), 1, 2)) < 0.5, 1 - _UNIT, _UNIT)
    uv = cell[:, None, :2] + share * (cell[:, 2:] - cell[:, :2])[:, None]
    return level(_cut(corners, cuts), _cut(uv, cuts))


def _ends(rng: np.random.Generator, x: float, lengths_m: Vector) -> Array:
    """Draw the ends of the pieces of one course, from -x to x; the outermost are cut off."""
    steps = rng.uniform(lengths_m[0], lengths_m[1], int(2 * x / lengths_m[0]) + 3)
    ends = -x - steps[0] * rng.uniform(0, 0.9) + np.concatenate([[0], np.cumsum(steps)])
    return np.clip(ends[: np.searchsorted(ends, x) + 1], -x, x)


def _cut(quads: Array, cuts: int) -> Array:
    """Cut (N, 4, 2) quads across their first side into (N cuts, 4, 2)."""
    share = np.linspace(0, 1, cuts + 1)[:, None]
    low = quads[:, None, 0] + share * (quads[:, None, 1] - quads[:, None, 0])
    high = quads[:, None, 3] + share * (quads[:, None, 2] - quads[:, None, 3])
    cut = np.stack([low[:, :-1], low[:, 1:], high[:, 1:], high[:, :-1]], axis=2)
    return cut.reshape(-1, 4, 2)
