"""Datasets of a location, or a part of their labels, as folders of this machine."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

from sim.certificate.manifest_check import check_digest
from sim.labels.formats import LABELS
from trials.execution.location import Location, Place, StoreError, chunks
from trials.shards.catalogue import Entry
from vo.contract.dataset import DIGEST, MANIFEST, DatasetWriter, read_manifest
from vo.contract.errors import DatasetError

GAP, AT_MOST = 8 * 2**10, 4 * 2**20
"""Bytes between two files that are read with them, which is faster than two requests, and bytes of
one request for several files."""
DATASETS = 4
"""Datasets that are read at once: small ones wait for answers, not for bytes."""


def fetch_all(entries: Sequence[Entry], labels: Sequence[str] | None, out: Path) -> Iterator[int]:
    """Write datasets as folders in `out`, several at once; yield the bytes that each read.

    Raises:
        DatasetError: As `fetch`; those that have begun are completed before.
        StoreError: The same.
    """
    with ThreadPoolExecutor(DATASETS, "fetch") as pool:
        begun = [pool.submit(fetch, x, labels, out / x.name) for x in entries]
        try:
            for x in begun:
                yield x.result()
        finally:
            pool.shutdown(cancel_futures=True)


def fetch(entry: Entry, labels: Sequence[str] | None, out: Path) -> int:
    """Write a dataset, with these of its labels or all, as the folder `out`; return bytes read.

    Without some of its labels, it is what a recording without them would be: its manifest says
    so, and has the digest of the whole one as `fetched_from`.

    Raises:
        DatasetError: If the folder exists with other content, or the disk is full.
        StoreError: If a file is damaged or cannot be read; names it.
    """
    where = f"{entry.location}: {entry.name}"
    files = entry.files
    if MANIFEST not in files:
        raise StoreError(f"store {where} has no {MANIFEST}")
    (data,) = entry.location.read_places([files[MANIFEST]])
    whole = _manifest(data)
    if whole is None:
        raise StoreError(f"store {where}/{MANIFEST} is damaged: it differs from its own digest")
    left_out = {*entry.labels}.difference(entry.labels if labels is None else labels)
    manifest = _without(whole, left_out)
    if out.exists():
        there = read_manifest(out) if (out / MANIFEST).is_file() else {}
        if _statements(there) != _statements(manifest):
            raise DatasetError(f"{out}: exists with other content; choose another --out")
        return 0
    folders = tuple(f"mav0/{LABELS[x].folder}/" for x in left_out)
    hashes = {path: x for path, x in whole["sha256"].items() if not path.startswith(folders)}
    outside = [x for x in hashes if ".." in x.split("/") or x.startswith("/")]
    if wrong := outside or [*(hashes.keys() - files.keys())]:
        raise StoreError(f"store {where}/{MANIFEST} lists {wrong[0]}, which is not there")
    count = len(data)
    with DatasetWriter(out) as writer:
        for path, content in _read(entry.location, {x: files[x] for x in hashes}):
            if hashlib.sha256(content).hexdigest() != hashes[path]:
                raise StoreError(f"store {where}/{path} is damaged: it differs from its hash")
            writer.add(path, content)
            count += len(content)
        writer.commit(manifest)
    return count


def _manifest(data: bytes) -> dict[str, Any] | None:
    """Decode a manifest; None if it differs from its own digest."""
    with suppress(ValueError, AttributeError, TypeError):
        content = json.loads(data)
        return None if [*check_digest(content)] else content
    return None


def _without(whole: dict[str, Any], left_out: set[str]) -> dict[str, Any]:
    """Return the manifest of a dataset without some labels."""
    if not left_out:
        return whole
    settings = whole["settings"]
    kept = settings["labels"] | dict.fromkeys(left_out, False)
    return {**whole, "settings": {**settings, "labels": kept}, "fetched_from": whole[DIGEST]}


def _statements(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return what a manifest says beside the hashes."""
    return {key: x for key, x in manifest.items() if key not in ("sha256", DIGEST)}


def _read(location: Location, files: Mapping[str, Place]) -> Iterator[tuple[str, bytes]]:
    """Yield files of a dataset, several requests at once."""
    for some in chunks(list(_runs(files))):
        read = location.read_places([place for place, _ in some])
        for ((_, start, _), inside), data in zip(some, read, strict=True):
            for path in inside:
                _, offset, size = files[path]
                yield path, data if size is None else data[offset - start :][:size]


def _runs(files: Mapping[str, Place]) -> Iterator[tuple[Place, list[str]]]:
    """Yield what one request reads, and the files in it, which are near each other."""
    place: Place = ("", 0, 0)
    inside: list[str] = []
    for path in sorted(files, key=lambda x: files[x][:2]):
        name, start, size = files[path]
        grown = start + (size or 0) - place[1]
        if name == place[0] and grown <= AT_MOST and grown - (size or 0) - (place[2] or 0) <= GAP:
            place = (name, place[1], grown)
            inside.append(path)
            continue
        if inside:
            yield place, inside
        place, inside = (name, start, size), [path]
    if inside:
        yield place, inside
