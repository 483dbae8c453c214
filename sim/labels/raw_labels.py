"""Labels of the raw image of a lens: distance along the ray, objects, and optical flow."""

import numpy as np

from sim.imaging.lens import pixel_grid, raw_pixels
from sim.imaging.raw_lens import Grid, RawLens
from sim.labels.labels import nearness_at
from vo.contract.arrays import Array, Indices


def raw_depth(grid: Grid, depth_m: Array) -> Array:
    """Return the distance along the ray (H, W), float32 metres, from the depth that was rendered.

    Between rendered pixels, the surface of the nearest one continues by its slope: exact on planes.
    NaN without a surface, and where the lens has no light.
    """
    lit = np.isfinite(grid.u_px)
    pixels = np.stack([grid.u_px[lit], grid.v_px[lit]], axis=-1)
    out = np.full(lit.shape, np.nan, np.float32)
    near = nearness_at(depth_m, pixels)
    out[lit] = np.where(near > 0, grid.per_depth[lit] / np.where(near > 0, near, 1), np.nan)
    return out


def raw_numbers(grid: Grid, numbers: Indices) -> Indices:
    """Return what the nearest rendered pixel (H', W') shows; -1 where the lens has no light."""
    lit = np.isfinite(grid.u_px)
    out = np.full(lit.shape, -1, numbers.dtype)
    v, u = (np.rint(x[lit]).astype(int) for x in (grid.v_px, grid.u_px))
    out[lit] = numbers[v, u]
    return out


def raw_flow(lens: RawLens, depth_m: Array, bodies: Indices, T_next_now: Array) -> Array:
    """Return du and dv in pixels of the raw image, and distance in metres there, (H, W, 3) float32.

    The depth (H, W) is that of `raw_depth`; without one, a pixel moves as a far point of body 0.
    The motion (B, 4, 4) of each body (H, W) is from the present camera axes to the next. NaN for
    points that leave the lens's field of view; the distance of far points is NaN.
    """
    rays, is_far = lens.grid.rays, np.isnan(depth_m)
    bodies = np.where(is_far, 0, bodies)
    points = np.empty(rays.shape)
    for body in np.unique(bodies):
        at, T = bodies == body, T_next_now[body]
        scale = np.where(is_far[at], 1, depth_m[at])[:, None]
        points[at] = (rays[at] * scale) @ T[:3, :3].T + np.where(is_far[at][:, None], 0, T[:3, 3])
    moved = raw_pixels(lens.settings.sensor, lens.rig, points) - pixel_grid(lens.rig)
    distance = np.where(is_far, np.nan, np.linalg.norm(points, axis=-1))
    return np.concatenate([moved, distance[..., None]], axis=-1).astype(np.float32)
