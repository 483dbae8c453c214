"""The dataset folder: layout, manifest, and a writer that leaves a complete folder or none."""

import csv
import fcntl
import hashlib
import importlib.metadata
import io
import json
import os
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import yaml

from vo.contract.errors import DatasetError

SCHEMA_VERSION = 1
MANIFEST = "dataset.json"
TRUTH = "mav0/state_groundtruth_estimate0"


class DatasetWriter:
    """Writer into a hidden sibling folder, which takes the final name only when complete.

    A context manager: leaving it without `commit` (an error, Ctrl-C) removes all files; after a
    kill, the next writer of the same dataset does. `add` may be called from several threads.
    """

    def __init__(self, out: Path, overwrite: bool = False) -> None:
        """Prepare to write `out`.

        Raises:
            DatasetError: If `out` exists and `overwrite` is off, or is not a dataset.
        """
        self.out = out
        if out.exists():
            if not overwrite:
                raise DatasetError(f"{out}: already exists; choose another --out or --overwrite")
            if not (out / MANIFEST).is_file() and any(out.iterdir()):
                raise DatasetError(f"{out}: holds no {MANIFEST}, so it is not overwritten")
        self.partial = out.with_name(f".{out.name}.partial")
        self.sha256: dict[str, str] = {}
        self._committed = False

    def __enter__(self) -> Self:
        """Create and lock the hidden folder.

        Raises:
            DatasetError: If another process is writing the same dataset.
        """
        self._lock = _lock_folder(self.partial, self.out)
        return self

    def __exit__(self, *error: object) -> None:
        if not self._committed:
            shutil.rmtree(self.partial, ignore_errors=True)
        os.close(self._lock)

    def add(self, name: str, data: bytes) -> None:
        """Write a file at its path inside the folder, and store its hash.

        Raises:
            DatasetError: If the disk is full; names the file.
        """
        self._write(name, data)
        self.sha256[name] = hashlib.sha256(data).hexdigest()

    def add_yaml(self, name: str, content: Mapping[str, Any]) -> None:
        """Write a mapping as YAML."""
        self.add(name, yaml.safe_dump(dict(content), sort_keys=False).encode())

    def add_csv(self, name: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """Write an ASL table: a header line that starts with #, then comma-separated rows."""
        text = io.StringIO()
        text.write("#" + ",".join(header) + "\n")
        csv.writer(text, lineterminator="\n").writerows(rows)
        self.add(name, text.getvalue().encode())

    def commit(self, manifest: Mapping[str, Any]) -> None:
        """Write the manifest with the hash of every file, and rename the folder.

        Raises:
            DatasetError: If the disk is full.
        """
        content = {"schema_version": SCHEMA_VERSION, **manifest}
        content["sha256"] = dict(sorted(self.sha256.items()))
        self._write(MANIFEST, (json.dumps(content, indent=1) + "\n").encode())
        if self.out.exists():
            shutil.rmtree(self.out)
        self.partial.rename(self.out)
        self._committed = True

    def _write(self, name: str, data: bytes) -> None:
        path = self.partial / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        except OSError as error:  # of a failed write, Python does not say which file it was
            raise DatasetError(f"{self.out}: {name} cannot be written ({error.strerror})") from None


def _lock_folder(partial: Path, out: Path) -> int:
    """Create an empty folder, locked until the returned descriptor or the process is closed."""
    partial.mkdir(parents=True, exist_ok=True)
    lock = os.open(partial, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        locked = os.path.samestat(os.fstat(lock), partial.stat())  # it may just have been renamed
    except (BlockingIOError, FileNotFoundError):
        locked = False
    if not locked:
        os.close(lock)
        raise DatasetError(f"{out}: another process is writing this dataset")
    for left in partial.iterdir():
        shutil.rmtree(left) if left.is_dir() else left.unlink()
    return lock


def installed_version(package: str) -> str:
    """Return the version of a package, for records of how something was made."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read dataset.json.

    Raises:
        DatasetError: If it is missing, unreadable or of another schema version.
    """
    path = folder / MANIFEST
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        version = content["schema_version"]
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, KeyError, TypeError):
        raise DatasetError(f"{path}: not a dataset manifest") from None
    if version != SCHEMA_VERSION:
        raise DatasetError(f"{path}: schema version {version}, this program reads {SCHEMA_VERSION}")
    return content
