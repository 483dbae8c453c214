"""PNG and JPEG files of RGB images."""

from pathlib import Path

import cv2
import numpy as np

from sim.dataset.image_codecs import encode_png
from vo.contract.arrays import Image
from vo.contract.errors import SettingsError
from vo.contract.files import replacing

PICTURES = (".png", ".jpg", ".jpeg")
"""File name suffixes of images."""
JPEG_QUALITY = 85


def known_suffix(out: Path, valid: tuple[str, ...]) -> str:
    """Return a file's suffix in lower case; raise a SettingsError if it is not a valid one."""
    suffix = out.suffix.lower()
    if suffix not in valid:
        raise SettingsError(f"{out}: the name must end in {' or '.join(valid)}")
    return suffix


def write_picture(out: Path, image: Image, quality: int = JPEG_QUALITY) -> None:
    """Write (H, W, 3) RGB as PNG or JPEG, atomically."""
    if known_suffix(out, PICTURES) == ".png":
        data = encode_png(image)
    else:
        bgr = np.ascontiguousarray(image[..., ::-1])
        data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
    with replacing(out) as partial:
        partial.write_bytes(data)
