"""Images: decoding of grey images and labels, and 8 bits from any depth."""

import os
import re
import tempfile
import zlib
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from vo.contract.arrays import Array, Image
from vo.contract.errors import DatasetError, ImageError
from vo.contract.remarks import remark

SUFFIXES = (
    *(".png", ".jpg", ".jpeg", ".jp2", ".pgm", ".ppm", ".pnm"),
    *(".bmp", ".gif", ".tif", ".tiff", ".webp"),
)
"""Suffixes of image files, in lower case."""

DEPTHS = (8, 10, 12, 14, 16)
"""Bits that image sensors deliver in pixels of 16 bits."""

SAMPLE = 16
"""Number of images from which the depth in use is determined, evenly over a sequence."""

LEVEL_PERCENT = 99.9
"""Percentile that stands for the brightest level of an image; defective pixels are above it."""

MAX_CLIPPED = 0.01
"""Largest share of pixels above the depth in use that brings no remark."""

PNG, JPEG, JPEG_SCAN, JPEG_END = b"\x89PNG\r\n\x1a\n", b"\xff\xd8", b"\xff\xda", b"\xff\xd9"
JPEG_DAMAGE = re.compile(r"Corrupt JPEG data: (?!\d+ extraneous)|Premature end|Inconsistent")
"""What libjpeg writes of data that it cannot decode, and of which it invents the rest."""

cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # errors here name the file

GIT_LFS = b"version https://git-lfs"

Levels = Callable[[Path], Array]
"""Reader of the grey levels (H, W) of an image, uint8 or uint16."""


def list_images(folder: Path) -> list[Path]:
    """List the image files of a folder, numbered names by their number; none without a folder."""
    files = folder.iterdir() if folder.is_dir() else ()
    images = (x for x in files if x.suffix.lower() in SUFFIXES and not x.name.startswith("."))
    return sorted(images, key=lambda x: (number_of(x.stem), x.name))


def number_of(stem: str) -> int:
    """Return the number of a frame from its file's name; -1 if the name is no number."""
    return int(stem) if stem.isascii() and stem.isdigit() else -1


def image_files(folder: Path, names: Sequence[str]) -> list[Path]:
    """Return the files of a table's names, which may have a folder, and no or another suffix.

    A name without a file is kept, with `.png` if it has no suffix.
    """
    files = list_images(folder)
    by_name, by_stem = {x.name: x for x in files}, {x.stem: x for x in files}
    found: list[Path] = []
    for entry in names:
        name = entry.replace("\\", "/").rsplit("/", 1)[-1]
        suffix = Path(name).suffix
        is_image = suffix.lower() in SUFFIXES
        stem = name.removesuffix(suffix) if is_image else name
        missing = folder / (name if is_image else f"{name}.png")
        found.append(by_name.get(name) or by_stem.get(stem) or missing)
    return found


@dataclass(frozen=True)
class GreyReader:
    """Reader of the images of one sequence as 8-bit grey.

    Attributes:
        size_px: Width and height of the first readable image.
        bits: Depth in use of images of 16 bits, one of DEPTHS; None if the first have 8 bits.
        levels: Reads the grey levels (H, W) of an image, uint8 or uint16; None for image files.
    """

    size_px: tuple[int, int]
    bits: int | None = None
    levels: "Levels | None" = None

    def __call__(self, path: Path) -> Image:
        """Read an image as (H, W) uint8; of 16 bits, the highest 8 in use.

        Raises:
            ImageError: If the file is missing, damaged or not an image.
        """
        image = (self.levels or _read_levels)(path)
        if image.dtype == np.uint8:
            return image
        if self.bits is None:
            remark(f"{path.parent}: images of 8 and of 16 bits; of these, all bits are in use")
        bits = self.bits or 16
        clipped = float((image >> bits > 0).mean()) if bits < 16 else 0.0
        if clipped > MAX_CLIPPED:
            remark(f"{path}: {clipped:.0%} of the pixels exceed {bits} bits and are clipped")
        return np.minimum(image >> (bits - 8), 255).astype(np.uint8)


def grey_reader(files: Sequence[Path], levels: Levels | None = None) -> GreyReader:
    """Make the reader of a sequence from a sample of its images, at least one, left eye first.

    `levels` is as of `GreyReader`. Images of 16 bits bring a remark that states the depth in use.

    Raises:
        ImageError: If no image of the sample can be read.
    """
    rows = np.unique(np.linspace(0, len(files) - 1, min(SAMPLE, len(files))).astype(int)).tolist()
    found: list[tuple[int, int]] = []
    brightest: list[int] = []
    problem: ImageError | None = None
    for i in dict.fromkeys((rows[0], rows[-1], *rows)):
        try:
            image = (levels or _read_levels)(files[i])
        except ImageError as error:
            problem = problem or error
            continue
        found.append((image.shape[1], image.shape[0]))
        if image.dtype == np.uint16:
            brightest.append(int(np.percentile(image, LEVEL_PERCENT)))
        if len(found) == 2 and not brightest:  # one of each eye
            break
    if not found:
        raise problem or DatasetError("a sequence without images")
    if not brightest:
        return GreyReader(found[0], None, levels)
    bits = next(x for x in DEPTHS if max(brightest) < 2**x)
    remark(
        f"{files[0].parent}: images of 16 bits of which {bits} are in use; "
        f"levels are divided by {2 ** (bits - 8)}"
    )
    return GreyReader(found[0], bits, levels)


def read_grey(path: Path) -> Image:
    """Read an image as (H, W) uint8 grey; colour is converted, 16 bits are scaled to 8.

    Raises:
        ImageError: If the file is missing, damaged or not an image.
    """
    return GreyReader((0, 0), 16)(path)


def read_float(path: Path, channels: int = 1) -> Array:
    """Read a (H, W) or (H, W, 3) float32 label.

    Raises:
        ImageError: If the file is missing, damaged or not a float image.
    """
    image = read_unchanged(path)
    shape = (*image.shape[:2], channels)[: 2 if channels == 1 else 3]
    if image.dtype != np.float32 or image.shape != shape:
        raise ImageError(
            f"{path}: expected a 32-bit float image of {channels} channels, got {image.dtype}"
        )
    return image if channels == 1 else image[..., ::-1]


def read_codes(path: Path) -> Array:
    """Read a (H, W) label of integers, uint8 or uint16.

    Raises:
        ImageError: If the file is missing, damaged or of another type.
    """
    image = read_unchanged(path)
    if image.dtype.name not in ("uint8", "uint16") or image.ndim != 2:
        raise ImageError(f"{path}: expected one channel of 8 or 16 bits, got {image.dtype}")
    return image


def read_unchanged(path: Path) -> Array:
    """Read the pixels of an image as stored, (H, W) or (H, W, C), in OpenCV's order of channels.

    Raises:
        ImageError: If the file is missing, damaged or not an image.
    """
    return _decode(path, _read_bytes(path), cv2.IMREAD_UNCHANGED)


def _read_levels(path: Path) -> Array:
    """Read the grey levels (H, W) of an image as stored, uint8 or uint16."""
    return decode_levels(path, _read_bytes(path))


def decode_levels(path: Path, data: bytes) -> Array:
    """Decode the content of an image file to grey levels (H, W), uint8 or uint16.

    Raises:
        ImageError: If it is damaged or not an image; names the path.
    """
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    image = _decode(path, data, flags)
    if image.dtype.name not in ("uint8", "uint16"):
        raise ImageError(f"{path}: pixels of type {image.dtype}; expected 8 or 16 bits")
    return image


def _read_bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise ImageError(f"{path}: cannot be read ({error.strerror})") from None


def _decode(path: Path, data: bytes, flags: int) -> Array:
    if fault := _fault(data):
        raise ImageError(f"{path}: {fault}")
    said: list[str] = []
    try:
        with _stderr_of_c(said) if data.startswith(JPEG) else nullcontext():
            image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        image = None
    if image is None:
        raise ImageError(f"{path}: not a readable image")
    if complaint := next(filter(JPEG_DAMAGE.match, said), ""):
        raise ImageError(f"{path}: {complaint}")
    if said:
        remark(f"{path.parent}: JPEGs hold bytes after the image was complete; are they damaged?")
    return np.asarray(image)


@contextmanager
def _stderr_of_c(said: list[str]) -> Generator[None]:
    """Collect the lines that libraries such as libjpeg write to stderr."""
    with tempfile.TemporaryFile("w+", errors="replace") as file:
        stderr = os.dup(2)
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            file.seek(0)
            said += file.read().splitlines()


def _fault(data: bytes) -> str:
    """Name the fault of a file, of which OpenCV might invent the rest; empty if there is none."""
    if not data:
        return "the file is empty"
    if data.startswith(GIT_LFS):
        return "a pointer of Git LFS instead of the image; fetch it with `git lfs pull`"
    if data.startswith(PNG) and not _is_whole_png(data):
        return "the PNG is truncated or damaged"
    # The scan of a preview inside the header ends before that of the image begins.
    if data.startswith(JPEG) and data.rfind(JPEG_END) < data.rfind(JPEG_SCAN):
        return "the JPEG is truncated"
    return ""


def _is_whole_png(data: bytes) -> bool:
    """Whether all chunks up to the last, IEND, are there and agree with their checksums."""
    at = len(PNG)
    while at + 12 <= len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        kind, checksum = data[at + 4 : at + 8], data[end : end + 4]
        if int.from_bytes(checksum, "big") != zlib.crc32(memoryview(data)[at + 4 : end]):
            return False
        if kind == b"IEND":
            return True
        at = end + 4
    return False
