"""Local control: pure pursuit (Coulter 1992) and the dynamic window (Fox, Burgard, Thrun 1997)."""

import math
from typing import NamedTuple

import numpy as np
from pydantic import Field

from trials.navigation.occupancy_grid import OccupancyGrid
from vo.contract.arrays import Array
from vo.contract.settings import Settings

PIVOT_RAD = math.radians(60)
"""Angle to the target beyond which the rover turns on the spot."""


class Twist(NamedTuple):
    """Forward speed in m/s and turning speed in rad/s, positive to the left."""

    forward_mps: float
    turn_radps: float


class Pose2(NamedTuple):
    """Position in metres, and heading in radians from x to y."""

    x_m: float
    y_m: float
    yaw_rad: float


class SteeringSettings(Settings):
    """Limits of the rover, and weights of the dynamic window."""

    forward_max_mps: float = Field(default=0.5, gt=0)
    """Largest forward speed, m/s."""
    turn_max_radps: float = Field(default=1.0, gt=0)
    """Largest turning speed, rad/s."""
    forward_accel_mps2: float = Field(default=0.5, gt=0)
    """Largest acceleration and deceleration, m/s^2."""
    turn_accel_radps2: float = Field(default=3.0, gt=0)
    """Largest angular acceleration, rad/s^2."""
    lookahead_m: float = Field(default=0.6, gt=0)
    """Distance of pure pursuit's target along the path, m."""
    period_s: float = Field(default=0.1, gt=0)
    """Time between two commands, s."""
    horizon_s: float = Field(default=1.5, gt=0)
    """Time for which the dynamic window predicts a command, s."""
    speed_samples: int = Field(default=11, ge=3)
    """Samples of each of both speeds."""
    heading_gain: float = Field(default=1.0, ge=0)
    """Weight of the heading, 0 to 1."""
    clearance_gain: float = Field(default=0.3, ge=0)
    """Weight of the clearance, 0 to 1."""
    speed_gain: float = Field(default=0.3, ge=0)
    """Weight of the speed, 0 to 1."""
    max_clearance_m: float = Field(default=0.5, gt=0)
    """Clearance beyond which more does not count, m."""


def lookahead_point(pose: Pose2, path_m: Array, lookahead_m: float) -> Array:
    """Find the point (2,) of a path (N, 2), N >= 1, at a distance along it from the closest point.

    Where the path ends before, its end is returned.
    """
    here = np.array([pose.x_m, pose.y_m])
    if len(path_m) == 1:
        return path_m[0].astype(float)
    a, ab = path_m[:-1], np.diff(path_m, axis=0)
    lengths = np.linalg.norm(ab, axis=1)
    squares = np.where(lengths > 0, lengths**2, 1)
    fraction = np.clip(((here - a) * ab).sum(axis=1) / squares, 0, 1)
    k = int(np.argmin(np.linalg.norm(a + fraction[:, None] * ab - here, axis=1)))
    stations = np.concatenate([[0], np.cumsum(lengths)])
    station = stations[k] + fraction[k] * lengths[k] + lookahead_m
    return np.array([np.interp(station, stations, path_m[:, i]) for i in (0, 1)])


def pure_pursuit(pose: Pose2, path_m: Array, settings: SteeringSettings) -> Twist:
    """Follow a path by the arc through a point ahead; turn on the spot if it is far to the side.

    The path is (N, 2), N >= 1. The arc through (x, y) in the rover's frame has the curvature
    2 y / (x² + y²).
    """
    dx, dy = lookahead_point(pose, path_m, settings.lookahead_m) - pose[:2]
    c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    x_m, y_m = float(c * dx + s * dy), float(-s * dx + c * dy)
    square = x_m**2 + y_m**2
    if square == 0:
        return Twist(0.0, 0.0)
    if abs(math.atan2(y_m, x_m)) > PIVOT_RAD:
        return Twist(0.0, math.copysign(settings.turn_max_radps, y_m))
    curvature = 2 * y_m / square
    # Slower in narrow bends, and before the end, where the target is closer than the lookahead.
    braking_mps = math.sqrt(2 * settings.forward_accel_mps2 * math.sqrt(square))
    turning_mps = settings.turn_max_radps / abs(curvature) if curvature else math.inf
    forward = min(settings.forward_max_mps, braking_mps, turning_mps)
    return Twist(forward, forward * curvature)


def dynamic_window(
    pose: Pose2,
    twist: Twist,
    target_m: Array,
    grid: OccupancyGrid,
    free_m: Array,
    settings: SteeringSettings,
) -> Twist | None:
    """Choose the reachable speeds that head for a target (2,) and keep clear of obstacles.

    Pose and target are in the grid's frame; `twist` are the present speeds. `free_m` (H, W) is the
    distance of each cell from contact, 0 or less where the rover would touch.

    Returns:
        The next speeds; None if the rover could not stop before contact at any of them.
    """
    forward, turn = _window(twist, settings)
    times_s = np.arange(settings.period_s, settings.horizon_s + 1e-9, settings.period_s)
    arcs = _arcs(pose, forward, turn, times_s)
    clear_m = _clearances(arcs, grid, free_m)
    touching = np.pad(clear_m <= 0, ((0, 0), (0, 1)), constant_values=True)
    first = touching.argmax(axis=1)  # one past the last pose, if none touches
    room_m = np.where(first < len(times_s), forward * first * settings.period_s, np.inf)
    admissible = forward <= np.sqrt(2 * settings.forward_accel_mps2 * room_m)
    if not admissible.any():
        return None
    closest_m = np.clip(clear_m.min(axis=1), 0, settings.max_clearance_m)
    # Headings are compared half-way to a close target, which no arc has passed there.
    distance_m = math.hypot(target_m[0] - pose.x_m, target_m[1] - pose.y_m)
    half_way = 0.5 * distance_m / (settings.forward_max_mps * settings.period_s)
    x_m, y_m, yaw_rad = arcs[:, min(int(half_way), len(times_s) - 1)].T
    bearing = np.arctan2(target_m[1] - y_m, target_m[0] - x_m) - yaw_rad
    heading = 1 - np.abs(np.arctan2(np.sin(bearing), np.cos(bearing))) / np.pi
    score = (
        settings.heading_gain * heading
        + settings.clearance_gain * closest_m / settings.max_clearance_m
        + settings.speed_gain * forward / settings.forward_max_mps
    )
    best = int(np.argmax(np.where(admissible, score, -np.inf)))
    return Twist(float(forward[best]), float(turn[best]))


def _window(twist: Twist, settings: SteeringSettings) -> tuple[Array, Array]:
    """Speeds (n,) that can be reached within a period, straight on included if possible."""
    v_step = settings.forward_accel_mps2 * settings.period_s
    w_step = settings.turn_accel_radps2 * settings.period_s
    max_v, max_w = settings.forward_max_mps, settings.turn_max_radps
    reach = np.linspace(-1, 1, settings.speed_samples)
    speeds = np.unique(np.clip(twist.forward_mps + v_step * reach, 0, max_v))
    turns = np.clip(twist.turn_radps + w_step * reach, -max_w, max_w)
    if turns[0] < 0 < turns[-1]:
        turns = np.append(turns, 0.0)
    forward, turn = np.meshgrid(speeds, np.unique(turns))
    return forward.ravel(), turn.ravel()


def _arcs(pose: Pose2, forward: Array, turn: Array, times_s: Array) -> Array:
    """Poses (n, t, 3) on the arcs of constant speeds."""
    angle = turn[:, None] * times_s
    yaw = pose.yaw_rad + angle
    # The chord of an arc: sin(a/2) / (a/2) times its length, at half the angle.
    chord = forward[:, None] * times_s * np.sinc(angle / (2 * np.pi))
    middle = pose.yaw_rad + angle / 2
    return np.stack(
        [pose.x_m + chord * np.cos(middle), pose.y_m + chord * np.sin(middle), yaw], axis=-1
    )


def _clearances(arcs: Array, grid: OccupancyGrid, free_m: Array) -> Array:
    """Distance (n, t) of each pose from contact; infinite outside the grid."""
    cells = np.floor((arcs[..., :2] - np.array(grid.corner_xy_m)) / grid.cell_m + 0.5).astype(int)
    column, row = cells[..., 0], cells[..., 1]
    height, width = free_m.shape
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    found = free_m[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    return np.where(inside, found, np.inf)
