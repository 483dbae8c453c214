"""Annotation: the dense labels of one frame, computed on request."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scenes.scene import Kind, Thing
from sim.camera.camera import Capture
from sim.labels.labels import covisibility, disparity_from_depth, flow, normals, occlusion
from sim.settings import LabelSettings
from sim.world.world import World, thing_of
from vo.contract import se3
from vo.contract.arrays import Array

FORWARD = frozenset({"flow", "covisibility"})
"""Labels that need the next frame."""


class Annotator:
    """Body, object and class of every geom, (ngeom + 1,) each, for the true rig; thread-safe.

    The last entry of each table is the sky, whose geom id is -1; its body is the world. The
    objects are `things` by their number from 1 on; 0 is the sky.
    """

    def __init__(self, world: World) -> None:
        self.rig = world.rig
        self.body_of = np.append(world.model.geom_bodyid, 0)
        things = [thing_of(world, geom) for geom in range(world.model.ngeom)]
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
        return self.capture.geometry.depth_left_m

    @cached_property
    def disparity(self) -> Array:
        """(H, W) float32 pixels."""
        return disparity_from_depth(self.annotator.rig, self.depth)

    @cached_property
    def disparity_right(self) -> Array:
        """(H, W) float32 pixels, of the right image."""
        return disparity_from_depth(self.annotator.rig, self.capture.geometry.depth_right_m)

    @cached_property
    def occlusion(self) -> Array:
        """(H, W) uint8."""
        geometry = self.capture.geometry
        return occlusion(self.annotator.rig, geometry.depth_left_m, geometry.depth_right_m)

    @cached_property
    def flow(self) -> Array:
        """(H, W, 3) float32 du, dv, depth in the next frame."""
        now, then = self.capture, self.following
        assert then is not None
        T_body_cam = se3.inverse(now.T_world_bodies) @ now.T_world_cam
        T_next_now = se3.inverse(then.T_world_cam) @ then.T_world_bodies @ T_body_cam  # by body
        bodies = self.annotator.body_of[now.geometry.geoms_left]
        return flow(self.annotator.rig, self.depth, bodies, T_next_now)

    @cached_property
    def covisibility(self) -> Array:
        """(H, W) uint8."""
        assert self.following is not None
        return covisibility(self.flow, self.following.geometry.depth_left_m)

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
