"""Results that machines share: objects in a folder or any location of fsspec, such as a bucket.

An object is a set of files below its name, and an index of their hashes, which is written last: one
without an index is not there. Names hold a digest of all that decides the content, so that an
object never changes.
"""

import hashlib
import json
import os
import platform
import shutil
from collections.abc import Generator, Iterable
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from trials.execution.cache import code_digest
from trials.execution.location import Location, StoreError, chunks

INDEX = ".index.json"


class Store(Location):
    """Location of the objects."""

    def index(self, name: str) -> dict[str, Any] | None:
        """Return the index of an object; None if it is absent, or was not written to the end."""
        for _, data in self.read([name + INDEX]):
            with suppress(ValueError, AttributeError):
                content = json.loads(data)
                return content if isinstance(content.get("sha256"), dict) else None
        return None

    def put(self, name: str, root: Path, files: Iterable[Path]) -> None:
        """Write files below `root` as an object, unless it is there."""
        if self.index(name) is not None:
            return
        hashes: dict[str, str] = {}
        for some in chunks(sorted(files)):
            read = {x.relative_to(root).as_posix(): x.read_bytes() for x in some}
            hashes |= {inner: hashlib.sha256(data).hexdigest() for inner, data in read.items()}
            self.write({f"{name}/{inner}": data for inner, data in read.items()})
        about = {
            "sha256": hashes,
            "code": code_digest(),
            "host": platform.node(),
            "time": datetime.now(UTC).isoformat(timespec="seconds"),
        }
        self.write_whole(name + INDEX, json.dumps(about, indent=1).encode())

    def get(self, name: str, root: Path) -> list[Path]:
        """Read an object into a folder; return its files, none if there is no such object.

        Raises:
            StoreError: If a file is missing or damaged; names it.
        """
        about = self.index(name)
        if about is None:
            return []
        written: list[Path] = []
        for some in chunks([*about["sha256"]]):
            read = self.read_places([(f"{name}/{inner}", 0, None) for inner in some])
            for inner, data in zip(some, read, strict=True):
                if hashlib.sha256(data).hexdigest() != about["sha256"][inner]:
                    raise StoreError(
                        f"store {self}: {name}/{inner} is damaged; remove {name}{INDEX}"
                    )
                file = root / inner
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(data)
                written.append(file)
        return written


shared: ContextVar[Store | None] = ContextVar("shared", default=None)
"""Store of the running tasks."""


@contextmanager
def sharing(url: str) -> Generator[None]:
    """Let results of the block be shared in a store; in none if the location is empty."""
    token = shared.set(Store(url) if url else None)
    try:
        yield
    finally:
        shared.reset(token)


def fetch(path: Path) -> bool:
    """Read a result of the cache, a folder or a file with companions, from the shared store."""
    store = shared.get()
    if store is None:
        return False
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        files = store.get(_name(path), partial)
        if not files:
            return False
        if (partial / path.name).is_file():  # the file itself comes last: its companions are there
            for file in sorted(files, key=lambda x: x.name == path.name):
                file.replace(path.parent / file.name)
        else:
            shutil.rmtree(path, ignore_errors=True)
            partial.rename(path)
        return True
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def present(path: Path) -> Path:
    """Return a result of the cache, which a worker elsewhere may have made."""
    if not path.exists():
        fetch(path)
    return path


def publish(path: Path) -> None:
    """Write a result of the cache into the shared store."""
    store = shared.get()
    if store is None:
        return
    if path.is_dir():
        store.put(_name(path), path, (x for x in path.rglob("*") if x.is_file()))
    else:
        store.put(_name(path), path.parent, {path, *path.parent.glob(f"{path.stem}.*")})


def _name(path: Path) -> str:
    return f"{path.parent.name}/{path.name}"
