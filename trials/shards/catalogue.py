"""Which datasets a location holds, and where the bytes of their files are, without reading them.

A dataset is there as a folder whose manifest, which is written last, is complete, or inside tar
files whose index, which is written last, is complete. What an interruption left is not there.
"""

import gzip
import json
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
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
        about: Its manifest, or those ABOUT keys of it.
        files: Where the bytes of each file are, by its path in the folder.
        shards: Tar files of the task that recorded it, which hold it; none of a folder.
    """

    location: Location
    name: str
    about: Mapping[str, Any]
    files: Mapping[str, Place]
    shards: Mapping[str, Shard]

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

    @cached_property
    def members(self) -> Mapping[str, Mapping[int, str]]:
        """Path of each image and label file, by MEMBERS and time, ns."""
        return members_of(self.files)


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
    for path, data in location.read(manifests):
        content = _json(data)
        if content is not None and "schema_version" in content:
            with _checked(location, path, content):
                found.append(_folder_entry(location, path[: -len(MANIFEST) - 1], content))
    listed: set[str] = set()
    for path, data in location.read([x for x in names if x.endswith(INDEX)]):
        content = _unpacked(data)
        if content is None:
            remark(f"{location.url}: {path} is incomplete, its datasets do not count")
            continue
        with _checked(location, path, content):
            shards = {name: Shard(*about) for name, about in content["shards"].items()}
            found += _shard_entries(location, shards, content["datasets"])
        if absent := shards.keys() - {*names}:
            raise StoreError(
                f"store {location.url}: {min(absent)} is missing, though {path} lists it; restore "
                "it, or remove that index to record its datasets again"
            )
        listed |= shards.keys()
    left = [x for x in names if x.endswith(TAR) and x not in listed]
    if left:
        remark(f"{location.url}: {len(left)} tar files without index, as {left[0]}, do not count")
    return {x.name: x for x in sorted(found, key=lambda x: x.name)}


def packed(content: Mapping[str, Any]) -> bytes:
    """Encode an index; equal content gives equal bytes."""
    text = json.dumps({"schema_version": SCHEMA_VERSION, **content}, separators=(",", ":"))
    return gzip.compress(text.encode(), mtime=0)


def _unpacked(data: bytes) -> dict[str, Any] | None:
    """Decode an index; None if it is incomplete."""
    with suppress(OSError, EOFError, ValueError):
        return _json(gzip.decompress(data))
    return None


def _json(data: bytes) -> dict[str, Any] | None:
    with suppress(ValueError):
        content = json.loads(data)
        return content if isinstance(content, dict) else None
    return None


@contextmanager
def _checked(location: Location, path: str, content: Mapping[str, Any]) -> Generator[None]:
    """Raise a StoreError if a manifest or index is of another version, or not as expected."""
    version = content.get("schema_version")
    if version != SCHEMA_VERSION:
        raise StoreError(
            f"store {location.url}: {path} has schema version {version}, this program reads "
            f"{SCHEMA_VERSION}"
        )
    try:
        yield
    except (AttributeError, IndexError, KeyError, TypeError, ValueError):
        raise StoreError(f"store {location.url}: {path} is malformed") from None


def _folder_entry(location: Location, name: str, manifest: dict[str, Any]) -> Entry:
    prefix = f"{name}/" if name else ""
    files = {x: (prefix + x, 0, None) for x in (*manifest["sha256"], MANIFEST)}
    last = location.url.rstrip("/").rpartition("/")[2]
    return Entry(location, name or last, manifest, files, {}).expected()


def _shard_entries(
    location: Location, shards: Mapping[str, Shard], datasets: Mapping[str, Any]
) -> Iterator[Entry]:
    names = list(shards)
    for name, content in datasets.items():
        places = content["files"].items()
        files = {path: (names[k], start, size) for path, (k, start, size) in places}
        used = {x for x, _, _ in files.values()}
        held = {x: shards[x] for x in sorted(used)}
        yield Entry(location, name, content["about"], files, held).expected()
