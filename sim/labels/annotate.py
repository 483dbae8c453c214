"""Annotation: the dense labels of one frame, those that were asked for."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scenes.scene import Thing
from sim.camera.camera import Capture
from sim.labels.labels import class_image, disparity_from_depth, flow, normals, object_image
from sim.labels.visibility import covisibility, occlusion
from sim.settings import LabelSettings
from sim.world.world import World, thing_of
from vo.contract import se3
from vo.contract.arrays import Array, Indices

FORWARD = frozenset({"flow", "covisibility"})
"""Labels that the last frame cannot have."""


class Annotator:
    """Knows what every geom shows; may be used by several threads."""

    def __init__(self, world: World) -> None:
        self.rig = world.rig
        self._body_of = np.append(world.model.geom_bodyid, 0)  # the sky, -1, goes with the world
        things = [thing_of(world, geom) for geom in range(world.model.ngeom)]
        unique = list(dict.fromkeys(things))
        self.things: Sequence[Thing] = unique
        number = {thing: k + 1 for k, thing in enumerate(unique)}
        self._object_of = np.array([number[thing] for thing in things], np.uint16)
        self._kind_of = np.array([thing.kind for thing in things], np.uint8)

    def annotate(self, capture: Capture, following: Capture | None) -> "Annotation":
        """Look at a frame and, unless it is the last, at the one after it."""
        return Annotation(self, capture, following)

    def bodies(self, geoms: Indices) -> Indices:
        """Map (...) geom ids to MuJoCo's bodies."""
        return self._body_of[geoms]

    def objects(self, geoms: Indices) -> Array:
        """Map (...) geom ids to numbers of `things`, counted from 1; 0 is the sky."""
        return object_image(self._object_of, geoms)

    def kinds(self, geoms: Indices) -> Array:
        """Map (...) geom ids to classes."""
        return class_image(self._kind_of, geoms)


@dataclass(frozen=True)
class Annotation:
    """The labels of one frame, each computed when it is first asked for."""

    annotator: Annotator
    capture: Capture
    following: Capture | None

    def wanted(self, labels: LabelSettings) -> dict[str, Array]:
        """Return the labels that were asked for, by name, that this frame can have."""
        forward = FORWARD if self.following is None else frozenset[str]()
        names = [name for name, asked in labels if asked and name not in forward]
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
        """(H, W) float32 pixels, of the right eye."""
        return disparity_from_depth(self.annotator.rig, self.capture.geometry.depth_right_m)

    @cached_property
    def occlusion(self) -> Array:
        """(H, W) uint8."""
        geometry = self.capture.geometry
        return occlusion(self.annotator.rig, geometry.depth_left_m, geometry.depth_right_m)

    @cached_property
    def flow(self) -> Array:
        """(H, W, 3) float32 du, dv, depth in the next frame."""
        assert self.following is not None
        bodies = self.annotator.bodies(self.capture.geometry.geoms_left)
        return flow(self.annotator.rig, self.depth, bodies, self._T_next_now)

    @cached_property
    def covisibility(self) -> Array:
        """(H, W) uint8."""
        assert self.following is not None
        return covisibility(self.flow, self.following.geometry.depth_left_m)

    @property
    def segmentation(self) -> Array:
        """(H, W) uint16."""
        return self.annotator.objects(self.capture.geometry.geoms_left)

    @property
    def classes(self) -> Array:
        """(H, W) uint8."""
        return self.annotator.kinds(self.capture.geometry.geoms_left)

    @cached_property
    def normals(self) -> Array:
        """(H, W, 3) float32, camera axes."""
        return normals(self.annotator.rig, self.depth)

    @property
    def _T_next_now(self) -> Array:
        """(nbody, 4, 4): where a point on each body goes, from camera now to camera then."""
        now, then = self.capture, self.following
        assert then is not None
        T_body_cam = se3.inverse(now.T_world_bodies) @ now.T_world_cam
        return se3.inverse(then.T_world_cam) @ then.T_world_bodies @ T_body_cam
