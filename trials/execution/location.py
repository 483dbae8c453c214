"""Locations of files: a folder, or any place that fsspec reaches, such as a bucket."""

import re
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import IO, Any, TypeVar
from uuid import uuid4

from vo.contract.errors import DriftyardError

AT_ONCE = 64
"""Number of files in one request to the file system, which may send them together."""
T = TypeVar("T")

Place = tuple[str, int, int | None]
"""Where bytes are: file of a location, offset, and number; None for the whole file."""


class StoreError(DriftyardError):
    """A store that cannot be reached, read or written, or an object in it that is damaged."""


@dataclass(frozen=True)
class Location:
    """A location as fsspec writes it: a path, `s3://bucket/name`, `sftp://...`.

    Names of files are relative to it, with slashes. Every failure is a StoreError of one line.
    """

    url: str

    def __str__(self) -> str:
        """The location without a password."""
        return re.sub(r"(://[^/@:]*):[^/@]*@", r"\1:***@", self.url)

    @cached_property
    def _place(self) -> tuple[Any, str]:
        """File system and path in it."""
        import fsspec

        with self._stated("cannot be used"):
            system, path = fsspec.core.url_to_fs(self.url)
        return system, path.rstrip("/")

    @property
    def is_bucket(self) -> bool:
        """Whether it has no folders, and files appear whole."""
        return not self._place[1].startswith("/")

    @contextmanager
    def _stated(self, what: str) -> Generator[None]:
        """State what libraries of file systems raise, which may be anything, in one line."""
        try:
            yield
        except StoreError:
            raise
        except Exception as error:
            reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise StoreError(f"store {self}: {what} ({reason.splitlines()[0]})") from error

    def check(self) -> None:
        """Write, read and remove a small file.

        Raises:
            StoreError: If that fails, as without credentials, permission or space.
        """
        system, path = self._place
        name, data = f".probe-{uuid4().hex}", b"driftyard"
        probe = f"{path}/{name}"
        with self._stated("cannot be written"):
            self._make_folders([name])
            system.pipe_file(probe, data)
            if system.cat_file(probe) != data:
                raise StoreError(f"store {self}: returns other bytes than were written")
            system.rm_file(probe)

    def contents(self) -> dict[str, bool]:
        """Return what is directly in it and not hidden, sorted, and whether it may be a folder.

        It is empty if the location does not exist.
        """
        system, path = self._place
        with self._stated("cannot be read"):
            system.invalidate_cache()
            try:
                found = system.ls(path, detail=True)
            except FileNotFoundError:
                return {}
        kinds = {x["name"].rstrip("/").rpartition("/")[2]: x["type"] != "file" for x in found}
        return {x: kinds[x] for x in sorted(kinds) if x and not x.startswith(".")}

    def read(self, names: Sequence[str]) -> Iterator[tuple[str, bytes]]:
        """Yield names and content of files, several at once; those that are missing are left out.

        Raises:
            StoreError: If one cannot be read for another reason.
        """
        for some in chunks(names):
            for name, data in zip(some, self._read([(x, 0, None) for x in some]), strict=True):
                if isinstance(data, bytes):
                    yield name, data
                elif not isinstance(data, FileNotFoundError | NotADirectoryError):
                    with self._stated(f"{name} cannot be read"):
                        raise data

    def read_places(self, places: Sequence[Place]) -> list[bytes]:
        """Return the bytes of places, and read no others.

        Raises:
            StoreError: If a file is missing, too short, or cannot be read; names it.
        """
        found: list[bytes] = []
        for (name, start, size), data in zip(places, self._read(places), strict=True):
            with self._stated(f"{name} cannot be read"):
                if not isinstance(data, bytes):
                    raise data
                if size is not None and len(data) != size:
                    raise StoreError(f"store {self}: {name} ends before byte {start + size}")
            found.append(data)
        return found

    def _read(self, places: Sequence[Place]) -> list[bytes | Exception]:
        system, path = self._place
        files = [f"{path}/{name}" for name, _, _ in places]
        starts = [None if size is None else start for _, start, size in places]
        ends = [None if size is None else start + size for _, start, size in places]
        with self._stated("cannot be read"):
            return system.cat_ranges(files, starts, ends, on_error="return")

    @contextmanager
    def opened(self, name: str) -> Generator[IO[bytes]]:
        """Open a file for reading from its beginning to its end."""
        system, path = self._place
        with self._stated(f"{name} cannot be read"), system.open(f"{path}/{name}") as file:
            yield file

    def write(self, files: Mapping[str, bytes]) -> None:
        """Write files; where they do not appear whole, an interruption may leave a part of one."""
        system, path = self._place
        with self._stated(f"{next(iter(files), '')} cannot be written"):
            self._make_folders(files)
            system.pipe({f"{path}/{name}": data for name, data in files.items()})

    def write_whole(self, name: str, data: bytes) -> None:
        """Write a file that appears whole, or not at all."""
        if self.is_bucket:
            self.write({name: data})
            return
        system, path = self._place
        partial = f"{name}.{uuid4().hex}"
        self.write({partial: data})
        with self._stated(f"{name} cannot be written"):
            system.mv(f"{path}/{partial}", f"{path}/{name}")

    def send(self, file: Path, name: str) -> None:
        """Write a file of this machine, of any size."""
        system, path = self._place
        with self._stated(f"{name} cannot be written"):
            self._make_folders([name])
            system.put_file(str(file), f"{path}/{name}")

    def remove(self, name: str) -> None:
        """Remove a file, or a folder with all that is in it; nothing if it does not exist."""
        system, path = self._place
        with self._stated(f"{name} cannot be replaced"):
            system.invalidate_cache()
            if system.exists(f"{path}/{name}"):
                system.rm(f"{path}/{name}", recursive=True)

    def _make_folders(self, names: Iterable[str]) -> None:
        system, path = self._place
        if not self.is_bucket:  # a bucket has none, and would be made if its name is mistyped
            for folder in {f"{path}/{name}".rpartition("/")[0] for name in names}:
                system.makedirs(folder, exist_ok=True)


def location_of(text: str) -> Location | None:
    """Return the location that an option names; None for a path of this machine."""
    return Location(text) if "://" in text or "::" in text else None


def chunks(items: Sequence[T]) -> Iterator[Sequence[T]]:
    """Split into parts that a file system reads or writes at once."""
    return (items[k : k + AT_ONCE] for k in range(0, len(items), AT_ONCE))
