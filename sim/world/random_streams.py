"""Random streams that do not disturb each other: one generator per seed and name."""

import zlib

import numpy as np


def stream(seed: int, name: str) -> np.random.Generator:
    """Return the generator of one named source of randomness.

    Streams of one seed are independent, so that drawing more from one (a scene with more
    bricks) leaves the others (a sensor's noise) unchanged.

    Args:
        seed: Of the dataset, not negative.
        name: Of the stream, for example `scene`.
    """
    return np.random.default_rng([seed, zlib.crc32(name.encode())])
