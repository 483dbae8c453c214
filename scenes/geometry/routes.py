"""Routes: closed polygons with rounded corners, sampled densely."""

import numpy as np

from vo.contract.arrays import Array


def rounded_loop(corners: Array, radius_m: float, step_m: float = 0.1) -> Array:
    """Round the corners of a closed polygon and sample it.

    Args:
        corners: (K, 2) x, y in driving order, metres, K >= 3; consecutive edges must leave room
            for the arcs. The loop starts in the middle of the edge from the last corner to the
            first.
        radius_m: Radius of every arc.
        step_m: Spacing of the samples, approximately.

    Returns:
        (N, 2) waypoints in metres, the last equal to the first.

    Raises:
        ValueError: If an edge is too short for the arcs at its ends.
    """
    path = [(corners[-1] + corners[0]) / 2]
    before = np.roll(corners, 1, axis=0)
    after = np.roll(corners, -1, axis=0)
    cut = np.array([_cut(*abc, radius_m) for abc in zip(before, corners, after, strict=True)])
    if np.any(cut + np.roll(cut, -1) > np.linalg.norm(after - corners, axis=1)):
        raise ValueError(f"a route edge is too short for arcs of {radius_m} m")
    for a, b, c, length in zip(before, corners, after, cut, strict=True):
        path.extend(_arc(a, b, c, length, radius_m))
    path.append(path[0])
    return resampled(np.array(path), step_m)


def arc_lengths(path: Array) -> Array:
    """Measure the distance along (N, 2) points from the first to each of them: (N,) metres."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def resampled(path: Array, step_m: float) -> Array:
    """Sample (N, 2) a polyline at even spacing near `step_m`, both ends kept."""
    along = arc_lengths(path)
    at = np.linspace(0, along[-1], max(2, round(along[-1] / step_m) + 1))
    return np.stack([np.interp(at, along, path[:, i]) for i in (0, 1)], axis=1)


def route_length(route: Array) -> float:
    """Measure the length of (N, 2) waypoints in metres."""
    return float(np.linalg.norm(np.diff(route, axis=0), axis=1).sum())


def _cut(a: Array, b: Array, c: Array, radius_m: float) -> float:
    """Return the distance from corner b at which its arc begins and ends: r tan(turn / 2)."""
    u, v = b - a, c - b
    turn = np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v)
    return float(radius_m * np.tan(abs(turn) / 2))


def _arc(a: Array, b: Array, c: Array, length: float, radius_m: float) -> list[Array]:
    """Sample the arc of the circle that touches both edges at b, in 3 degree steps."""
    u, v = (b - a) / np.linalg.norm(b - a), (c - b) / np.linalg.norm(c - b)
    turn = np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v)
    if abs(turn) < 1e-6:
        return [b]
    start = b - length * u
    left = np.sign(turn) * np.array([-u[1], u[0]])
    angles = np.linspace(0, abs(turn), max(2, int(np.degrees(abs(turn)) / 3)))
    sine, cosine = np.sin(angles)[:, None], np.cos(angles)[:, None]
    return list(start + radius_m * (sine * u + (1 - cosine) * left))


def sharp_loop(corners: Array, step_m: float = 0.1) -> Array:
    """Sample the closed polygon of (K, 2) corners, each of which stays one of the waypoints.

    Returns:
        (N, 2) waypoints in metres, about `step_m` apart, the last equal to the first, which is the
        middle of the edge from the last corner to the first.
    """
    start = (corners[-1:] + corners[:1]) / 2
    ends = np.concatenate([start, corners, start])
    edges = [resampled(ends[k : k + 2], step_m)[:-1] for k in range(len(ends) - 1)]
    return np.concatenate([*edges, start])
