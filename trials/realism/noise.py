"""Photon transfer: the variance of the noise at each grey level, from the flattest image blocks.

The energy of a block is divided by its discrete cosine transform: coefficients of low frequency
tell how flat a block is, those of high frequency how strong its noise is. The noise of both is
independent, so the choice of flat blocks does not bias the noise, and motion does not matter.

Source: Colom and Buades, Analysis and extension of the Ponomarenko et al. method, estimating a
noise curve from a single image, IPOL 2013.
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import dctn

from vo.contract.arrays import Array, Image, Indices, Mask

BLOCK_PX = 8
OFFSET_PX = 3
"""Place of the first block: blocks of JPEG begin at multiples of 8."""
LOWEST, HIGHEST = 3, 252
"""Grey levels beyond which a pixel may be clipped."""
BIN_GREY = 16
GREY = np.arange(BIN_GREY / 2, 256, BIN_GREY)
"""(G,) middle of each bin of grey levels."""
FLAT_SHARE, MIN_FLAT, MIN_BLOCKS = 0.02, 40, 1000
"""Share of the blocks of a bin that count as flat, the smallest number of these, and of all blocks
of a bin for an estimate."""
ROUNDING = 1 / 12
"""Variance by rounding to whole grey levels."""

_ORDER = np.add.outer(np.arange(BLOCK_PX), np.arange(BLOCK_PX))
_LOW, _HIGH = (_ORDER > 0) & (_ORDER < 9), _ORDER >= 9


@dataclass(frozen=True)
class Blocks:
    """N blocks: (N,) mean grey level, energy of a low and of a high coefficient, grey squared."""

    mean: Array
    low: Array
    high: Array


NO_BLOCKS = Blocks(*(np.zeros(0),) * 3)
"""Blocks of an unreadable image."""


def measure_blocks(image: Image) -> Blocks:
    """Measure the blocks of an image (H, W) uint8 without clipped pixels."""
    inner = image[OFFSET_PX:, OFFSET_PX:]
    rows, columns = inner.shape[0] // BLOCK_PX, inner.shape[1] // BLOCK_PX
    tiles = inner[: rows * BLOCK_PX, : columns * BLOCK_PX]
    tiles = tiles.reshape(rows, BLOCK_PX, columns, BLOCK_PX).swapaxes(1, 2)
    tiles = tiles.reshape(-1, BLOCK_PX, BLOCK_PX)
    whole = (tiles.min(axis=(1, 2)) >= LOWEST) & (tiles.max(axis=(1, 2)) <= HIGHEST)
    found = dctn(tiles[whole].astype(np.float32), axes=(1, 2), norm="ortho")
    energy = found**2
    mean = found[:, 0, 0] / BLOCK_PX
    return Blocks(mean, energy[:, _LOW].mean(axis=1), energy[:, _HIGH].mean(axis=1))


def select_flat(blocks: Blocks) -> tuple[Indices, Mask]:
    """Return the bin in GREY of each block (N,), and whether it is one of the flattest of its bin.

    Bins with too few flat blocks have none.
    """
    bins = np.clip(blocks.mean // BIN_GREY, 0, len(GREY) - 1).astype(np.int64)
    flat = np.zeros(len(bins), bool)
    for k in range(len(GREY)):
        rows = np.flatnonzero(bins == k)
        count = max(int(FLAT_SHARE * len(rows)), MIN_FLAT)
        if len(rows) >= MIN_BLOCKS:
            flat[rows[np.argpartition(blocks.low[rows], count)[:count]]] = True
    return bins, flat
