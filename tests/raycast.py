"""A world of planes, boxes and spheres, solved ray by ray: truth to hold dense labels against."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.rig import StereoRig

HIT = 1e-9


@dataclass(frozen=True)
class Ground:
    """The plane z = 0 of its own frame."""

    T_world_own: Array = field(default_factory=lambda: np.eye(4))

    def reach(self, start: Array, ray: Array) -> tuple[Array, Array]:
        """(N,) multiples of the (N, 3) rays and (N, 3) normals, all in its own frame."""
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -start[:, 2] / ray[:, 2]
        return np.where(t > HIT, t, np.inf), np.broadcast_to([0.0, 0.0, 1.0], ray.shape)


@dataclass(frozen=True)
class Box:
    """A box about the origin of its own frame."""

    half_m: tuple[float, float, float]
    T_world_own: Array = field(default_factory=lambda: np.eye(4))

    def reach(self, start: Array, ray: Array) -> tuple[Array, Array]:
        """As of the ground."""
        half = np.array(self.half_m)
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = np.sort(np.stack([(-half - start) / ray, (half - start) / ray]), axis=0)
        t, last = sides[0].max(axis=1), sides[1].min(axis=1)
        normal = np.eye(3)[sides[0].argmax(axis=1)] * -np.sign(ray)
        return np.where((t <= last) & (t > HIT), t, np.inf), normal


@dataclass(frozen=True)
class Ball:
    """A sphere about the origin of its own frame."""

    radius_m: float
    T_world_own: Array = field(default_factory=lambda: np.eye(4))

    def reach(self, start: Array, ray: Array) -> tuple[Array, Array]:
        """As of the ground."""
        a, b = (ray * ray).sum(1), (start * ray).sum(1)
        root = b * b - a * ((start * start).sum(1) - self.radius_m**2)
        t = (-b - np.sqrt(np.maximum(root, 0))) / a
        t = np.where((root >= 0) & (t > HIT), t, np.inf)
        return t, (start + np.where(np.isfinite(t), t, 0)[:, None] * ray) / self.radius_m


Shape = Ground | Box | Ball


def shoot(shapes: Sequence[Shape], start: Array, ray: Array) -> tuple[Array, Indices, Array]:
    """First hits of (N, 3) rays from (N, 3) places in the world.

    Returns:
        (N,) multiples of the rays, inf for none; (N,) shapes, -1 for none; (N, 3) normals.
    """
    t, which = np.full(len(ray), np.inf), np.full(len(ray), -1)
    normal = np.full(ray.shape, np.nan)
    for k, shape in enumerate(shapes):
        T_own_world = se3.inverse(shape.T_world_own)
        R = T_own_world[:3, :3]
        t_k, normal_k = shape.reach(se3.transform(T_own_world, start), ray @ R.T)
        first = t_k < t
        t[first], which[first], normal[first] = t_k[first], k, (normal_k @ R)[first]
    return t, which, normal


@dataclass(frozen=True)
class View:
    """What one eye meets: (H, W) float32 depth with NaN, (H, W) shape or -1, (H, W, 3) normals."""

    depth_m: Array
    shapes: Indices
    normals_cam: Array
    points_world: Array


def look(shapes: Sequence[Shape], rig: StereoRig, T_world_cam: Array) -> View:
    """See a world through a pinhole at exact pixel centres."""
    v, u = np.indices((rig.height_px, rig.width_px)).reshape(2, -1)
    x, y = rig.normalized(np.stack([u, v], axis=-1)).T
    ray = np.stack([x, y, np.ones_like(x)], axis=-1) @ T_world_cam[:3, :3].T
    start = np.broadcast_to(T_world_cam[:3, 3], ray.shape)
    depth, which, normal = shoot(shapes, start, ray)
    depth = np.where(np.isfinite(depth), depth, np.nan)
    size = rig.height_px, rig.width_px
    return View(
        depth.reshape(size).astype(np.float32),
        which.reshape(size),
        (normal @ T_world_cam[:3, :3]).reshape(*size, 3),
        (start + depth[:, None] * ray).reshape(*size, 3),
    )


def sees(shapes: Sequence[Shape], T_world_cam: Array, points_world: Array) -> Mask:
    """Whether nothing stands between a camera's centre and each (..., 3) point."""
    points = points_world.reshape(-1, 3)
    start = np.broadcast_to(T_world_cam[:3, 3], points.shape)
    t, _, _ = shoot(shapes, start, points - start)
    return (t > 1 - 1e-6).reshape(points_world.shape[:-1])
