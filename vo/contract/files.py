"""Atomic writing of files, and reading of text."""

import codecs
import re
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from vo.contract.errors import DatasetError, DriftyardError, SettingsError
from vo.contract.partial import partial_file

BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),  # it begins with that of UTF-16
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
CONTROL_CODES = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
"""Characters that no text holds."""


@contextmanager
def replacing(path: Path) -> Generator[Path]:
    """Yield a temporary path beside `path`, which it replaces only when the block succeeds.

    It has the suffix of `path`, from which an encoder may take the format. Those that killed
    processes left are removed.

    Raises:
        DatasetError: If the disk is full, or `path` a folder; names it.
    """
    if path.is_dir():
        raise DatasetError(f"{path}: is a folder, not a file that can be written")
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
    """Read the lines of a text file in UTF-8, or in UTF-16 or UTF-32; with any kind of line ends.

    Other bytes are taken for Latin-1, as in comments with a degree sign.

    Raises:
        error: If the file is missing, unreadable or not text; names the file.
    """
    try:
        data = path.read_bytes()
    except OSError as problem:
        raise error(f"{path}: cannot be read ({problem.strerror})") from None
    try:
        text = _decode_text(data)
    except UnicodeDecodeError:
        text = "\0"
    if CONTROL_CODES.search(text):
        raise error(f"{path}: not a text file")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _decode_text(data: bytes) -> str:
    for mark, encoding in BYTE_ORDER_MARKS:
        if data.startswith(mark):
            return data.decode(encoding)
    if len(data) > 1 and 0 in data[:2] and any(data[:2]):  # ASCII in UTF-16 without a mark
        return data.decode("utf-16-be" if data[0] == 0 else "utf-16-le")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")
