"""Independent random streams: one generator per seed and name."""

import zlib

import numpy as np


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the generator of a named random stream, such as `scene`, of a seed of at least 0.

    Streams of one seed are independent, so that more draws from one (a scene with more bricks)
    leave the others (a sensor's noise) unchanged.
    """
    return np.random.default_rng([seed, zlib.crc32(name.encode())])
