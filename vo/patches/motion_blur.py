"""Motion blur: the image of a moving camera is a mean along the path of each point.

A template and an image are alike only if both are blurred alike. What one has more than the other
is given to the other one.

Source: Mei and Reid, Modeling and generating complex motion blur for real-time tracking, CVPR 2008,
here with one straight path for all pixels, as nearly all of a fast motion is rotation.
"""

import cv2
import numpy as np

from vo.contract.arrays import Array, Image

MIN_PX = 2.5
"""Path below which what is missing makes little difference: patches are four times as wide."""

STEPS_PER_PX = 4
"""Samples of a path."""


def blur_along(image: Image, path_px: Array) -> Image:
    """Blur an image (H, W) along a straight path (2,), centred at each pixel."""
    if np.hypot(*path_px) < MIN_PX:
        return image
    blurred = cv2.filter2D(image, -1, _kernel(path_px), borderType=cv2.BORDER_REPLICATE)
    return np.ascontiguousarray(blurred, dtype=np.uint8)


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
