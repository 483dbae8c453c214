"""Texture atlases: many variants of a surface in one texture, shown in one draw call."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vo.contract.arrays import Array, Image


@dataclass(frozen=True)
class Atlas:
    """A texture made of equal cells.

    Attributes:
        image: (H, W, 3) uint8 texture.
        rects: (N, 4) u0, v0, u1, v1 of each cell in texture coordinates, v down the image.
    """

    image: Image
    rects: Array

    @cached_property
    def count(self) -> int:
        """Number of cells."""
        return len(self.rects)

    def pick(self, rng: np.random.Generator, size: int | None = None) -> Array:
        """Choose random cells: (4,) or (size, 4) u0, v0, u1, v1."""
        return self.rects[rng.integers(self.count, size=size)]


def pack(cells: Image, gutter_px: int = 8) -> Atlas:
    """Lay out (N, h, w, 3) cells in a near-square grid, N >= 1.

    Each cell is framed by its replicated border: else a mipmap level would mix in neighbours.
    """
    count, height, width, _ = cells.shape
    g = gutter_px
    framed_height, framed_width = height + 2 * g, width + 2 * g
    columns = max(1, round(np.sqrt(count * framed_height / framed_width)))
    rows = -(-count // columns)
    framed = np.pad(cells, ((0, rows * columns - count), (g, g), (g, g), (0, 0)), mode="edge")
    grid = framed.reshape(rows, columns, framed_height, framed_width, 3)
    image = grid.swapaxes(1, 2).reshape(rows * framed_height, columns * framed_width, 3)
    row, column = np.divmod(np.arange(count), columns)
    u0 = (column * framed_width + g) / image.shape[1]
    v0 = (row * framed_height + g) / image.shape[0]
    rects = np.stack([u0, v0, u0 + width / image.shape[1], v0 + height / image.shape[0]], axis=1)
    return Atlas(np.ascontiguousarray(image), rects)
