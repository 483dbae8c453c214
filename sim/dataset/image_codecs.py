"""Lossless encoding of images and labels, by ISA-L: three times as fast as OpenCV, and smaller.

The bytes may differ between processors; the decoded pixels do not.

Source: PNG, third edition (W3C, 2025), sections 5 and 9; TIFF 6.0, sections 2 and 8; Adobe
Photoshop TIFF Technical Notes 2 (deflate) and 3 (floating-point predictor).
"""

import struct

import numpy as np
from isal import isal_zlib

from vo.contract.arrays import Array

EFFORT = 1
"""Compression level of ISA-L; 2 takes longer and saves one per cent, 0 saves no time."""

PNG_START = b"\x89PNG\r\n\x1a\n"
GREY, RGB = 0, 2
"""PNG's colour types."""
SUB = 1
"""PNG's filter for differences to the pixel on the left."""

HEADER_BYTES = 8
"""Size of a TIFF header."""
SHORT, LONG = 3, 4
"""TIFF's types of 16 and 32 bits."""


def encode_png(image: Array) -> bytes:
    """Encode (H, W) grey of 8 or 16 bits, or (H, W, 3) RGB uint8, losslessly."""
    height, width = image.shape[:2]
    channels = image.shape[2] if image.ndim == 3 else 1
    big_endian = np.ascontiguousarray(image, image.dtype.newbyteorder(">"))
    rows = big_endian.view(np.uint8).reshape(height, -1)
    filtered = np.empty((height, 1 + rows.shape[1]), np.uint8)
    filtered[:, 0] = SUB
    _differences(rows, channels * image.itemsize, filtered[:, 1:])
    kind = RGB if channels == 3 else GREY
    head = struct.pack(">2I5B", width, height, 8 * image.itemsize, kind, 0, 0, 0)
    parts = ((b"IHDR", head), (b"IDAT", isal_zlib.compress(filtered, EFFORT)), (b"IEND", b""))
    return PNG_START + b"".join(_chunk(name, data) for name, data in parts)


def encode_float(label: Array) -> bytes:
    """Encode (H, W) or (H, W, 3) float32 losslessly as TIFF."""
    height, width = label.shape[:2]
    channels = label.shape[2] if label.ndim == 3 else 1
    # Of every row all the highest bytes, then the next, to the lowest: likes stand together.
    little_endian = np.ascontiguousarray(label, "<f4").view(np.uint8).reshape(height, -1, 4)
    planes = np.empty((height, 4, width * channels), np.uint8)
    for k in range(4):
        planes[:, k] = little_endian[:, :, 3 - k]
    rows = planes.reshape(height, -1)
    predicted = np.empty_like(rows)
    _differences(rows, channels, predicted)
    return _tiff(width, height, channels, isal_zlib.compress(predicted, EFFORT))


def _differences(rows: Array, apart: int, out: Array) -> None:
    """Subtract from every byte of (H, N) rows the one `apart` before it, modulo 256."""
    out[:, :apart] = rows[:, :apart]
    np.subtract(rows[:, apart:], rows[:, :-apart], out=out[:, apart:])


def _chunk(name: bytes, data: bytes) -> bytes:
    check = isal_zlib.crc32(data, isal_zlib.crc32(name))
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", check)


def _tiff(width: int, height: int, channels: int, strip: bytes) -> bytes:
    """Assemble one strip with all rows, the values that exceed the directory, and the directory."""
    fields = (
        (256, LONG, (width,)),
        (257, LONG, (height,)),
        (258, SHORT, (32,) * channels),  # bits of a sample
        (259, SHORT, (8,)),  # deflate
        (262, SHORT, (2 if channels == 3 else 1,)),  # RGB, or black is zero
        (273, LONG, (HEADER_BYTES,)),  # where the strip starts
        (277, SHORT, (channels,)),
        (278, LONG, (height,)),  # rows of a strip
        (279, LONG, (len(strip),)),
        (284, SHORT, (1,)),  # samples of a pixel stand together
        (317, SHORT, (3,)),  # floating-point predictor
        (339, SHORT, (3,) * channels),  # samples are floating-point numbers
    )
    body, entries = strip + bytes(len(strip) % 2), b""
    for tag, kind, values in fields:
        data = struct.pack(f"<{len(values)}{'H' if kind == SHORT else 'I'}", *values)
        if len(data) > 4:
            data, body = (
                struct.pack("<I", HEADER_BYTES + len(body)),
                body + data + bytes(len(data) % 4),
            )
        entries += struct.pack("<HHI", tag, kind, len(values)) + data.ljust(4, b"\0")
    header = struct.pack("<2sHI", b"II", 42, HEADER_BYTES + len(body))
    return header + body + struct.pack("<H", len(fields)) + entries + bytes(4)
