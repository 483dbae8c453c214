"""The dataset folder: layout, manifest, and a writer that leaves a whole folder or none."""

import csv
import hashlib
import io
import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import yaml

from vo.contract.errors import DatasetError

SCHEMA_VERSION = 1
MANIFEST = "dataset.json"
TRUTH = "mav0/state_groundtruth_estimate0"


class DatasetWriter:
    """Collects files in a hidden sibling folder, which takes the final name only when complete.

    Use as a context manager; leaving it without `commit` (an error, Ctrl-C) removes every trace.
    `add` may be called from several threads.
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
                raise DatasetError(f"{out}: holds no {MANIFEST}; will not overwrite it")
        self.partial = out.with_name(f".{out.name}.partial")
        self.sha256: dict[str, str] = {}

    def __enter__(self) -> Self:
        shutil.rmtree(self.partial, ignore_errors=True)
        self.partial.mkdir(parents=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        tb: TracebackType | None,
    ) -> None:
        shutil.rmtree(self.partial, ignore_errors=True)

    def add(self, name: str, data: bytes) -> None:
        """Write one file under its path inside the folder, and remember its hash."""
        path = self.partial / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
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
        """Write the manifest with the hash of every file, and give the folder its name."""
        content = {"schema_version": SCHEMA_VERSION, **manifest}
        content["sha256"] = dict(sorted(self.sha256.items()))
        (self.partial / MANIFEST).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        if self.out.exists():
            shutil.rmtree(self.out)
        self.partial.rename(self.out)


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
