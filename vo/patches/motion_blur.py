"""Motion blur: the image of a moving camera is a mean along the path of each point.

A template and an image are alike only if both are blurred alike. What one has more than the other
is given to the other one.

Source: Mei and Reid, Modeling and generating complex motion blur for real-time tracking, CVPR 2008,
here with one straight path for all pixels, as nearly all of a fast motion is rotation.
"""

import cv2
import numpy as np

from vo.contract.arrays import Array, Image, Indices
from vo.contract.compilation import compiled

MIN_PX = 2.5
"""Path below which what is missing makes little difference: patches are four times as wide."""

STEPS_PER_PX = 4
"""Samples of a path."""


def blur_along(image: Image, path_px: Array) -> Image:
    """Blur an image (H, W) along a straight path (2,), centred at each pixel."""
    if np.hypot(*path_px) < MIN_PX:
        return image
    kernel = _kernel(path_px)
    rows, columns = np.nonzero(kernel)
    ry, rx = (side // 2 for side in kernel.shape)
    padded = cv2.copyMakeBorder(image, ry, ry, rx, rx, cv2.BORDER_REPLICATE)
    none = -len(rows) % 4
    places = np.append(rows * padded.shape[1] + columns, np.zeros(none, np.int64))
    weights = np.append(kernel[rows, columns], np.zeros(none, np.float32))
    return _sum_weighted(padded.ravel(), padded.shape[1], places, weights, *image.shape)


@compiled(distinct=True, fastmath={"reassoc", "contract"})
def _sum_weighted(
    padded: Array, stride: int, places: Indices, weights: Array, height: int, width: int
) -> Image:
    """Sum weighted pixels (K,), so many places from each: the image (H, W); K is a multiple of 4.

    Most of the kernel's weights are zero; OpenCV's filter takes all, for up to eight times as long.
    """
    blurred, row = np.empty((height, width), np.uint8), np.empty(width, np.float32)
    for v in range(height):
        for u in range(np.uint64(width)):
            row[u] = np.float32(0.5)
        for k in range(0, len(places), 4):  # four at once: the row is read and written less often
            at = v * stride
            a, b = np.uint64(at + places[k]), np.uint64(at + places[k + 1])
            c, d = np.uint64(at + places[k + 2]), np.uint64(at + places[k + 3])
            wa, wb, wc, wd = weights[k], weights[k + 1], weights[k + 2], weights[k + 3]
            for u in range(np.uint64(width)):
                row[u] += (
                    wa * np.float32(padded[a + u]) + wb * np.float32(padded[b + u])
                    + wc * np.float32(padded[c + u]) + wd * np.float32(padded[d + u])
                )  # fmt: skip
        for u in range(np.uint64(width)):
            blurred[v, u] = np.uint8(row[u])
    return blurred


def missing_blur(path_px: Array, other_px: Array) -> tuple[Array, Array]:
    """Return the paths (2,) that blur two images, blurred along paths (2,) already, alike.

    The covariances of the paths are made equal: each image gets what only the other one has.
    """
    values, axes = np.linalg.eigh(np.outer(other_px, other_px) - np.outer(path_px, path_px))
    length_px = np.sqrt(np.abs(values))
    return length_px[1] * (values[1] > 0) * axes[:, 1], length_px[0] * (values[0] < 0) * axes[:, 0]


def _kernel(path_px: Array) -> Array:
    """Mean along a path: a kernel of odd sides, whose weights sum to one."""
    count = int(np.ceil(STEPS_PER_PX * np.hypot(*path_px)))
    places = ((np.arange(count) + 0.5) / count - 0.5)[:, None] * path_px
    rx, ry = (int(np.ceil(np.abs(x).max())) + 1 for x in places.T)
    kernel = np.zeros((2 * ry + 1, 2 * rx + 1), dtype=np.float32)
    floor = np.floor(places).astype(np.int64)
    (fu, fv), (u, v) = (places - floor).T, (floor + np.array([rx, ry])).T
    for du, dv, weight in (
        (0, 0, (1 - fu) * (1 - fv)), (1, 0, fu * (1 - fv)), (0, 1, (1 - fu) * fv), (1, 1, fu * fv),
    ):  # fmt: skip
        np.add.at(kernel, (v + dv, u + du), weight / count)
    return kernel
