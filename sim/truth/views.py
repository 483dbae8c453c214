"""Views of the frames of a dataset: from its labels where these suffice, else by a replay."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from scenes.scene import Kind
from sim.labels.views import View, covisibility_between, flow_between
from sim.truth.boxes import Box, BoxFinder
from sim.truth.replay import Replay, recorded_world, replay
from sim.world.world import World
from vo.contract.arrays import Array, Image, Indices
from vo.contract.errors import DatasetError, DriftyardError
from vo.contract.remarks import remark
from vo.contract.rig import StereoRig

VIEWS_KEPT = 4
"""Number of views that stay in memory while they are used."""


@dataclass
class FrameViews:
    """What the left camera sees in each of N frames of a dataset.

    The labels suffice where they have depth, or disparity, and tell by classes or objects which
    pixels do not move. Otherwise the drive is simulated and its geometry rendered again. In
    recordings of other origin, all is taken for static.

    Attributes:
        folder: Of the dataset.
        manifest: Content of dataset.json; empty for recordings of other origin.
        labels: Readers of labels by name; each takes the time of a frame, ns.
        rig: The true camera.
        times_ns: (N,) of the frames.
        T_world_cam: (N, 4, 4) true poses.
    """

    folder: Path
    manifest: Mapping[str, Any]
    labels: Mapping[str, Callable[[int], Array]]
    rig: StereoRig
    times_ns: Indices
    T_world_cam: Array
    _replayed: Callable[[int], View] | None = field(default=None, init=False, repr=False)

    @cached_property
    def replay(self) -> Replay:
        """The drive again; it takes seconds.

        Raises:
            DatasetError: If the drive cannot be repeated.
        """
        with self._repeated():
            return replay(self.manifest, self.times_ns, self.T_world_cam)

    @cached_property
    def world(self) -> World:
        """The world of the drive, at its start; DatasetError if it cannot be built again."""
        with self._repeated():
            return recorded_world(self.manifest)[0]

    @cached_property
    def are_labelled(self) -> bool:
        """Whether labels have the depth and the class of each pixel."""
        if not self.labels.keys() & {"depth", "disparity"}:
            return False
        if not self.manifest:
            remark(f"{self.folder}: nothing tells what moves, so that all is taken for static")
        return not self.manifest or bool(self.labels.keys() & {"classes", "segmentation"})

    def are_static(self, row: int, pixels: Indices | None = None) -> bool:
        """Whether labels tell that pixels (N, 2) of a frame, by default all, are of the world."""
        if not self.are_labelled or (kinds := self._kinds(row)) is None:
            return self.are_labelled
        chosen = kinds if pixels is None else kinds[pixels[:, 1], pixels[:, 0]]
        return not (chosen == Kind.MOVING).any()

    @contextmanager
    def opened(self, replayed: bool) -> Generator[Callable[[int], View]]:
        """Yield a function from the index of a frame to its view, replayed or from labels.

        All that is computed meanwhile from replayed views has one renderer.

        Raises:
            DriftyardError: If the drive cannot be repeated, or there is no OpenGL.
        """
        if not replayed:
            yield lru_cache(VIEWS_KEPT)(self._labelled)
            return
        if self._replayed is not None:
            yield self._replayed
            return
        with self.replay.views() as view:
            self._replayed = lru_cache(VIEWS_KEPT)(lambda row: view(int(self.times_ns[row])))
            try:
                yield self._replayed
            finally:
                self._replayed = None

    def motion(self, i: int, j: int) -> tuple[Array, Image]:
        """Return flow (H, W, 3) from frame i to frame j and covisibility (H, W).

        As `flow_between` and `covisibility_between`; errors are those of `opened`.
        """
        with self.opened(not self.are_static(i)) as view:
            now, then = view(i), view(j)
        flow = flow_between(now, then)
        if i == j:
            flow[..., :2] *= 0  # without rounding errors, which would come beside outlines
        return flow, covisibility_between(flow, now, then.surface_m)

    def boxes(self, row: int) -> list[Box]:
        """Return the boxes of the objects that a frame shows, by their number.

        Raises:
            DriftyardError: If the drive cannot be repeated, or there is no OpenGL.
        """
        with self.opened(replayed=True) as view:
            return self._box_finder.boxes(view(row))

    @cached_property
    def _box_finder(self) -> BoxFinder:
        return BoxFinder(self.replay)

    @contextmanager
    def _repeated(self) -> Generator[None]:
        """Say of errors inside that they keep the drive from being simulated again."""
        if not self.manifest:
            lacks = "" if self.are_labelled else "has no labels of depth, and "
            raise DatasetError(f"{self.folder}: {lacks}is not of driftyard: its world is unknown")
        try:
            yield
        except DriftyardError as error:
            raise DatasetError(
                f"{self.folder}: the drive cannot be simulated again ({error}); static pixels need "
                "no simulation if labels.depth and labels.classes were recorded"
            ) from None

    def _labelled(self, row: int) -> View:
        """Make the view of a frame from its labels, in which all is of one body, the world."""
        kinds, time_ns = self._kinds(row), int(self.times_ns[row])
        if "depth" in self.labels:
            depth_m = self.labels["depth"](time_ns)
        else:
            factor = np.float32(self.rig.f_px * self.rig.baseline_m)
            depth_m = factor / self.labels["disparity"](time_ns)
        no_surface = np.isnan(depth_m)
        unpredicted = no_surface & (kinds != Kind.SKY) if kinds is not None else no_surface
        surfaces = depth_m, depth_m, np.zeros(depth_m.shape, np.int64) if kinds is None else kinds
        bodies, kind_of = np.zeros(len(Kind), np.int64), None if kinds is None else np.array(Kind)
        pose = self.T_world_cam[row], np.eye(4)[None]
        return View(self.rig, *surfaces, bodies, kind_of, unpredicted, *pose)

    def _kinds(self, row: int) -> Array | None:
        """Return the class (H, W) of each pixel, or None if no label has it."""
        time_ns = int(self.times_ns[row])
        if not self.manifest:
            return None
        if "classes" in self.labels:
            return self.labels["classes"](time_ns)
        if "segmentation" in self.labels:
            return self._kind_of[self.labels["segmentation"](time_ns)]
        return None

    @cached_property
    def _kind_of(self) -> Array:
        """Class of each number of an object."""
        things: Sequence[Mapping[str, Any]] = self.manifest["things"]
        kinds = np.zeros(1 + max((x["id"] for x in things), default=0), np.uint8)
        for thing in things:
            kinds[thing["id"]] = Kind[thing["class"].upper()]
        return kinds
