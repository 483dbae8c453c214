"""Dense labels of TartanAir's left images: PNG files of V2, arrays of V1."""

from collections.abc import Callable, Mapping
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from vo.contract.arrays import Array
from vo.contract.errors import ImageError
from vo.recordings.images import read_unchanged
from vo.recordings.rectify import rectify
from vo.recordings.tartanair import (
    frame_number,
    layout_of,
    list_tartanair,
    read_array,
    read_tartanair_cameras,
)

SKY_M = 10_000.0
"""Depth of pixels without a surface."""
FLOW_ZERO, LEVELS_PER_PX = 32768, 64
"""Level of no motion, and levels of one pixel of flow."""
HIDDEN, OUTSIDE, BEYOND = 1, 100, 200
"""Masks of flow: occluded in the next image, outside of it, not representable; 0 is valid."""
COVISIBILITY = {0: 0, HIDDEN: 1, 10: 1, OUTSIDE: 2}
"""Mask of flow to the code of the label covisibility; others are 3, unknown. 10 is V1's mask of
pixels that something in their own image occludes."""


class _Labels:
    """Labels of a folder by time."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.layout = folder, layout_of(folder)

    @cached_property
    def number(self) -> Mapping[int, int]:
        """Time in ns to the number of the frame."""
        files = list_tartanair(self.folder)
        return dict(zip(files.timestamps_ns.tolist(), map(frame_number, files.left), strict=True))

    @cached_property
    def factor(self) -> float:
        """Focal length times baseline, px·m: disparity times depth."""
        rig = rectify(*read_tartanair_cameras(self.folder))[0]
        return rig.f_px * rig.baseline_m

    def file(self, folder: str, time_ns: int, end: str = "") -> Path:
        """Return the file of a frame in a folder of labels, whose name may end in a word."""
        found = (self.folder / folder).glob(f"{self.number[time_ns]:06d}*{end}.*")
        return min(found, default=self.folder / folder / f"{self.number[time_ns]:06d}{end}")

    def depth(self, time_ns: int) -> Array:
        """Return the depth (H, W) float32, metres; NaN without a surface."""
        path = self.file(self.layout.depth, time_ns)
        depth_m = read_array(path) if path.suffix == ".npy" else _encoded_depth(path)
        return np.where(depth_m >= SKY_M, np.nan, depth_m).astype(np.float32)

    def disparity(self, time_ns: int) -> Array:
        """Return the disparity (H, W) float32, px; NaN without a surface."""
        return (self.factor / self.depth(time_ns)).astype(np.float32)

    def flow(self, time_ns: int) -> Array:
        """Return the motion to the next frame: (H, W, 3) float32; its depth there is unknown."""
        flow_px, mask = self._flow(time_ns)
        flow_px = np.where((mask == BEYOND)[..., None], np.nan, flow_px)
        return np.dstack([flow_px, np.full(mask.shape, np.nan)]).astype(np.float32)

    def covisibility(self, time_ns: int) -> Array:
        """Return whether the next frame shows each pixel's point, uint8 codes."""
        codes = np.full(256, 3, np.uint8)
        codes[list(COVISIBILITY)] = list(COVISIBILITY.values())
        return codes[np.minimum(self._flow(time_ns)[1], 255)]

    def segmentation(self, time_ns: int) -> Array:
        """Return the number of each pixel's object, uint8."""
        path = self.file(self.layout.segmentation, time_ns)
        return read_array(path) if path.suffix == ".npy" else read_unchanged(path)

    def _flow(self, time_ns: int) -> tuple[Array, Array]:
        """Return flow (H, W, 2), px, and mask (H, W)."""
        path = self.file(self.layout.flow, time_ns, "_flow")
        if path.suffix == ".npy":
            mask = self.file(self.layout.flow, time_ns, "_mask")
            flow_px = read_array(path)
            return flow_px, read_array(mask) if mask.is_file() else np.zeros(flow_px.shape[:2])
        levels = read_unchanged(path)
        if levels.dtype != np.uint16 or levels.shape[2:] != (3,):
            raise ImageError(f"{path}: expected three channels of 16 bits: u, v, mask")
        return (levels[..., :2].astype(float) - FLOW_ZERO) / LEVELS_PER_PX, levels[..., 2]


def read_tartanair_labels(folder: Path) -> Mapping[str, Callable[[int], Array]]:
    """Return the readers of the labels that a folder has, by name; each takes a time in ns."""
    labels = _Labels(folder)
    layout = labels.layout
    places = {
        layout.depth: ("depth", "disparity"),
        layout.flow: ("flow", "covisibility"),
        layout.segmentation: ("segmentation",),
    }
    names = [x for place, found in places.items() if (folder / place).is_dir() for x in found]
    return {x: partial(getattr(_Labels, x), labels) for x in names}


def _encoded_depth(path: Path) -> Array:
    """Return the depth (H, W) of a PNG of four channels: the bytes of float32."""
    channels = read_unchanged(path)
    if channels.dtype != np.uint8 or channels.shape[2:] != (4,):
        raise ImageError(f"{path}: expected four channels of 8 bits, the bytes of a float")
    return np.ascontiguousarray(channels).view("<f4")[..., 0]
