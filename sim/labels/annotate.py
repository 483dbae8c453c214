"""Annotation: the dense labels of one frame, computed on request."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scenes.scene import Kind, Thing
from sim.camera.camera import Capture
from sim.labels.formats import FORWARD
from sim.labels.labels import NOTHING, covisibility, disparity_from_depth, flow, normals, occlusion
from sim.settings import LabelSettings
from sim.world.drawn import bodies_of, drawn_objects
from sim.world.world import World
from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask


class Annotator:
    """Body, object and class of all that is drawn, (N + 1,) each, for the true rig; thread-safe.

    The last entry of each table is the sky, whose number is -1; its body is the world. The
    objects are `things` by their number from 1 on; 0 is the sky. Of what is seen through and of
    what deforms, labels that do not hold are NaN, or `NOTHING`.
    """

    def __init__(self, world: World) -> None:
        self.rig = world.rig
        self.body_of = np.append(bodies_of(world.model), 0)
        drawn = drawn_objects(world)
        things = drawn.things
        self.is_unexplained = np.append(drawn.see_through, False)
        self.is_unpredicted = self.is_unexplained | np.append(drawn.deforms, False)
        self.things: Sequence[Thing] = list(dict.fromkeys(things))
        number = {thing: k for k, thing in enumerate(self.things, start=1)}
        self.object_of = np.array([*(number[thing] for thing in things), 0], np.uint16)
        self.kind_of = np.array([*(thing.kind for thing in things), Kind.SKY], np.uint8)

    def annotate(self, capture: Capture, following: Capture | None) -> "Annotation":
        """Return the labels of a frame, given the next frame unless it is the last."""
        return Annotation(self, capture, following)


@dataclass(frozen=True)
class Annotation:
    """The labels of one frame, each computed on first use."""

    annotator: Annotator
    capture: Capture
    following: Capture | None

    def wanted(self, labels: LabelSettings) -> dict[str, Array]:
        """Return the labels that are switched on and exist for this frame, by name."""
        forward = FORWARD if self.following is None else frozenset[str]()
        names = [name for name, is_on in labels if is_on and name not in forward]
        return {name: getattr(self, name) for name in names}

    @property
    def depth(self) -> Array:
        """(H, W) float32 metres."""
        geometry = self.capture.geometry
        return self._without(
            self.annotator.is_unexplained, geometry.geoms_left, geometry.depth_left_m, np.nan
        )

    @cached_property
    def disparity(self) -> Array:
        """(H, W) float32 pixels."""
        return disparity_from_depth(self.annotator.rig, self.depth)

    @cached_property
    def disparity_right(self) -> Array:
        """(H, W) float32 pixels, of the right image."""
        geometry = self.capture.geometry
        unexplained = self.annotator.is_unexplained
        depth = self._without(unexplained, geometry.geoms_right, geometry.depth_right_m, np.nan)
        return disparity_from_depth(self.annotator.rig, depth)

    @cached_property
    def occlusion(self) -> Array:
        """(H, W) uint8."""
        return occlusion(self.annotator.rig, self.depth, self.capture.geometry.depth_right_m)

    @cached_property
    def flow(self) -> Array:
        """(H, W, 3) float32 du, dv, depth in the next frame."""
        now, then = self.capture, self.following
        assert then is not None
        T_body_cam = se3.inverse(now.T_world_bodies) @ now.T_world_cam
        T_next_now = se3.inverse(then.T_world_cam) @ then.T_world_bodies @ T_body_cam  # by body
        bodies = self.annotator.body_of[now.geometry.geoms_left]
        predicted = flow(self.annotator.rig, self.depth, bodies, T_next_now)
        return self._unpredicted(predicted, np.nan)

    @cached_property
    def covisibility(self) -> Array:
        """(H, W) uint8."""
        assert self.following is not None
        found = covisibility(self.flow, self.following.geometry.depth_left_m)
        return self._unpredicted(found, NOTHING)

    @property
    def segmentation(self) -> Array:
        """(H, W) uint16."""
        return self.annotator.object_of[self.capture.geometry.geoms_left]

    @property
    def classes(self) -> Array:
        """(H, W) uint8."""
        return self.annotator.kind_of[self.capture.geometry.geoms_left]

    @cached_property
    def normals(self) -> Array:
        """(H, W, 3) float32, camera axes."""
        return normals(self.annotator.rig, self.depth)

    def _unpredicted(self, label: Array, value: float) -> Array:
        return self._without(
            self.annotator.is_unpredicted, self.capture.geometry.geoms_left, label, value
        )

    @staticmethod
    def _without(table: Mask, numbers: Indices, label: Array, value: float) -> Array:
        """Replace a label by a value at the pixels of the objects in a table."""
        if not table.any() or not (mask := table[numbers]).any():
            return label
        label = label.copy()
        label[mask] = value
        return label
