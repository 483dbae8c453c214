"""Datasets written to a location: a folder each, or tar files of several and an index of them.

The tar files are shards of WebDataset: samples `NAME_000000` with `left.png`, `right.png`, labels
and `json`, as `driftyard export --to webdataset` writes them, but each file of the dataset is there
byte by byte. Files that belong to no frame stand below `__NAME__/`, which WebDataset leaves out.
"""

import hashlib
import json
import tarfile
import warnings
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any, Self

from trials.execution.location import Location, chunks
from trials.formats.recording import open_recording
from trials.formats.webdataset import SHARD_BYTES, add_file, metadata
from trials.shards.catalogue import INDEX, MEMBERS, TAR, Shard, about, members_of, packed
from vo.contract.dataset import MANIFEST, read_manifest
from vo.contract.remarks import Remark
from vo.recordings.pairing import ALL_FRAMES


def send_folder(dataset: Path, location: Location, name: str = "") -> None:
    """Write a dataset as a folder of a location, or as the location itself; the manifest last."""
    prefix = f"{name}/" if name else ""
    files = sorted(x for x in dataset.rglob("*") if x.is_file() and x.name != MANIFEST)
    for some in chunks(files):
        location.write({prefix + x.relative_to(dataset).as_posix(): x.read_bytes() for x in some})
    location.write_whole(prefix + MANIFEST, (dataset / MANIFEST).read_bytes())


class ShardWriter:
    """Writer of datasets into tar files NAME-000000.tar of up to SHARD_BYTES and a sample.

    Each tar file is sent to the location when it is full; without `commit`, they do not count.
    """

    def __init__(self, location: Location, name: str, folder: Path) -> None:
        """Prepare to write; the tar file that is not full yet is kept in a folder."""
        self._location, self._name, self._folder = location, name, folder
        self._shards: dict[str, Shard] = {}
        self._datasets: dict[str, dict[str, Any]] = {}
        self._files: dict[str, dict[str, tuple[int, int, int]]] = {}
        self._places: dict[str, tuple[int, int, int]] = {}
        self._tar: tarfile.TarFile | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._tar is not None:
            self._tar.close()

    def add(self, dataset: Path) -> None:
        """Write all files of a dataset, those of each frame one after the other."""
        manifest, name = read_manifest(dataset), dataset.name
        paths = [*manifest["sha256"], MANIFEST]
        frames = members_of(paths)
        others = {*paths}.difference(*(x.values() for x in frames.values()))
        self._places = {}
        self._files[name] = self._places
        for path in sorted(others, key=lambda x: (x != MANIFEST, x)):
            self._add(f"__{name}__/{path}", (dataset / path).read_bytes(), path)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Remark)  # such as that labels are of the true camera
            recording = open_recording(dataset, ALL_FRAMES, False)
        for i, time_ns in enumerate(recording.times_ns):
            sample = f"{name.replace('.', '_')}_{i:06d}"  # a name ends at its first dot
            for member in (x for x in MEMBERS if time_ns in frames.get(x, ())):
                path = frames[member][time_ns]
                entry = f"{sample}.{member}{PurePosixPath(path).suffix}"
                self._add(entry, (dataset / path).read_bytes(), path)
            self._add(f"{sample}.json", json.dumps(metadata(recording, i)).encode())
            if self._tar is not None and self._tar.offset >= SHARD_BYTES:
                self._send()
        self._datasets[name] = about(manifest)

    def commit(self) -> None:
        """Send the last tar file, and the index, with which all of them count."""
        self._send()
        index = packed(self._shards, self._datasets, self._files)
        self._location.write_whole(self._name + INDEX, index)

    def _add(self, name: str, data: bytes, path: str = "") -> None:
        if self._tar is None:
            file = self._folder / f"{self._name}-{len(self._shards):06d}{TAR}"
            self._tar = tarfile.TarFile(file, "w")
        add_file(self._tar, name, data)
        if path:
            padded = -(-len(data) // tarfile.BLOCKSIZE) * tarfile.BLOCKSIZE
            self._places[path] = (len(self._shards), self._tar.offset - padded, len(data))

    def _send(self) -> None:
        if self._tar is None:
            return
        self._tar.close()
        self._tar, file = None, Path(str(self._tar.name))
        with file.open("rb") as data:
            digest = hashlib.file_digest(data, "sha256").hexdigest()
        self._shards[file.name] = Shard(file.stat().st_size, digest)
        self._location.send(file, file.name)
        file.unlink()
