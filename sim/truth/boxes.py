"""Boxes around the objects of an image: in the image, and in the world."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import cv2
import numpy as np

from sim.labels.views import View
from sim.truth.replay import Replay
from sim.world.surfaces import Surface, drawn_surfaces
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

NEAR_M = 0.01
"""Depth in front of which an object is cut off for its box in the image, m."""


@dataclass(frozen=True, repr=False, eq=False)
class Box:
    """Boxes of one object in one frame.

    Boxes in the image are (4,) u_min, v_min, u_max, v_max in pixels; pixel 0 reaches from -0.5 to
    0.5. The box in the world has a vertical axis in the first frame, the smallest area around it,
    and moves with the object.

    Attributes:
        id: Number in the labels of objects.
        name: As in `Dataset.things`.
        kind: `ground`, `static` or `moving`.
        pixels: Number of pixels that show it.
        modal_px: Box around these.
        amodal_px: Box around all of it, as if nothing hid it; not cut off at the image's edge.
        size_m: (3,) side lengths; NaN of sites, of what deforms, and of planes without end.
        T_world_box: (4, 4) centre and axes of the box; so T_cam_box in the left camera.

    Example:
        >>> wall = next(x for x in dy.boxes(ds, 0) if x.name == "east")
        >>> wall.size_m.round(2).tolist(), wall.T_world_box[:3, 3].round(2).tolist()
        ([6.2, 0.1, 0.6], [3.05, 0.0, 0.3])
    """

    id: int
    name: str
    kind: str
    pixels: int
    modal_px: Array
    amodal_px: Array
    size_m: Array
    T_world_box: Array
    T_cam_box: Array

    @property
    def corners_world(self) -> Array:
        """(8, 3) corners in the world, metres."""
        return self._corners(self.T_world_box)

    @property
    def corners_cam(self) -> Array:
        """(8, 3) corners in the left camera, metres."""
        return self._corners(self.T_cam_box)

    def to_dict(self) -> dict[str, Any]:
        """Return all values, ready for JSON; None where they are NaN."""
        values: dict[str, Any] = {}
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                values[name] = None if np.isnan(value).any() else value.tolist()
            else:
                values[name] = value
        return values

    def _corners(self, T_frame_box: Array) -> Array:
        signs = np.array(list(product((-0.5, 0.5), repeat=3)))
        return se3.transform(T_frame_box, signs * self.size_m)

    def __repr__(self) -> str:
        size = " x ".join(f"{x:.2f}" for x in self.size_m)
        return f"Box({self.id} {self.name}, {self.pixels} px, {size} m)"


class BoxFinder:
    """Shapes of the objects of a drive, and boxes around them in any of its frames."""

    def __init__(self, replay: Replay) -> None:
        """Choose the axes of each object's box, at the first frame."""
        self._replay, world = replay, replay.world
        time_ns = int(replay.trip.timestamps_ns[0])
        world.place(time_ns * 1e-9, replay.trip.states.at(world.model, time_ns))
        poses = world.T_world_bodies
        surfaces: dict[str, list[Surface]] = {}
        for surface in drawn_surfaces(world):
            if not surface.is_endless:
                surfaces.setdefault(surface.thing.name, []).append(surface)
        self._shapes: Mapping[str, _Shape] = {
            name: _shape(parts, poses) for name, parts in surfaces.items()
        }

    def boxes(self, view: View) -> list[Box]:
        """Return the boxes of the objects that a view of the drive shows, by their number."""
        annotator = self._replay.annotator
        objects, found = annotator.object_of[view.numbers], list[Box]()
        for number in np.unique(objects[objects > 0]).tolist():
            thing, mask = annotator.things[number - 1], objects == number
            rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
            low, high = (columns[0], rows[0]), (columns[-1], rows[-1])
            modal = np.array([*np.subtract(low, 0.5), *np.add(high, 0.5)])
            shape = self._shapes.get(thing.name)
            spatial = np.full(4, np.nan), np.full(3, np.nan), np.full((4, 4), np.nan)
            amodal, size_m, T_world_box = spatial if shape is None else shape.box(view)
            T_cam_box = se3.inverse(view.T_world_cam) @ T_world_box
            about = number, thing.name, thing.kind.name.lower(), int(mask.sum())
            found.append(Box(*about, modal, amodal, size_m, T_world_box, T_cam_box))
        return found


@dataclass(frozen=True)
class _Shape:
    """Surfaces of an object, and the axes (3, 3) of its box in the body of the first of them."""

    surfaces: Sequence[Surface]
    R_body_box: Array

    def box(self, view: View) -> tuple[Array, Array, Array]:
        """Return the box (4,) in the image, side lengths (3,) and T_world_box (4, 4)."""
        T_world_body = view.T_world_bodies[self.surfaces[0].body]
        R_world_box = T_world_body[:3, :3] @ self.R_body_box
        world = [se3.transform(view.T_world_bodies[x.body], x.vertices) for x in self.surfaces]
        along = np.concatenate(world) @ R_world_box
        low, high = along.min(axis=0), along.max(axis=0)
        T_world_box = se3.pose(R_world_box, R_world_box @ (low + high) / 2)
        T_cam_world = se3.inverse(view.T_world_cam)
        ends = [
            _image_extent(view.rig, se3.transform(T_cam_world, points), surface)
            for points, surface in zip(world, self.surfaces, strict=True)
        ]
        lowest, highest = np.nanmin(ends, axis=0)[:2], np.nanmax(ends, axis=0)[2:]
        return np.concatenate([lowest, highest]), high - low, T_world_box


def _shape(surfaces: Sequence[Surface], T_world_bodies: Array) -> _Shape:
    """Choose the upright box with the smallest base."""
    world = [se3.transform(T_world_bodies[x.body], x.vertices) for x in surfaces]
    base = np.concatenate(world)[:, :2]
    middle = base.mean(axis=0)
    (_, _, angle_deg) = cv2.minAreaRect((base - middle).astype(np.float32))
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    R_world_box = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    return _Shape(surfaces, T_world_bodies[surfaces[0].body, :3, :3].T @ R_world_box)


def _image_extent(rig: StereoRig, points_cam: Array, surface: Surface) -> Array:
    """Return the box (4,) of the part of a surface in front of the camera; NaN without one."""
    ends = points_cam[surface.triangles][:, [(0, 1), (1, 2), (2, 0)]].reshape(-1, 2, 3)
    ahead = ends[..., 2] > NEAR_M
    a, b = ends[ahead[:, 0] != ahead[:, 1]].transpose(1, 0, 2)
    share = (NEAR_M - a[:, 2:]) / (b[:, 2:] - a[:, 2:])
    seen = np.concatenate([points_cam[points_cam[:, 2] > NEAR_M], a + share * (b - a)])
    if not len(seen):
        return np.full(4, np.nan)
    pixels = rig.project(seen)[:, :2]
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
