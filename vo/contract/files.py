"""Atomic writing of files, and reading of text, tables and images."""

from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from vo.contract.arrays import Array, Image, Indices
from vo.contract.errors import DatasetError, DriftyardError, SettingsError
from vo.contract.partial import partial_file

PNG_END = b"IEND\xaeB`\x82"


@contextmanager
def replacing(path: Path) -> Generator[Path]:
    """Yield a temporary path beside `path`, which it replaces only when the block succeeds.

    It has the suffix of `path`, from which an encoder may take the format. Those that killed
    processes left are removed.

    Raises:
        DatasetError: If the disk is full; names `path`.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = partial_file(path)
    try:
        yield partial
        partial.replace(path)
    except OSError as error:
        if error.filename is not None:
            raise
        # Of a failed write, Python does not say which file it was.
        raise DatasetError(f"{path}: cannot be written ({error.strerror or error})") from None
    finally:
        partial.unlink(missing_ok=True)


def known_suffix(path: Path, valid: tuple[str, ...]) -> str:
    """Return a file's suffix in lower case.

    Raises:
        SettingsError: If it is not a valid one.
    """
    suffix = path.suffix.lower()
    if suffix not in valid:
        raise SettingsError(f"{path}: the name must end in {' or '.join(valid)}")
    return suffix


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text atomically."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")


def read_lines(path: Path, error: type[DriftyardError] = DatasetError) -> list[str]:
    """Read the lines of a UTF-8 file.

    Raises:
        error: If the file is missing, unreadable or not text; names the file.
    """
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError as problem:
        raise error(f"{path}: cannot be read ({problem.strerror})") from None
    except UnicodeDecodeError:
        raise error(f"{path}: not a text file") from None


def read_rows(
    path: Path, separator: str | None = ",", error: type[DriftyardError] = DatasetError
) -> Iterator[tuple[str, list[str]]]:
    """Yield place (`file:line`) and words of each row; skip blank lines and comments (`#`).

    A separator of None is white space.
    """
    for number, line in enumerate(read_lines(path, error), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield f"{path}:{number}", [word.strip() for word in line.split(separator)]


def read_columns(
    path: Path, columns: Sequence[int] | None = None, error: type[DriftyardError] = DatasetError
) -> tuple[Indices, Array]:
    """Read comma-separated numbers: (N,) int64 timestamps in ns, (N, C) other or given columns."""
    try:  # timestamps have too many digits for a float
        times = np.loadtxt(path, delimiter=",", usecols=0, dtype=np.int64, ndmin=1)
        values = np.loadtxt(path, delimiter=",", usecols=columns, ndmin=2)
    except (OSError, ValueError, IndexError) as problem:
        raise error(f"{path}: missing or malformed ({problem})") from None
    return times, values if columns else values[:, 1:]


def read_grey(path: Path) -> Image:
    """Read an image as (H, W) uint8 grey; colour is converted, 16 bits are scaled to 8.

    Raises:
        DatasetError: If the file is missing, truncated or not an image.
    """
    return np.asarray(_decode(path, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def read_float(path: Path, channels: int = 1) -> Array:
    """Read a (H, W) or (H, W, 3) float32 label.

    Raises:
        DatasetError: If the file is missing, damaged or not a float image.
    """
    image = _decode(path, cv2.IMREAD_UNCHANGED)
    shape = (*image.shape[:2], channels)[: 2 if channels == 1 else 3]
    if image.dtype != np.float32 or image.shape != shape:
        raise DatasetError(
            f"{path}: expected a 32-bit float image of {channels} channels, got {image.dtype}"
        )
    return image if channels == 1 else image[..., ::-1]


def read_codes(path: Path) -> Array:
    """Read a (H, W) label of integers, uint8 or uint16.

    Raises:
        DatasetError: If the file is missing, damaged or of another type.
    """
    image = _decode(path, cv2.IMREAD_UNCHANGED)
    if image.dtype.name not in ("uint8", "uint16") or image.ndim != 2:
        raise DatasetError(f"{path}: expected one channel of 8 or 16 bits, got {image.dtype}")
    return image


def _decode(path: Path, flags: int) -> Array:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror})") from None
    # OpenCV fills the rest of a truncated PNG with zeros and says nothing.
    if path.suffix.lower() == ".png" and not data.endswith(PNG_END):
        raise DatasetError(f"{path}: the PNG is truncated or damaged")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error:
        image = None
    if image is None:
        raise DatasetError(f"{path}: not a readable image")
    return np.asarray(image)
