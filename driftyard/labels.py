"""Dense labels of the left image of a recording."""

import operator
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

from driftyard.failures import in_one_family
from sim.labels.formats import FORWARD, LABELS, label_file, read_label
from vo.contract.arrays import Array, Indices
from vo.contract.dataset import MANIFEST
from vo.contract.errors import DatasetError, FrameIndexError
from vo.recordings.readers import label_readers

if TYPE_CHECKING:
    from sim.truth.views import FrameViews


@dataclass(frozen=True, repr=False, eq=False)
class DenseLabels(ABC):
    """Labels by name and index of the frame, read when they are asked for.

    A label that the recording does not have raises a DatasetError that says what it has, an index
    beyond the frames a FrameIndexError.

    Attributes:
        path: Folder of the recording.
    """

    path: Path

    @property
    @abstractmethod
    def timestamps_ns(self) -> Indices:
        """(N,) times of the frames, ns."""

    @property
    @abstractmethod
    def views(self) -> "FrameViews":
        """What the left camera sees in each frame, by which motion and boxes are computed."""

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Names of the dense labels that the recording has."""
        return tuple(x for x in LABELS if x in self._readers)

    def depth(self, i: int) -> Array:
        """Return the depth of frame i along the optical axis, float32 metres."""
        return self._label("depth", i)

    def disparity(self, i: int) -> Array:
        """Return the disparity u_left - u_right of frame i, float32 pixels, > 0."""
        return self._label("disparity", i)

    def disparity_right(self, i: int) -> Array:
        """Return the disparity u_left - u_right at the pixels of the right image, float32."""
        return self._label("disparity_right", i)

    def occlusion(self, i: int) -> Array:
        """Return whether the right camera sees each pixel of frame i, uint8 codes; 0 is seen."""
        return self._label("occlusion", i)

    @in_one_family
    def flow(self, i: int, j: int | None = None) -> Array:
        """Return the motion from frame i to frame j: (H, W, 3) float32.

        The channels are du, dv in pixels, and the depth there in metres. Without j, it is the
        label to the next recorded frame, which the last frame of the recording does not have;
        `driftyard.flow` explains that between any two.
        """
        if j is not None:
            return self.views.motion(self.row(i), self.row(j))[0]
        return self._label("flow", i)

    @in_one_family
    def covisibility(self, i: int, j: int | None = None) -> Array:
        """Return whether frame j shows each pixel's point, uint8 codes; j as for `flow`."""
        if j is not None:
            return self.views.motion(self.row(i), self.row(j))[1]
        return self._label("covisibility", i)

    def segmentation(self, i: int) -> Array:
        """Return the object of each pixel, whose name is in `things`; 0 is the sky."""
        return self._label("segmentation", i)

    def classes(self, i: int) -> Array:
        """Return the class of each pixel, uint8: 0 sky, 1 ground, 2 static, 3 moving."""
        return self._label("classes", i)

    def normals(self, i: int) -> Array:
        """Return the surface normals of frame i in camera axes: (H, W, 3) float32."""
        return self._label("normals", i)

    def raw_depth(self, i: int) -> Array:
        """Return the distance along the ray, float32 metres, at the pixels of the raw image."""
        return self._label("raw_depth", i)

    def raw_flow(self, i: int) -> Array:
        """Return the motion of raw pixels to the next frame: (H, W, 3) float32, distance last."""
        return self._label("raw_flow", i)

    def raw_segmentation(self, i: int) -> Array:
        """Return the object of each raw pixel; numbers are those of `segmentation`."""
        return self._label("raw_segmentation", i)

    @property
    def _root(self) -> Path:
        """Folder of `mav0` and the manifest; the recording may be `mav0` itself."""
        return self.path.resolve().parent if (self.path / "cam0").is_dir() else self.path

    @cached_property
    def _readers(self) -> dict[str, Callable[[int], Array]]:
        """Readers of the labels by name; each takes the time of a frame."""
        own = [x for x in LABELS if label_file(self._root, x, 0).parent.is_dir()]
        return {x: partial(read_label, self._root, x) for x in own} or dict(
            label_readers(self.path)
        )

    def row(self, i: int) -> int:
        """Return the index from 0 of frame i, which may count from the end; FrameIndexError."""
        row, frames = operator.index(i), len(self.timestamps_ns)
        if not -frames <= row < frames:
            raise FrameIndexError(f"{self.path}: frame {i}: the frames are 0 to {frames - 1}")
        return row % frames

    def _label(self, name: str, i: int) -> Array:
        row = self.row(i)
        time_ns = int(self.timestamps_ns[row])
        if name not in self.labels:
            known = f", only {', '.join(self.labels)}" if self.labels else ""
            is_own = (self._root / MANIFEST).is_file()
            hint = f"; record it with labels.{name}=true" if is_own else ""
            raise DatasetError(f"{self.path}: has no {name} labels{known}{hint}")
        try:
            return self._readers[name](time_ns)
        except DatasetError as error:
            is_last = row == len(self.timestamps_ns) - 1
            if name in FORWARD and is_last and isinstance(error.__context__, FileNotFoundError):
                raise DatasetError(f"{self.path}: the last frame, {row}, has no {name}") from None
            raise
