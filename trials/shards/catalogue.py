"""Which datasets a location holds, and where the bytes of their files are, without reading them.

A dataset is there as a folder whose manifest, which is written last, is complete, or inside tar
files whose index, which is written last, is complete. What an interruption left is not there.
"""

import gzip
import json
import zlib
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple, Self

from sim.labels.formats import LABELS
from trials.execution.location import Location, Place, StoreError
from vo.contract.dataset import DIGEST, MANIFEST, SCHEMA_VERSION
from vo.contract.remarks import remark

INDEX, TAR = ".index.json.gz", ".tar"
"""Ends of the names of indexes and of tar files."""
ABOUT = ("scene", "world", "seed", "settings", "frames", "complete", DIGEST)
"""Keys of the manifest that an index repeats."""
MEMBERS = {
    "left": "cam0",
    "right": "cam1",
    "raw_left": "raw0",
    "raw_right": "raw1",
    **{name: form.folder for name, form in LABELS.items()},
}
"""Images and labels of a frame, and their folders in `mav0`."""
_MEMBER_OF = {folder: name for name, folder in MEMBERS.items()}


class Shard(NamedTuple):
    """Size and SHA-256 of a tar file."""

    size: int
    sha256: str


@dataclass(frozen=True)
class Entry:
    """A complete dataset of a location.

    Attributes:
        location: That holds it.
        name: Of its folder.
        about: What `about` keeps of its manifest.
        shards: Tar files of the task that recorded it, which hold it; none of a folder.
        read_files: What decodes its files.
    """

    location: Location
    name: str
    about: Mapping[str, Any]
    shards: Mapping[str, Shard]
    read_files: Callable[[], dict[str, Place]]

    def expected(self) -> Self:
        """Return it, or raise a KeyError, TypeError or ValueError if it is not as expected."""
        if "/" in self.name or self.name in ("", "..", "."):
            raise ValueError(self.name)
        _ = [*self.scenes, self.seed, self.frames, self.labels, self.is_complete, self.is_certified]
        return self

    @property
    def scenes(self) -> tuple[str, str]:
        """Name of the scene, and its source, such as an MJCF file."""
        return self.about["scene"]["name"], self.about["scene"]["source"]

    @property
    def seed(self) -> int:
        """Random seed."""
        return int(self.about["seed"])

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.about["frames"])

    @property
    def is_complete(self) -> bool:
        """Whether the drive was recorded to its end."""
        return bool(self.about["complete"])

    @property
    def is_certified(self) -> bool:
        """Whether its certificate passed."""
        return bool(self.about["certificate"]["passed"])

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Names of its labels."""
        asked = self.about["settings"]["labels"]
        return tuple(x for x in LABELS if asked.get(x))

    @property
    def files(self) -> dict[str, Place]:
        """Where the bytes of each file are, by its path in the folder; decoded at each call.

        Those of a million frames are gigabytes.

        Raises:
            StoreError: If its index is malformed.
        """
        with _checked(self.location, f"index of {self.name}"):
            return self.read_files()


def members_of(paths: Iterable[str]) -> dict[str, dict[int, str]]:
    """Return those of the files of a dataset that belong to a frame, by MEMBERS and time, ns."""
    found: dict[str, dict[int, str]] = {}
    for path in paths:
        folder, _, file = path.removeprefix("mav0/").partition("/data/")
        time_ns = file.partition(".")[0]
        if folder in _MEMBER_OF and time_ns.isdecimal():
            found.setdefault(_MEMBER_OF[folder], {})[int(time_ns)] = path
    return found


def read_entries(location: Location) -> dict[str, Entry]:
    """Return the datasets of a location by name, in the order of names.

    What is incomplete brings a remark.

    Raises:
        StoreError: If it cannot be read, lacks a tar file, or was written by another version.
    """
    names = location.contents()
    manifests = [f"{x}/{MANIFEST}" for x, may_be_folder in names.items() if may_be_folder]
    if MANIFEST in names:  # it is a dataset itself
        manifests = [MANIFEST]
    found: list[Entry] = []
    for path, data in location.read(list(manifests)):
        content = _json(data)
        if content is not None and "schema_version" in content:
            with _checked(location, path, content):
                found.append(_folder_entry(location, path[: -len(MANIFEST) - 1], content))
            manifests.remove(path)
    if manifests:
        some = f"{len(manifests)} folders without a complete {MANIFEST}"
        first = manifests[0].rpartition("/")[0] or location
        remark(f"{location}: {some}, as {first}, do not count")
    listed: set[str] = set()
    for path, data in location.read([x for x in names if x.endswith(INDEX)]):
        content = _json(_lines(data)[0])
        if content is None:
            remark(f"{location}: {path} is incomplete, its datasets do not count")
            continue
        with _checked(location, path, content):
            shards = {name: Shard(*values) for name, values in content["shards"].items()}
            for row, (name, kept) in enumerate(content["datasets"].items(), start=1):
                read = partial(_shard_files, data, row, list(shards))
                found.append(Entry(location, name, kept, shards, read).expected())
        if absent := shards.keys() - {*names}:
            raise StoreError(
                f"store {location}: {min(absent)} is missing, though {path} lists it; restore "
                "it, or remove that index to record its datasets again"
            )
        listed |= shards.keys()
    left = [x for x in names if x.endswith(TAR) and x not in listed]
    if left:
        remark(f"{location}: {len(left)} tar files without index, as {left[0]}, do not count")
    return {x.name: x for x in sorted(found, key=lambda x: x.name)}


def about(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Return what an index repeats of a manifest: ABOUT, and whether the certificate passed."""
    kept = {key: manifest[key] for key in ABOUT if key in manifest}
    return {**kept, "certificate": {"passed": manifest["certificate"]["passed"]}}


def packed(
    shards: Mapping[str, Shard],
    datasets: Mapping[str, Mapping[str, Any]],
    files: Mapping[str, Mapping[str, tuple[int, int, int]]],
) -> bytes:
    """Encode an index as compressed lines of JSON; equal content gives equal bytes.

    The first has the tar files and `about` of each dataset; those that follow have the files of
    each dataset, as number of the tar file, offset and size.
    """
    head = {"schema_version": SCHEMA_VERSION, "shards": shards, "datasets": datasets}
    lines = [json.dumps(x, separators=(",", ":")) for x in (head, *(files[y] for y in datasets))]
    return gzip.compress("\n".join(lines).encode(), mtime=0)


def _lines(data: bytes) -> list[bytes]:
    """Decompress an index; one empty line if it is incomplete."""
    with suppress(OSError, EOFError, zlib.error):
        return gzip.decompress(data).split(b"\n")
    return [b""]


def _json(data: bytes) -> dict[str, Any] | None:
    with suppress(ValueError):
        content = json.loads(data)
        return content if isinstance(content, dict) else None
    return None


@contextmanager
def _checked(
    location: Location, path: str, content: Mapping[str, Any] | None = None
) -> Generator[None]:
    """Raise a StoreError if a manifest or index is of another version, or not as expected."""
    version = SCHEMA_VERSION if content is None else content.get("schema_version")
    if version != SCHEMA_VERSION:
        raise StoreError(
            f"store {location}: {path} has schema version {version}, this program reads "
            f"{SCHEMA_VERSION}"
        )
    try:
        yield
    except (AttributeError, IndexError, KeyError, TypeError, ValueError):
        raise StoreError(f"store {location}: {path} is malformed") from None


def _folder_entry(location: Location, name: str, manifest: dict[str, Any]) -> Entry:
    prefix = f"{name}/" if name else ""
    paths = zlib.compress("\n".join([*manifest["sha256"], MANIFEST]).encode())
    last = location.url.rstrip("/").rpartition("/")[2]
    read = partial(_folder_files, prefix, paths)
    return Entry(location, name or last, about(manifest), {}, read).expected()


def _folder_files(prefix: str, paths: bytes) -> dict[str, Place]:
    return {x: (prefix + x, 0, None) for x in zlib.decompress(paths).decode().split("\n")}


def _shard_files(data: bytes, row: int, shards: Sequence[str]) -> dict[str, Place]:
    content: dict[str, tuple[int, int, int]] = json.loads(_lines(data)[row])
    return {path: (shards[k], int(start), int(size)) for path, (k, start, size) in content.items()}
