"""How much the rays to a point differ: what its depth rests on (thesis 4.4)."""

import numpy as np

from vo.bundle_adjustment.problem import Bundle
from vo.contract.arrays import Array, Indices
from vo.contract.compilation import compiled


def parallax_rad(bundle: Bundle, use_disparity: bool = True) -> Array:
    """Largest angle (J,) between two rays to each point, from any eye that measured it.

    Args:
        bundle: Its poses and points are taken as they are.
        use_disparity: Whether a measured disparity counts as a view by the right eye.
    """
    left = bundle.T_world_cam[bundle.camera]
    eyes, point = left[:, :3, 3], bundle.point
    if use_disparity:
        seen = ~np.isnan(bundle.measured[:, 2])
        right = left[seen, :3, 3] + bundle.baseline_m * left[seen, :3, 0]
        eyes, point = np.concatenate([eyes, right]), np.concatenate([point, point[seen]])
    order = np.argsort(point, kind="stable")
    first = np.searchsorted(point[order], np.arange(len(bundle.points_world) + 1))
    return _widest(np.ascontiguousarray(eyes[order]), bundle.points_world, first)


@compiled()
def _widest(eyes: Array, points: Array, first: Indices) -> Array:
    widest = np.zeros(len(points))
    for j in range(len(points)):
        rays = points[j] - eyes[first[j] : first[j + 1]]
        for a in range(len(rays)):
            for b in range(a):
                sine = np.linalg.norm(np.cross(rays[a], rays[b]))
                widest[j] = max(widest[j], np.arctan2(sine, np.dot(rays[a], rays[b])))
    return widest
