"""Training samples of recordings: images, labels with masks, poses and calibration as arrays."""

import operator
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from driftyard.dataset import Dataset, PathLike, dataset_of
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import DatasetError, FrameIndexError, SettingsError
from vo.recordings.readers import read_frame_times

IMAGES = ("left", "right", "left_next", "right_next")
MASKED = {"disparity": 1, "disparity_right": 1, "depth": 1, "flow": 2, "normals": 3}
"""Labels with unknown pixels, and their channels."""
CODES = ("occlusion", "covisibility", "segmentation", "classes")
POSES = ("T_world_cam", "T_cam_next")
ITEMS = (*IMAGES, *MASKED, *CODES, *POSES, "K", "baseline_m", "timestamp_ns", "sequence")
"""Everything that a sample may hold."""
DEFAULT_ITEMS = ("left", "right", "disparity", "K", "baseline_m", "timestamp_ns")
FORWARD = frozenset({"left_next", "right_next", "flow", "covisibility", "T_cam_next"})
"""Items that need the next frame."""

Datasets = Dataset | PathLike | Sequence[Dataset | PathLike]


@dataclass(frozen=True)
class Samples:
    """Samples of the frames of one or several recordings, read when they are asked for.

    Attributes:
        datasets: The open recordings.
        items: Some of ITEMS.
        channels: Of images: 1, or 3 equal ones.
        as_float: Whether images are float32 from 0 to 1 instead of uint8.
    """

    datasets: tuple[Dataset, ...]
    items: tuple[str, ...]
    channels: int = 1
    as_float: bool = True

    def __post_init__(self) -> None:
        for item in self.items:
            if item not in ITEMS:
                raise SettingsError(f"item {item}: expected {', '.join(ITEMS)}")
        if self.channels not in (1, 3):
            raise SettingsError(f"channels {self.channels}: expected 1 or 3")
        if not self.datasets:
            raise SettingsError("no recordings; expected at least one")
        for dataset in self.datasets:
            self._check(dataset)
        if not len(self):
            raise DatasetError(f"{self.datasets[0].path}: has no frame that is followed by another")

    def _check(self, dataset: Dataset) -> None:
        """Raise a DatasetError if a recording lacks an item, before any is read."""
        labels = {*MASKED, *CODES} & {*self.items}
        if missing := sorted(labels - {*dataset.labels}):
            known = ", ".join(dataset.labels) or "none"
            raise DatasetError(f"{dataset.path}: has no {missing[0]} labels; it has {known}")
        if {*POSES} & {*self.items}:
            _ = dataset.T_world_cam
        if {"flow", "covisibility"} & {*self.items} and dataset.selection.every > 1:
            raise SettingsError(f"{dataset.path}: flow is to the next frame; open it with every=1")

    @cached_property
    def _rows(self) -> Indices:
        """(N, 2) recording and frame of each sample."""
        rows: list[tuple[int, int]] = []
        for k, dataset in enumerate(self.datasets):
            frames = np.arange(len(dataset))
            if FORWARD & {*self.items}:
                frames = frames[:-1][_are_followed(dataset)]
            if {*POSES} & {*self.items}:
                posed: Array = np.all(np.isfinite(dataset.T_world_cam), axis=(1, 2))
                ends = frames + ("T_cam_next" in self.items)
                frames = frames[posed[frames] & posed[ends]]
            rows += [(k, i) for i in frames.tolist()]
        return np.array(rows, dtype=np.int64).reshape(-1, 2)

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, index: int) -> dict[str, Array]:
        """Read a sample: images and labels (C, H, W); a mask NAME_valid beside those that need it.

        Raises:
            FrameIndexError: If there is no such sample.
            ImageError: If a file is damaged.
        """
        row = operator.index(index)
        if not -len(self) <= row < len(self):
            raise FrameIndexError(f"sample {index}: there are {len(self)}")
        k, i = self._rows[row].tolist()
        dataset, sample = self.datasets[k], dict[str, Array]()
        frames = {end: dataset[i + step] for step, end in self._steps}
        for item in self.items:
            if item in IMAGES:
                eye, _, end = item.partition("_")
                sample[item] = self._image(getattr(frames[end], eye))
            elif item in MASKED:
                sample[item], sample[f"{item}_valid"] = _masked(getattr(dataset, item)(i), item)
            elif item in CODES:
                sample[item] = getattr(dataset, item)(i)[None].astype(np.int64)
            else:
                sample[item] = self._other(dataset, k, i, item)
        return sample

    @property
    def _steps(self) -> list[tuple[int, str]]:
        """Frames of which images are needed: step, and end of the names of their items."""
        ends = {x.partition("_")[2] for x in self.items if x in IMAGES}
        return [(step, end) for step, end in enumerate(("", "next")) if end in ends]

    def _image(self, pixels: Array) -> Array:
        image = np.repeat(pixels[None], self.channels, axis=0)
        return image.astype(np.float32) / np.float32(255) if self.as_float else image

    def _other(self, dataset: Dataset, k: int, i: int, item: str) -> Array:
        """Return poses (4, 4), calibration, time and number of the recording."""
        if item == "T_world_cam":
            return dataset.T_world_cam[i].astype(np.float32)
        if item == "T_cam_next":
            T = dataset.T_world_cam
            return (se3.inverse(T[i]) @ T[i + 1]).astype(np.float32)
        if item == "K":
            return dataset.rig.K.astype(np.float32)
        if item == "baseline_m":
            return np.array(dataset.rig.baseline_m, np.float32)
        return np.array(dataset.timestamps_ns[i] if item == "timestamp_ns" else k, np.int64)


def samples_of(
    datasets: Datasets,
    items: Collection[str] = DEFAULT_ITEMS,
    channels: int = 1,
    as_float: bool = True,
) -> Samples:
    """Open recordings and choose the items of their samples.

    Raises:
        DriftyardError: If a recording is invalid or lacks an item, or an item is unknown.
    """
    several = isinstance(datasets, Sequence) and not isinstance(datasets, str)
    many = datasets if several else [datasets]
    chosen = (items,) if isinstance(items, str) else tuple(items)
    return Samples(tuple(dataset_of(x) for x in many), chosen, channels, as_float)


def _masked(label: Array, item: str) -> tuple[Array, Array]:
    """Return a label (C, H, W) float32 with 0 where it is unknown, and the mask (1, H, W)."""
    channels = MASKED[item]
    planes = label[None] if label.ndim == 2 else np.moveaxis(label, -1, 0)[:channels]
    valid: Array = np.all(np.isfinite(planes), axis=0, keepdims=True)
    return np.where(valid, planes, 0).astype(np.float32), valid


def _are_followed(dataset: Dataset) -> Array:
    """Return whether each frame but the last is followed by the recording's next one (N - 1,)."""
    every = np.searchsorted(read_frame_times(dataset.path), dataset.timestamps_ns)
    return np.diff(every) == dataset.selection.every
