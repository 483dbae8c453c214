"""Image-based sky light: a cube of radiance, its irradiance, and the file that carries both.

Cubes have six faces in OpenGL's order and orientation, in a frame of y up and -z forward.
"""

import struct

import cv2
import numpy as np

from scenes.lighting.baked_light import Light
from scenes.surfaces.sky import face_rays
from sim.imaging.linear_light import decode, levels_to_light
from vo.contract.arrays import Array, Image

SIDE_PX = 32
"""Side of a face; a tenth of a radian a texel is enough for matte surfaces."""
LEVELS = 6
R11F_G11F_B10F, RGB = 0x8C3A, 0x1907
"""OpenGL's numbers of the format of the texels."""
KTX = b"\xabKTX 11\xbb\r\n\x1a\n"


def sky_radiance(light: Light, sky: Image | None) -> Array:
    """Return the (6, S, S, 3) linear radiance around a scene that gives what its light states.

    A level surface that sees all of it gets the linear light of the grey level that ambient and
    fill give in the classic renderer. The directions are those of `sky`, (6 S', S', 3), or, where
    there is none, lead from a bright ceiling to a dim floor.
    """
    above = linear(light.ambient_rgb + light.fill_rgb)
    if sky is None:
        below = linear(light.ambient_rgb)
        slope = 0.75 * (above - below) * face_rays(SIDE_PX)[..., 2:]
        cube = np.maximum((above + below) / 2 + slope, 0)
    else:
        faces = decode(sky).reshape(6, sky.shape[1], sky.shape[1], 3)
        size = SIDE_PX, SIDE_PX
        cube = np.stack([cv2.resize(x, size, interpolation=cv2.INTER_AREA) for x in faces])
    return cube * (above / _irradiance(cube, np.array([[0, 0, 1.0]]))[0])


def sun_irradiance(light: Light) -> Array:
    """Return the (3,) linear light that a surface facing the key lamp gets from it.

    With the sky, level ground gets the linear light of its grey level in the classic renderer.
    """
    sky = light.ambient_rgb + light.fill_rgb
    on_ground = linear(sky + light.key_rgb * light.key[2]) - linear(sky)
    return on_ground / light.key[2]


def linear(share: Array) -> Array:
    """Convert a share (...) of the brightest grey level to linear light."""
    return levels_to_light("srgb", 255 * share)


def ktx_file(cube: Array) -> bytes:
    """Write a cube, ever coarser for rougher surfaces, with its irradiance, as a KTX file."""
    rows = [" ".join(f"{x:.7g}" for x in row) for row in _harmonics(cube)]
    entry = b"sh\0" + "\n".join(rows).encode() + b"\n\0"
    entry = struct.pack("<I", len(entry)) + entry
    entry += bytes(-len(entry) % 4)
    kind = 1, RGB, R11F_G11F_B10F, R11F_G11F_B10F
    shape = SIDE_PX, SIDE_PX, 0, 0, 6, LEVELS, len(entry)
    head = struct.pack("<13I", 0x04030201, R11F_G11F_B10F, *kind, *shape)
    body = b""
    for level in range(LEVELS):
        step = 1 << level
        small = cube.reshape(6, SIDE_PX // step, step, SIDE_PX // step, step, 3).mean(axis=(2, 4))
        face = _packed(small)
        body += struct.pack("<I", face.nbytes // 6) + face.tobytes()
    return KTX + head + entry + body


def _irradiance(cube: Array, normals: Array) -> Array:
    """Integrate a cube over the hemisphere of (N, 3) normals, over pi: (N, 3)."""
    t = (np.arange(SIDE_PX) + 0.5) / SIDE_PX * 2 - 1
    solid = np.tile((1 + t[:, None] ** 2 + t**2) ** -1.5 * (2 / SIDE_PX) ** 2, (6, 1, 1)).ravel()
    facing = np.maximum(normals @ face_rays(SIDE_PX).reshape(-1, 3).T, 0)
    return facing @ (solid[:, None] * cube.reshape(-1, 3)) / np.pi


def _harmonics(cube: Array) -> Array:
    """Fit Filament's 9 functions of the normal to the irradiance: (9, 3)."""
    k = np.arange(256)[:, None] + 0.5
    turn, height = k * np.pi * (3 - np.sqrt(5)), 1 - k / 128
    flat = np.sqrt(1 - height**2)
    normals = np.hstack([flat * np.cos(turn), flat * np.sin(turn), height])
    x, y, z = normals[:, 0], normals[:, 2], -normals[:, 1]  # y up
    basis = [np.ones(256), y, z, x, x * y, y * z, 3 * z * z - 1, z * x, x * x - y * y]
    return np.linalg.lstsq(np.stack(basis, axis=1), _irradiance(cube, normals))[0]


def _packed(cube: Array) -> Array:
    """Convert (..., 3) to OpenGL's floats of 11, 11 and 10 bits: half floats without sign."""
    half = cube.astype(np.float16).view(np.uint16).astype(np.uint32)
    return (half[..., 0] >> 4 | half[..., 1] >> 4 << 11 | half[..., 2] >> 5 << 22).astype("<u4")
