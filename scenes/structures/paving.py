"""Paving of single bricks: position, settlement and faces of each."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from scenes.geometry.mesh import Mesh, polygons
from vo.contract.arrays import Array, Mask

Bond = Literal["herringbone", "running"]
SKIRT_M = 0.010
"""Depth to which a brick's flanks are drawn below its top."""
BEVEL_M = 0.0025
FOLD_M = 0.006
"""Distance inside the rim from which the texture of the flanks is taken."""
_PAIRS = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])  # corners of a brick along each side


@dataclass(frozen=True)
class Paving:
    """N bricks and their pose.

    Attributes:
        centre: (N, 3) middle of the top face, metres, world.
        half: (N, 2) half length and half width without the joint, metres, in the brick's axes.
        quarter: (N,) whether the brick's length lies along world y instead of x.
        slope: (N, 2) rise of the top face along world x and y, dimensionless and small.
    """

    centre: Array
    half: Array
    quarter: Mask
    slope: Array

    def select(self, keep: Mask) -> "Paving":
        """Keep the bricks of an (N,) mask."""
        return Paving(self.centre[keep], self.half[keep], self.quarter[keep], self.slope[keep])

    @property
    def reach(self) -> Array:
        """(N, 2) half sizes along world x and y, metres."""
        return np.where(self.quarter[:, None], self.half[:, ::-1], self.half)


def lay(
    rng: np.random.Generator,
    cells: tuple[int, int],
    module_m: float,
    gap_m: float,
    height_std_m: float,
    bond: Bond,
) -> Paving:
    """Pave modules of one brick width with its joint, centred on the origin, in a laying pattern.

    The cells are modules along world x and y; a brick covers two, a half brick at the edge one.
    The heights are clipped at twice their standard deviation.
    """
    corner, length, quarter = _pattern(cells, bond)
    size = np.stack([length, np.ones_like(length)], axis=1)
    reach = np.where(quarter[:, None], size[:, ::-1], size)
    middle = (corner + reach / 2 - np.asarray(cells) / 2) * module_m
    half = size * module_m / 2 - gap_m / 2
    height = height_std_m * np.clip(rng.standard_normal(len(middle)), -2, 2)
    slope = 1.5 * height_std_m * np.clip(rng.standard_normal((len(middle), 2)), -2, 2)
    return Paving(np.column_stack([middle, height]), half, quarter, slope)


def _pattern(cells: tuple[int, int], bond: Bond) -> tuple[Array, Array, Mask]:
    """List corner (N, 2), length (N,) in modules and orientation (N,) of the bricks of a bond.

    Herringbone is laid at 90 degrees; of the running bond's rows along x every other one is
    shifted by half a brick.
    """
    i, j = (a.ravel() for a in np.meshgrid(*(np.arange(-1, n) for n in cells), indexing="ij"))
    across = (i - j) % 4 == 3 if bond == "herringbone" else np.zeros(i.shape, dtype=bool)
    starts = across | ((i - j) % 4 == 0) if bond == "herringbone" else (i + j) % 2 == 0
    return _clipped(np.stack([i, j], axis=1)[starts], across[starts], cells)


def _clipped(corner: Array, quarter: Mask, cells: tuple[int, int]) -> tuple[Array, Array, Mask]:
    """Cut bricks at the border to halves, drop those outside."""
    other = corner + np.where(quarter[:, None], [0, 1], [1, 0])
    limit = np.asarray(cells)
    first = np.all((corner >= 0) & (corner < limit), axis=1)
    second = np.all((other >= 0) & (other < limit), axis=1)
    keep = np.logical_or(first, second)
    start = np.where(first[:, None], corner, other)
    return start[keep], (first.astype(float) + second)[keep], quarter[keep]


def brick_tops(
    paving: Paving,
    rects: Array,
    turned: Mask,
    divisions: tuple[int, int] = (1, 1),
    inset_m: float = BEVEL_M,
) -> Mesh:
    """Draw the top faces of N bricks, in quads along length and width, inside their outlines.

    Each shows an atlas cell, (N, 4), with u along its length, of which half bricks use half, and
    is turned by 180 degrees where an (N,) mask says so.
    """
    nu, nv = divisions
    a, b = np.meshgrid(np.linspace(-1, 1, nu + 1), np.linspace(-1, 1, nv + 1), indexing="ij")
    grid = np.stack([a, b], axis=-1)
    quads = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=2)
    plan = quads.reshape(1, nu * nv, 4, 2) * (paving.half - inset_m)[:, None, None]
    world = _in_world(paving, plan, np.zeros(plan.shape[:3]))
    normals = np.broadcast_to(_top_normals(paving)[:, None, None], world.shape)
    return _quads(world, _face_uv(paving, plan, rects, turned), normals)


def brick_flanks(paving: Paving, rects: Array, turned: Mask) -> Mesh:
    """Draw the bevelled flanks between the inset top and SKIRT_M below it; as `brick_tops`."""
    ring = paving.half[:, None] * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    inset = ring - np.sign(ring) * BEVEL_M
    plan = np.concatenate([ring[:, _PAIRS], inset[:, _PAIRS[:, ::-1]]], axis=2)
    drop = np.zeros(plan.shape[:3])
    drop[:, :, :2] = SKIRT_M
    world = _in_world(paving, plan, drop)
    folded = plan.copy()  # shows what lies inside the rim, mirrored: no streaks
    folded[:, :, :2] = (2 * inset - ring - np.sign(ring) * FOLD_M)[:, _PAIRS]
    outward = np.array([[0, -1.0], [1, 0], [0, 1], [-1, 0]])
    along_y = np.stack([-outward[:, 1], outward[:, 0]], axis=-1)
    normals = np.broadcast_to(_top_normals(paving)[:, None, None], world.shape).copy()
    sideways = np.where(paving.quarter[:, None, None], along_y, outward)
    normals[..., :2] += 1.2 * sideways[:, :, None]
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return _quads(world, _face_uv(paving, folded, rects, turned), normals)


def _quads(world: Array, uv: Array, normals: Array) -> Mesh:
    """Join (N, Q, 4, ...) corners of all bricks into one mesh."""
    return polygons(world.reshape(-1, 4, 3), uv.reshape(-1, 4, 2), normals.reshape(-1, 4, 3))


def _in_world(paving: Paving, plan: Array, drop: Array) -> Array:
    """Place (N, Q, 4, 2) points of the brick's axes, `drop` metres below its top face."""
    turned = np.stack([-plan[..., 1], plan[..., 0]], axis=-1)
    xy = np.where(paving.quarter[:, None, None, None], turned, plan)
    rise = (xy * paving.slope[:, None, None]).sum(axis=-1)
    offset = np.concatenate([xy, (rise - drop)[..., None]], axis=-1)
    return paving.centre[:, None, None] + offset


def _face_uv(paving: Paving, plan: Array, rects: Array, turned: Mask) -> Array:
    """Project each brick's atlas cell straight down; the scale is that of a whole brick."""
    whole = paving.half.max(axis=0)
    share = plan / whole / 2 * np.where(turned, -1, 1)[:, None, None, None] + 0.5
    span = (rects[:, 2:] - rects[:, :2])[:, None, None]
    return rects[:, None, None, :2] + share * span


def _top_normals(paving: Paving) -> Array:
    normal = np.column_stack([-paving.slope, np.ones(len(paving.slope))])
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)
