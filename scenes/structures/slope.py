"""A road that rises to a plateau and falls again along x: height, surface, collision boxes."""

import itertools
from dataclasses import dataclass

import mujoco
import numpy as np

from scenes.geometry.mesh import Mesh, Vector, polygons
from scenes.stage import Stage
from vo.contract.arrays import Array

STEP_M = 0.1
"""Spacing of the knots in the vertical curves; the surface is straight between knots."""
BLEND_M = 0.8
"""Length of the vertical curve at each change of grade."""
THICKNESS_M = 0.3


@dataclass(frozen=True)
class Slope:
    """Height over x, symmetric about the middle of the plateau at x = 0, level at z = 0 outside.

    The knots (K,) are x in metres, increasing multiples of `STEP_M`; the heights (K,) are metres.
    """

    knots: Array
    heights: Array

    @classmethod
    def rising(cls, grade: float, plateau_m: float, run_m: float) -> "Slope":
        """Rise at most by `grade` over `run_m` on both sides of a plateau, without a kink."""
        count = round((plateau_m / 2 + run_m) / STEP_M)
        x = STEP_M * np.arange(-count, 0 + 1)  # one side; the other mirrors it
        along = x - x[0]
        ease = np.minimum(along, run_m - along) / BLEND_M
        steepness = grade * np.clip(ease, 0, 1)
        rise = np.concatenate([[0], np.cumsum((steepness[1:] + steepness[:-1]) / 2 * STEP_M)])
        return cls(np.concatenate([x, -x[-2::-1]]), np.concatenate([rise, rise[-2::-1]]))

    @property
    def top_m(self) -> float:
        """Height of the plateau."""
        return float(self.heights.max())

    def height(self, x: Array) -> Array:
        """Interpolate the height at (...) x, metres."""
        return np.interp(x, self.knots, self.heights)

    def elevation(self, xy: Array) -> Array:
        """Return the height at (..., 2) x, y: the same across the road."""
        return self.height(np.asarray(xy)[..., 0])

    def place(self, xy: Array) -> Array:
        """Lift (..., 2) points onto the road: (..., 3)."""
        return np.concatenate([xy, self.elevation(xy)[..., None]], axis=-1)

    def tilted(self, mesh: Mesh) -> Mesh:
        """Turn the normals of a mesh that lies on the road to the road's own."""
        x = mesh.points[:, 0]
        grade = (self.height(x + STEP_M / 2) - self.height(x - STEP_M / 2)) / STEP_M
        normals = np.column_stack([-grade, np.zeros(len(x)), np.ones(len(x))])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return Mesh(mesh.points, normals, mesh.uv, mesh.faces)

    def beam(self, x: Vector, y: Vector, z: Vector, period_m: float, offset: float = 0.0) -> Mesh:
        """Build a bar along the road between two x, two y and two heights above the road."""
        (y0, y1), (z0, z1) = sorted(y), z
        stations = np.linspace(x[0], x[1], max(2, round((x[1] - x[0]) / (2 * STEP_M)) + 1))
        ground = self.height(stations)
        profile = ((y0, z0), (y0, z1), (y1, z1), (y1, z0))
        edges = [
            np.column_stack([stations, np.full_like(stations, y), ground + z]) for y, z in profile
        ]
        ring = np.stack(edges, axis=1)
        a, b = ring[:-1], ring[1:]
        sides = [np.stack([a[:, k], b[:, k], b[:, k + 1], a[:, k + 1]], axis=1) for k in range(3)]
        corners = np.concatenate([*sides, ring[:1, ::-1], ring[-1:]])
        uv = np.stack([corners[..., 0], -corners[..., 1:].sum(axis=-1)], axis=-1)
        return polygons(corners, uv / period_m + offset)

    def add_collision(self, stage: Stage, half_width_m: float) -> None:
        """Add one tilted collision box for each straight piece of the road."""
        keep = np.concatenate([[True], np.abs(np.diff(self.heights, 2)) > 1e-9, [True]])
        ends = np.column_stack([self.knots[keep], self.heights[keep]])
        for k, (a, b) in enumerate(itertools.pairwise(ends)):
            if a[1] + b[1] == 0:
                continue
            length, pitch = np.hypot(*(b - a)), np.arctan2(b[1] - a[1], b[0] - a[0])
            up = np.array([-np.sin(pitch), 0, np.cos(pitch)])
            middle = np.array([(a[0] + b[0]) / 2, 0, (a[1] + b[1]) / 2])
            size = (length / 2, half_width_m, THICKNESS_M / 2)
            turn = (np.cos(pitch / 2), 0, -np.sin(pitch / 2), 0)
            box, centre = mujoco.mjtGeom.mjGEOM_BOX, middle - up * THICKNESS_M / 2
            stage.collision(f"slope_{k}", box, pos=centre, quat=turn, size=size)
