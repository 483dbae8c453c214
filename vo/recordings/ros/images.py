"""Grey levels of image messages, raw or compressed."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vo.contract.arrays import Array
from vo.contract.errors import ImageError
from vo.recordings.images import decode_levels

GREY: dict[str, tuple[type[np.generic], int, int | None]] = {
    "mono8": (np.uint8, 1, None),
    "8uc1": (np.uint8, 1, None),
    "mono16": (np.uint16, 1, None),
    "16uc1": (np.uint16, 1, None),
    "bgr8": (np.uint8, 3, cv2.COLOR_BGR2GRAY),
    "8uc3": (np.uint8, 3, cv2.COLOR_BGR2GRAY),
    "rgb8": (np.uint8, 3, cv2.COLOR_RGB2GRAY),
    "bgra8": (np.uint8, 4, cv2.COLOR_BGRA2GRAY),
    "8uc4": (np.uint8, 4, cv2.COLOR_BGRA2GRAY),
    "rgba8": (np.uint8, 4, cv2.COLOR_RGBA2GRAY),
    "bgr16": (np.uint16, 3, cv2.COLOR_BGR2GRAY),
    "rgb16": (np.uint16, 3, cv2.COLOR_RGB2GRAY),
    **{
        f"bayer_{pattern.lower()}{bits}": (
            np.uint8 if bits == 8 else np.uint16,
            1,
            getattr(cv2, f"COLOR_Bayer{pattern}2GRAY"),
        )
        for pattern in ("RGGB", "BGGR", "GBRG", "GRBG")
        for bits in (8, 16)
    },
    "yuv422": (np.uint8, 2, cv2.COLOR_YUV2GRAY_UYVY),
    "uyvy": (np.uint8, 2, cv2.COLOR_YUV2GRAY_UYVY),
    "yuv422_yuy2": (np.uint8, 2, cv2.COLOR_YUV2GRAY_YUY2),
    "yuyv": (np.uint8, 2, cv2.COLOR_YUV2GRAY_YUY2),
}
"""Encodings of `sensor_msgs/image_encodings.hpp`, in lower case: type, channels, and OpenCV's
conversion to grey."""


def levels_of(path: Path, message: Any) -> Array:
    """Return the grey levels (H, W) of an Image or CompressedImage, uint8 or uint16.

    Raises:
        ImageError: If the encoding is unknown, or the data damaged; names the path.
    """
    if not hasattr(message, "encoding"):
        return decode_levels(path, message.data.tobytes())
    encoding = message.encoding.strip("\0 ").lower()
    if encoding not in GREY:
        raise ImageError(f"{path}: encoding {message.encoding}; expected one of {', '.join(GREY)}")
    kind, channels, conversion = GREY[encoding]
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    row_bytes = message.width * channels * dtype.itemsize
    step, size = max(message.step, row_bytes), message.height * message.width
    data = np.frombuffer(message.data, np.uint8)
    if not size or len(data) < step * (message.height - 1) + row_bytes:
        raise ImageError(
            f"{path}: {len(data)} bytes for {message.width}x{message.height} pixels of {encoding}"
        )
    rows = np.lib.stride_tricks.as_strided(data, (message.height, row_bytes), (step, 1))
    pixels: Array = np.ascontiguousarray(rows).view(dtype).astype(kind, copy=False)
    if conversion is None:
        return pixels
    if channels > 1:
        pixels = pixels.reshape(message.height, message.width, channels)
    return np.asarray(cv2.cvtColor(pixels, conversion))
