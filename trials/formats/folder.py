"""A folder of exported files that appears whole, or not at all."""

import os
import shutil
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from vo.contract.dataset import lock_partial
from vo.contract.errors import DatasetError

Advance = Callable[[object], None]
"""Called after each exported frame; the argument is ignored."""


@contextmanager
def new_folder(out: Path) -> Generator[Path]:
    """Yield a hidden folder beside `out`, which takes its name only when the block succeeds.

    Raises:
        DatasetError: If `out` exists, cannot be written, or another process is writing it.
    """
    if os.path.lexists(out):
        raise DatasetError(f"{out}: already exists; choose another --out")
    target = out.resolve()
    partial = target.with_name(f".{target.name}.partial")
    missing = [x for x in target.parents if not os.path.lexists(x)]
    try:
        lock = lock_partial(partial, out)
        try:
            yield partial
            partial.rename(target)
        except BaseException:
            shutil.rmtree(partial, ignore_errors=True)
            _remove_empty(missing)
            raise
        finally:
            os.close(lock)
    except OSError as error:
        place = Path(error.filename or partial)
        if not place.is_relative_to(partial) and not partial.is_relative_to(place):
            raise  # of an input
        # Of a failed write, Python does not say which file it was.
        raise DatasetError(f"{out}: cannot be written ({error.strerror or error})") from None


def _remove_empty(folders: Sequence[Path]) -> None:
    """Remove folders, the innermost first, up to one that is not empty."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()


def put(path: Path, data: bytes | str) -> None:
    """Write a file, and the folders above it where they are missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data.encode() if isinstance(data, str) else data)
