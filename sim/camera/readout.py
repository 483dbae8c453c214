"""Depths and geom ids from the buffers of a label pass."""

import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.compilation import compiled

Readout = tuple[Array, Array, Array, Array]


def decode_buffers(
    zbuffer: Array, codes: Image, ids: Array, near_m: np.float32, far_m: np.float32
) -> Readout:
    """Split the buffers of both cameras and convert them to metres and ids, in one pass.

    The projection maps depth Z to s = a / Z - c with c = n / (f - n) and a = f n / (f - n), in
    OpenGL's single precision; cleared pixels (s = 0) have no depth.

    Args:
        zbuffer: (H, 2W) float32 s, 1 near, 0 far, bottom row first.
        codes: (H, 2W, 4) uint8 number of the geom, lowest byte first; alpha is ignored.
        ids: (N,) int32 id of each number.
        near_m: Near plane n.
        far_m: Far plane f.

    Returns:
        (H, W) float32 depth of left and right and int32 ids of left and right, top row first.
    """
    height, width = zbuffer.shape[0], zbuffer.shape[1] // 2
    depth = np.empty((2, height, width), np.float32)
    geoms = np.empty((2, height, width), np.int32)
    c, a = near_m / (far_m - near_m), far_m * near_m / (far_m - near_m)
    _read_out(zbuffer, codes, ids, c, a, depth, geoms)
    return depth[0], depth[1], geoms[0], geoms[1]


@compiled(nogil=True)
def _read_out(
    zbuffer: Array,
    codes: Image,
    ids: Array,
    c: np.float32,
    a: np.float32,
    depth: Array,
    geoms: Array,
) -> None:
    height, width = depth.shape[1:]
    for y in range(height):
        v = height - 1 - y
        for camera in range(2):
            for u in range(width):
                x = camera * width + u
                s = zbuffer[y, x]
                depth[camera, v, u] = a / (s + c) if s > 0 else np.nan
                r, g, b = np.int32(codes[y, x, 0]), np.int32(codes[y, x, 1]), codes[y, x, 2]
                geoms[camera, v, u] = ids[r | g << 8 | np.int32(b) << 16]
