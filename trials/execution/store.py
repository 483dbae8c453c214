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
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar
from uuid import uuid4

from trials.execution.cache import code_digest
from vo.contract.errors import DriftyardError

INDEX = ".index.json"
AT_ONCE = 64
"""Number of files in one request to the file system, which may send them together."""
T = TypeVar("T")


class StoreError(DriftyardError):
    """A store that cannot be reached, read or written, or an object in it that is damaged."""


@dataclass(frozen=True)
class Store:
    """Location of the objects, as fsspec writes it: a path, `s3://bucket/name`, `sftp://...`."""

    url: str

    @cached_property
    def _place(self) -> tuple[Any, str]:
        """File system and path in it."""
        import fsspec

        with self._stated("cannot be used"):
            system, path = fsspec.core.url_to_fs(self.url)
        return system, path.rstrip("/")

    @contextmanager
    def _stated(self, what: str) -> Generator[None]:
        """State what libraries of file systems raise, which may be anything, in one line."""
        try:
            yield
        except StoreError:
            raise
        except Exception as error:
            reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise StoreError(f"store {self.url}: {what} ({reason.splitlines()[0]})") from error

    def check(self) -> None:
        """Write, read and remove a small object.

        Raises:
            StoreError: If that fails, as without credentials, permission or space.
        """
        system, path = self._place
        probe, data = f"{path}/.probe-{uuid4().hex}", b"driftyard"
        with self._stated("cannot be written"):
            system.makedirs(path, exist_ok=True)
            system.pipe_file(probe, data)
            if system.cat_file(probe) != data:
                raise StoreError(f"store {self.url}: returns other bytes than were written")
            system.rm_file(probe)

    def index(self, name: str) -> dict[str, Any] | None:
        """Return the index of an object; None if it is absent, or was not written to the end."""
        system, path = self._place
        with self._stated(f"{name} cannot be read"):
            try:
                content = json.loads(system.cat_file(f"{path}/{name}{INDEX}"))
                return content if isinstance(content.get("sha256"), dict) else None
            except (FileNotFoundError, ValueError, AttributeError):
                return None

    def put(self, name: str, root: Path, files: Iterable[Path]) -> None:
        """Write files below `root` as an object, unless it is there."""
        if self.index(name) is not None:
            return
        system, path = self._place
        hashes: dict[str, str] = {}
        with self._stated(f"{name} cannot be written"):
            for some in _chunks(sorted(files)):
                read = {x.relative_to(root).as_posix(): x.read_bytes() for x in some}
                hashes |= {inner: hashlib.sha256(data).hexdigest() for inner, data in read.items()}
                targets = {f"{path}/{name}/{inner}": data for inner, data in read.items()}
                for folder in {target.rpartition("/")[0] for target in targets}:
                    system.makedirs(folder, exist_ok=True)
                system.pipe(targets)
            about = {
                "sha256": hashes,
                "code": code_digest(),
                "host": platform.node(),
                "time": datetime.now(UTC).isoformat(timespec="seconds"),
            }
            partial = f"{path}/{name}.{uuid4().hex}"
            system.pipe_file(partial, json.dumps(about, indent=1).encode())
            system.mv(partial, f"{path}/{name}{INDEX}")

    def get(self, name: str, root: Path) -> list[Path]:
        """Read an object into a folder; return its files, none if there is no such object.

        Raises:
            StoreError: If a file is missing or damaged; names it.
        """
        about = self.index(name)
        if about is None:
            return []
        system, path = self._place
        written: list[Path] = []
        for some in _chunks([*about["sha256"]]):
            with self._stated(f"{name} cannot be read"):
                read = system.cat([f"{path}/{name}/{inner}" for inner in some])
            for inner in some:  # they come in any order
                data = read[f"{path}/{name}/{inner}"]
                if hashlib.sha256(data).hexdigest() != about["sha256"][inner]:
                    raise StoreError(
                        f"store {self.url}: {name}/{inner} is damaged; remove {name}{INDEX}"
                    )
                file = root / inner
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(data)
                written.append(file)
        return written


def _chunks(items: Sequence[T]) -> Iterator[Sequence[T]]:
    """Split into parts that a file system reads or writes at once."""
    return (items[k : k + AT_ONCE] for k in range(0, len(items), AT_ONCE))


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
