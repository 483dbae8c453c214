"""A bag: its topics, and its messages by topic and number, of which one is in memory at a time."""

import os
import struct
import weakref
from collections.abc import Collection, Generator, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from vo.contract.arrays import Indices
from vo.contract.errors import DatasetError, ImageError
from vo.contract.remarks import remark

ROS1_SUFFIX, ROS2_SUFFIXES = ".bag", (".mcap", ".db3")
METADATA, METADATA_KEY = "metadata.yaml", "rosbag2_bagfile_information"
OLD_NAMES = {"tf/tfMessage": "tf2_msgs/TFMessage"}
"""Types of messages that have another name since."""
TRANSFORMS = "geometry_msgs/TransformStamped[] transforms"
"""Definition of a message of tf."""
NS_PER_S = 1_000_000_000
MAX_SKIPPED = 16
"""Messages that are passed over to reach a later one; beyond that, the bag is searched."""


def bag_file(path: Path) -> Path | None:
    """Return what holds the messages of a bag at a path; None if there is no bag.

    It is a file, a folder of ROS 2, or the only file in such a folder without its metadata.yaml.
    """
    if path.is_file():
        return path if path.suffix in (ROS1_SUFFIX, *ROS2_SUFFIXES) else None
    if not path.is_dir():
        return None
    metadata = path / METADATA
    if metadata.is_file():
        return path if METADATA_KEY in metadata.read_text(errors="replace") else None
    files = [x for x in sorted(path.iterdir()) if x.suffix in ROS2_SUFFIXES]
    return files[0] if len(files) == 1 else None


@dataclass(frozen=True)
class _Index:
    """Messages of a topic, in the order of the bag.

    Attributes:
        received_ns: (A,) times of receipt.
        stamps_ns: (A,) times of the headers, or of receipt where headers have none.
        rows: (N,) messages in the order of their times, each time once.
    """

    received_ns: Indices
    stamps_ns: Indices
    rows: Indices


class Bag:
    """Messages of a bag by topic, in the order of the times in their headers.

    Files are opened anew in another process, so that processes share no position in a file.

    Attributes:
        path: The file or folder, for messages.
        types: Topic to type of its messages, such as `sensor_msgs/Image`.
    """

    def __init__(self, path: Path, file: Path) -> None:
        """Open the bag.

        Raises:
            DatasetError: If it cannot be read, or the package rosbags is missing.
        """
        self.path, self._file = path, file
        self._is_ros1 = file.suffix == ROS1_SUFFIX and file.is_file()
        self._readers: dict[tuple[int, str], Any] = {}
        self._cursors: dict[tuple[int, str], tuple[int, Iterator[bytes]]] = {}
        self._indices: dict[str, _Index] = {}
        weakref.finalize(self, _close, self._readers)
        try:
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        except ImportError:
            raise DatasetError(
                f"{path}: bags need the package rosbags: pip install 'driftyard[mcap]'"
            ) from None
        self._store = get_typestore(Stores.ROS1_NOETIC if self._is_ros1 else Stores.ROS2_HUMBLE)
        if self._is_ros1:  # the store has no tf2
            self._store.register(get_types_from_msg(TRANSFORMS, "tf2_msgs/msg/TFMessage"))
        with self._faults(DatasetError):
            kinds = {x.topic: x.msgtype.replace("/msg/", "/") for x in self._reader("").connections}
        self.types = {x: OLD_NAMES.get(kind, kind) for x, kind in kinds.items()}

    def times_ns(self, topic: str) -> Indices:
        """Return the increasing times (N,) of the messages of a topic, those of their headers."""
        index = self._index(topic)
        return index.stamps_ns[index.rows]

    def read(self, topic: str, i: int) -> Any:
        """Read message i of a topic, in the order of times.

        Raises:
            ImageError: If it is damaged.
        """
        index = self._index(topic)
        place = int(index.rows[i])
        with self._faults(ImageError, topic):
            data = self._raw(topic, place, index)
            return self._message(topic, data)

    def messages(self, topic: str) -> Generator[Any]:
        """Read all messages of a topic in the order of the bag."""
        with self._faults(DatasetError, topic):
            reader = self._reader("")
            for _, _, data in reader.messages(self._connections(reader, [topic])):
                yield self._message(topic, data)

    def index(self, topics: Collection[str]) -> None:
        """Read the times of all messages of some topics in one pass."""
        new = [x for x in topics if x not in self._indices]
        times: dict[str, list[tuple[int, int]]] = {x: [] for x in new}
        reader = self._reader("")
        connections = self._connections(reader, new)
        with self._faults(DatasetError):
            for connection, received_ns, data in reader.messages(connections) if new else ():
                times[connection.topic].append((received_ns, self._stamp_ns(data)))
        for topic in new:
            expected = sum(x.msgcount for x in connections if x.topic == topic)
            if len(times[topic]) < expected:
                found = f"{len(times[topic])} of {expected} messages"
                remark(f"{self.path}: {topic}: {found} can be read: the bag is damaged")
            self._indices[topic] = self._sorted(topic, times[topic])

    def _index(self, topic: str) -> _Index:
        self.index([topic])
        return self._indices[topic]

    def _sorted(self, topic: str, times: list[tuple[int, int]]) -> _Index:
        received, stamps = np.array(times, dtype=np.int64).reshape(-1, 2).T
        if (stamps <= 0).any():
            remark(f"{self.path}: {topic}: headers without a time; times are those of receipt")
            stamps = received
        _, rows = np.unique(stamps, return_index=True)
        if repeated := len(stamps) - len(rows):
            remark(f"{self.path}: {topic}: {repeated} messages with the time of another, left out")
        return _Index(received, stamps, rows)

    def _raw(self, topic: str, place: int, index: _Index) -> bytes:
        """Read a message by its place in the bag: the next one where that is near, or a search."""
        key = (os.getpid(), topic)
        at, rest = self._cursors.pop(key, (place + 1, iter(())))
        if not 0 <= place - at <= MAX_SKIPPED:
            reader, start = self._reader(topic), index.received_ns[place]
            found = reader.messages(self._connections(reader, [topic]), start=int(start))
            rest = (data for _, _, data in found)
            at = place - int((index.received_ns[:place] >= start).sum())
        for _ in range(place - at):
            next(rest)
        data = next(rest)
        self._cursors[key] = place + 1, rest
        return data

    def _message(self, topic: str, data: bytes) -> Any:
        kind = self.types[topic].replace("/", "/msg/")
        read = self._store.deserialize_ros1 if self._is_ros1 else self._store.deserialize_cdr
        return read(data, kind)

    def _stamp_ns(self, data: bytes) -> int:
        """Read the time of a header, with which the message begins."""
        if self._is_ros1:
            seconds, nanoseconds = struct.unpack_from("<II", data, 4)
        else:
            seconds, nanoseconds = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
        return seconds * NS_PER_S + nanoseconds

    def _reader(self, topic: str) -> Any:
        """Return the reader of this process for a topic, each with a position of its own.

        Of ROS 1, one reader has the decompressed chunk for all topics, and no position.
        """
        key = (os.getpid(), "" if self._is_ros1 else topic)
        if key not in self._readers:
            with self._faults(DatasetError):
                from rosbags import rosbag1, rosbag2

                file = str(self._file)
                reader = rosbag1.Reader(file) if self._is_ros1 else rosbag2.Reader(file)
                reader.open()
                self._readers[key] = reader
        return self._readers[key]

    def _connections(self, reader: Any, topics: Collection[str]) -> list[Any]:
        return [x for x in reader.connections if x.topic in topics]

    @contextmanager
    def _faults(self, kind: type[DatasetError], topic: str = "") -> Generator[None]:
        """State what rosbags raises of damaged bags, which is of many kinds, in one line."""
        try:
            yield
        except DatasetError:
            raise
        except Exception as error:  # also of memory: lengths may be damaged
            place = f"{self.path}: {topic}" if topic else f"{self.path}"
            what = " ".join(str(error).split()) or type(error).__name__
            raise kind(f"{place}: cannot be read ({what})") from error


def open_bag(path: Path, file: Path) -> Bag:
    """Open a bag, once for all that is read from it.

    Raises:
        DatasetError: If it cannot be read, or the package rosbags is missing.
    """
    files = sorted(file.iterdir()) if file.is_dir() else [file]
    return _opened(path, file, tuple((x.stat().st_mtime_ns, x.stat().st_size) for x in files))


@lru_cache(maxsize=4)
def _opened(path: Path, file: Path, _: tuple[tuple[int, int], ...]) -> Bag:
    return Bag(path, file)


def _close(readers: dict[tuple[int, str], Any]) -> None:
    for reader in readers.values():
        with suppress(Exception):
            reader.close()
