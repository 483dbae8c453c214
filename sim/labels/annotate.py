"""Annotation: the dense labels of one frame, computed on request."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scenes.scene import Kind, Thing
from sim.camera.camera import Capture
from sim.camera.render import GeometryBuffers
from sim.labels.formats import FORWARD
from sim.labels.labels import disparity_from_depth, normals, occlusion
from sim.labels.raw_labels import raw_depth, raw_flow, raw_numbers
from sim.labels.views import (
    View,
    covisibility_between,
    flow_between,
    masked,
    motions_between,
)
from sim.settings import LabelSettings
from sim.world.drawn import bodies_of, drawn_objects
from sim.world.world import World
from vo.contract.arrays import Array, Indices


class Annotator:
    """Body, object and class of all that is drawn, (N + 1,) each, for the true rig; thread-safe.

    The last entry of each table is the sky, whose number is -1; its body is the world. The
    objects are `things` by their number from 1 on; 0 is the sky. Of what is seen through and of
    what deforms, labels that do not hold are NaN, or `NOTHING`.
    """

    def __init__(self, world: World) -> None:
        self.rig, self.lens = world.rig, world.lens
        self.body_of = np.append(bodies_of(world.model), 0)
        drawn = drawn_objects(world)
        things = drawn.things
        self.is_unexplained = np.append(drawn.see_through, False)
        self.is_unpredicted = self.is_unexplained | np.append(drawn.deforms, False)
        self.things: Sequence[Thing] = list(dict.fromkeys(things))
        number = {thing: k for k, thing in enumerate(self.things, start=1)}
        self.object_of = np.array([*(number[thing] for thing in things), 0], np.uint16)
        self.kind_of = np.array([*(thing.kind for thing in things), Kind.SKY], np.uint8)

    def view(self, geometry: GeometryBuffers, T_world_cam: Array, T_world_bodies: Array) -> View:
        """Return what the left camera sees at an instant."""
        numbers = geometry.geoms_left
        unpredicted = self.is_unpredicted[numbers] if self.is_unpredicted.any() else None
        return View(
            self.rig,
            self.explained(numbers, geometry.depth_left_m),
            geometry.depth_left_m,
            numbers,
            self.body_of,
            self.kind_of,
            unpredicted,
            T_world_cam,
            T_world_bodies,
        )

    def explained(self, numbers: Indices, depth_m: Array) -> Array:
        """Replace depth (H, W) by NaN where what is behind a surface is seen too."""
        if not self.is_unexplained.any():
            return depth_m
        return masked(self.is_unexplained[numbers], depth_m, np.nan)

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

    @cached_property
    def view(self) -> View:
        """What the left camera sees."""
        return _view(self.annotator, self.capture)

    @property
    def depth(self) -> Array:
        """(H, W) float32 metres."""
        geometry = self.capture.geometry
        return self.annotator.explained(geometry.geoms_left, geometry.depth_left_m)

    @cached_property
    def disparity(self) -> Array:
        """(H, W) float32 pixels."""
        return disparity_from_depth(self.annotator.rig, self.depth)

    @cached_property
    def disparity_right(self) -> Array:
        """(H, W) float32 pixels, of the right image."""
        geometry = self.capture.geometry
        depth = self.annotator.explained(geometry.geoms_right, geometry.depth_right_m)
        return disparity_from_depth(self.annotator.rig, depth)

    @cached_property
    def occlusion(self) -> Array:
        """(H, W) uint8."""
        return occlusion(self.annotator.rig, self.depth, self.capture.geometry.depth_right_m)

    @cached_property
    def flow(self) -> Array:
        """(H, W, 3) float32 du, dv, depth in the next frame."""
        assert self.following is not None
        return flow_between(self.view, _view(self.annotator, self.following))

    @cached_property
    def covisibility(self) -> Array:
        """(H, W) uint8."""
        assert self.following is not None
        return covisibility_between(self.flow, self.view, self.following.geometry.depth_left_m)

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

    @cached_property
    def raw_depth(self) -> Array:
        """(H, W) float32 metres along the ray."""
        depth_m, numbers = self._rendered
        return raw_depth(self.annotator.lens.grid, self.annotator.explained(numbers, depth_m))

    @property
    def raw_flow(self) -> Array:
        """(H, W, 3) float32 du, dv, distance in the next frame."""
        assert self.following is not None
        numbers = self._raw_numbers
        T_next_now = motions_between(self.view, _view(self.annotator, self.following))
        bodies = self.annotator.body_of[numbers]
        found = raw_flow(self.annotator.lens, self.raw_depth, bodies, T_next_now)
        return masked(self.annotator.is_unpredicted[numbers], found, np.nan)

    @property
    def raw_segmentation(self) -> Array:
        """(H, W) uint16."""
        return self.annotator.object_of[self._raw_numbers]

    @cached_property
    def _raw_numbers(self) -> Indices:
        """(H, W) what is drawn at each pixel of the raw image."""
        return raw_numbers(self.annotator.lens.grid, self._rendered[1])

    @property
    def _rendered(self) -> tuple[Array, Indices]:
        assert self.capture.raw is not None
        return self.capture.raw


def _view(annotator: Annotator, capture: Capture) -> View:
    return annotator.view(capture.geometry, capture.T_world_cam, capture.T_world_bodies)
