"""Responses of CenSurE at every pixel and scale."""

import numpy as np

from vo.features.censure import allocate_rows, find_extrema


def scale_space(image, shape):
    """(S, H, W) float32, zero where the surround does not fit into the image."""
    height, width = image.shape
    rows = allocate_rows(width, shape, kept=max(1 << (height - 1).bit_length(), 4))
    find_extrema(image, shape, 1e9, rows, np.empty((len(shape.margin), 0, 6)))
    responses = np.zeros((len(shape.margin), height, width), np.float32)
    for s, edge in enumerate(shape.margin):
        inside = slice(edge, max(height - edge, edge)), slice(edge, max(width - edge, edge))
        responses[s][inside] = rows.responses[:height, s, :width][inside]
    return responses
