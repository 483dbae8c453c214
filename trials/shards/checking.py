"""Checksums of datasets in locations: of tar files, and of the files of folders."""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence

from trials.execution.location import Location
from trials.shards.catalogue import Entry, Shard
from vo.contract.dataset import MANIFEST

BLOCK = 8 * 2**20
"""Bytes of a tar file in memory."""


def find_damage(
    entries: Sequence[Entry], progress: Callable[[int, int], None] = lambda done, total: None
) -> Iterator[str]:
    """Read all that datasets consist of; yield what differs from its checksum or is missing.

    Raises:
        StoreError: If a file cannot be read.
    """
    shards = {(x.location, name): shard for x in entries for name, shard in x.shards.items()}
    folders = [x for x in entries if not x.shards]
    total = len(shards) + len(folders)
    for k, ((location, name), shard) in enumerate(shards.items(), start=1):
        if _shard(location, name) != shard:
            yield f"{location}/{name}: differs from its checksum"
        progress(k, total)
    for k, entry in enumerate(folders, start=len(shards) + 1):
        files = entry.files
        (manifest,) = entry.location.read_places([files[MANIFEST]])
        hashes: dict[str, str] = json.loads(manifest)["sha256"]
        names = {files[path][0]: sha256 for path, sha256 in hashes.items()}
        present: set[str] = set()
        for name, data in entry.location.read([*names]):
            present.add(name)
            if hashlib.sha256(data).hexdigest() != names[name]:
                yield f"{entry.location}/{name}: differs from its checksum"
        for name in sorted(names.keys() - present):
            yield f"{entry.location}/{name}: is missing"
        progress(k, total)


def _shard(location: Location, name: str) -> Shard:
    """Read a tar file once, a block at a time."""
    found, size = hashlib.sha256(), 0
    with location.opened(name) as file:
        while block := file.read(BLOCK):
            found.update(block)
            size += len(block)
    return Shard(size, found.hexdigest())
