"""Hidden partial files and folders: exchanged for complete ones, and cleared after a kill.

A folder is locked by its writer, a file has the writer's process in its name.
"""

import ctypes
import errno
import fcntl
import os
from glob import escape
from pathlib import Path

AT_FDCWD = -100
"""Linux's code for paths that are relative to the working directory."""
RENAME_EXCHANGE = 2
"""Linux's flag of renameat2 that exchanges two paths."""
UNSUPPORTED = (errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP)
"""Errors of a kernel or file system that cannot exchange paths."""


def exchange(first: Path, second: Path) -> bool:
    """Exchange two existing paths of one file system in one step; False where that is unsupported.

    Raises:
        OSError: If a path is missing or must not be renamed.

    Source: rename(2) of Linux, RENAME_EXCHANGE.
    """
    renameat2 = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if renameat2 is None:
        return False
    paths = AT_FDCWD, os.fsencode(first), AT_FDCWD, os.fsencode(second)
    if renameat2(*paths, RENAME_EXCHANGE) == 0:
        return True
    code = ctypes.get_errno()
    if code in UNSUPPORTED:
        return False
    raise OSError(code, os.strerror(code), str(second))


def lock(folder: Path, wait: bool = False) -> int | None:
    """Lock a folder until the returned descriptor or the process is closed; None if it is locked.

    Raises:
        OSError: If there is no such folder.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        # It may have been renamed since it was opened.
        locked = os.path.samestat(os.fstat(descriptor), folder.stat())
    except (BlockingIOError, FileNotFoundError):
        locked = False
    if not locked:
        os.close(descriptor)
    return descriptor if locked else None


def partial_file(path: Path) -> Path:
    """Return the hidden file beside `path`, with its suffix, of which this process is the writer.

    Those of the same path that killed processes left are removed.
    """
    for left in path.parent.glob(f".{escape(path.stem)}.*.partial{escape(path.suffix)}"):
        process = left.name.removeprefix(f".{path.stem}.").split(".")[0]
        if process.isdigit() and not _is_running(int(process)):
            left.unlink(missing_ok=True)
    return path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):  # of another user, or no process at all
        pass
    return True
