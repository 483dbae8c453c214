"""The dataset folder: layout, manifest, and a writer that leaves a complete folder or none."""

import csv
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
from vo.contract.partial import exchange, lock

SCHEMA_VERSION = 1
MANIFEST = "dataset.json"
TRUTH = "mav0/state_groundtruth_estimate0"
MAP_FILE = "map.png"
CONTENT = frozenset({MANIFEST, MAP_FILE, "mav0"})
"""Names in a dataset folder."""
RECTIFIED_EYE = "eye of a rectified pair, pixel centres on integers"
"""End of the comment in each camera's sensor.yaml."""
DIGEST = "manifest_sha256"
"""Key of the manifest's own digest."""
OWN_TABLES = ("cam0/exposure.csv", "imu0/truth.csv", "contact0/data.csv", "depth0/data.csv")
"""Tables in mav0 that a dataset has and a EuRoC recording does not."""
READ_FOLDERS = ("mav0/cam0/", "mav0/cam1/", "mav0/wheels0/")
"""Folders of a dataset that an estimator reads."""


class DatasetWriter:
    """Writer into a hidden sibling folder, which takes the final name only when complete.

    A context manager: leaving it without `commit` (an error, Ctrl-C) removes all files; after a
    kill, the next writer beside it does. `add` may be called from several threads.
    """

    def __init__(self, out: Path, overwrite: bool = False) -> None:
        """Prepare to write `out`.

        Raises:
            DatasetError: If `out` exists and `overwrite` is off, or is not a dataset.
        """
        self.out, self._overwrite = out, overwrite
        self._target = out.resolve()
        self.partial = self._target.with_name(f".{self._target.name}.partial")
        self._former = self._target.with_name(f".{self._target.name}.partial.former")
        self.sha256: dict[str, str] = {}
        self._committed = False
        self._check_target()

    def __enter__(self) -> Self:
        """Create and lock the hidden folder, and clear the remains of killed writers.

        Raises:
            DatasetError: If another process is writing the same dataset.
        """
        self._lock = lock_partial(self.partial, self.out)
        if not self._target.exists() and (self._former / MANIFEST).is_file():
            self._former.rename(self._target)  # a writer was killed between its two renames
        clear_partial_folders(self.partial.parent)
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
        content[DIGEST] = manifest_digest(content)
        self._write(MANIFEST, (json.dumps(content, indent=1) + "\n").encode())
        self._check_target()
        if self._target.exists():
            self._replace_target()
        else:
            self.partial.rename(self._target)
        self._committed = True

    def _check_target(self) -> None:
        """Raise a DatasetError if the final name is taken and must not be replaced."""
        if not self._target.exists():
            return
        if not self._overwrite:
            raise DatasetError(f"{self.out}: already exists; choose another folder or overwrite it")
        if not self._target.is_dir() or self._target.is_mount():
            raise DatasetError(f"{self.out}: a file or mount point is not overwritten")
        if not (self._target / MANIFEST).is_file() and any(self._target.iterdir()):
            raise DatasetError(f"{self.out}: holds no {MANIFEST}, so it is not overwritten")

    def _replace_target(self) -> None:
        """Exchange the hidden and the final folder, then remove the former dataset.

        Where the system cannot exchange, a kill between two renames leaves both complete, hidden.
        """
        former_lock = lock(self._target, wait=True)  # no writer may take it over meanwhile
        if exchange(self.partial, self._target):
            former = self.partial
        else:
            former = self._target.rename(self._former)
            self.partial.rename(self._target)
        (former / MANIFEST).unlink(missing_ok=True)  # what is half removed is not a dataset
        shutil.rmtree(former, ignore_errors=True)
        if former_lock is not None:
            os.close(former_lock)

    def _write(self, name: str, data: bytes) -> None:
        path = self.partial / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        except OSError as error:  # of a failed write, Python does not say which file it was
            raise DatasetError(f"{self.out}: {name} cannot be written ({error.strerror})") from None


def lock_partial(partial: Path, out: Path) -> int:
    """Create an empty hidden folder, locked until the returned descriptor or the process is closed.

    Raises:
        DatasetError: If another process is writing `out`.
    """
    partial.mkdir(parents=True, exist_ok=True)
    descriptor = lock(partial)
    if descriptor is None:
        raise DatasetError(f"{out}: another process is writing this dataset")
    for left in partial.iterdir():
        shutil.rmtree(left) if left.is_dir() else left.unlink()
    return descriptor


def clear_partial_folders(parent: Path) -> None:
    """Remove the hidden folders that killed writers left in a folder.

    Those that a process has locked stay, empty ones, whose writer may just be starting, and
    complete ones without the dataset that they would have replaced or were to become.
    """
    for folder in parent.glob(".*.partial*"):
        name, dot, kind = folder.name.removeprefix(".").rpartition(".partial")
        try:
            names = {path.name for path in folder.iterdir()}
            alone = MANIFEST in names and not (parent / name).exists()
            if not dot or kind not in ("", ".former") or alone or not names or names - CONTENT:
                continue
            descriptor = lock(folder)
        except OSError:  # it is no folder, or another process was faster
            continue
        if descriptor is not None:
            shutil.rmtree(folder, ignore_errors=True)
            os.close(descriptor)


def installed_version(package: str) -> str:
    """Return the version of a package, for records of how something was made."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def manifest_digest(content: Mapping[str, Any]) -> str:
    """SHA-256 of a manifest without its own digest: keys sorted, no white space, UTF-8."""
    own = {key: value for key, value in content.items() if key != DIGEST}
    text = json.dumps(own, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


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
    except (ValueError, KeyError, TypeError, RecursionError):
        raise DatasetError(f"{path}: not a dataset manifest") from None
    if version != SCHEMA_VERSION:
        raise DatasetError(f"{path}: schema version {version}, this program reads {SCHEMA_VERSION}")
    return content


def check_whole(folder: Path) -> None:
    """Check that a dataset folder, or the `mav0` in it, has its manifest and the listed tables.

    Recordings of other origin, and cameras of a dataset copied without its own tables, pass.

    Raises:
        DatasetError: If a part is missing; names it.
    """
    root = folder if (folder / "mav0").is_dir() else folder.resolve().parent
    own = [f"mav0/{name}" for name in OWN_TABLES if (root / "mav0" / name).is_file()]
    sheet = root / "mav0/cam0/sensor.yaml"
    if not own or (sheet.is_file() and RECTIFIED_EYE not in sheet.read_text(errors="replace")):
        return
    if not (root / MANIFEST).is_file():
        raise DatasetError(
            f"{root / MANIFEST}: is missing, though {own[0]} is there: a dataset torn by a killed "
            "command, or an incomplete copy; record or copy it again"
        )
    listed: Mapping[str, str] = read_manifest(root).get("sha256", {})
    tables = (x for x in listed if x.startswith(READ_FOLDERS) and x.endswith((".csv", ".yaml")))
    for name in tables:
        if not (root / name).is_file():
            raise DatasetError(f"{root / name}: is missing, though {MANIFEST} lists it")
