"""Height, tilt and speed of a camera from the landmarks and the path of a run, without truth."""

import math

import numpy as np

from sim.settings import RigSettings
from trials.realism.camera_estimates import CameraSetting
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

TRIALS = 400
MAX_OFF_PX = 1.0
"""Largest distance in disparity of a point of the ground."""
MIN_SHARE = 0.1
"""Smallest share of the landmarks that the ground holds."""
MAX_ROLL, MAX_TILT_DEG = 0.2, 60.0
FASTEST_MPS = 0.95
"""Speed that the rover reaches with any setting, less a margin: it gets to 0.99 m/s."""
SLOWEST_HZ: float = next(
    x.ge for x in RigSettings.model_fields["rate_hz"].metadata if hasattr(x, "ge")
)
"""Smallest frame rate that is accepted."""
SLOW = 0.02
"""Steps below this share of the largest ones are halts."""


def estimate_ground(points: Array, rig: StereoRig) -> list[CameraSetting]:
    """Estimate height and tilt from the plane below the camera that holds most landmarks.

    A plane is linear in disparity: d = B / h (n_x x + n_y y + n_z) at the ray (x, y, 1), where n is
    its unit normal, B the baseline and h its distance.

    Args:
        points: (N, 3) columns, rows and disparities, px.
        rig: Of the recording.

    Source: Labayrade, Aubert and Tarel, Real time obstacle detection in stereovision on non flat
    road geometry through v-disparity representation, IV 2002; RANSAC by Fischler and Bolles.
    """
    keys = "rig.height_m", "rig.tilt_deg"
    plane = _ground_plane(points, rig)
    if plane is None:
        return [CameraSetting(key, None, note="no level ground is seen") for key in keys]
    size = float(np.linalg.norm(plane))
    tilt_deg = math.degrees(math.asin(plane[2] / size))
    note = "of the plane below the camera that holds most landmarks"
    return [
        CameraSetting(keys[0], round(rig.baseline_m / size, 3), note=note),
        CameraSetting(keys[1], round(tilt_deg, 2), note=note),
    ]


def _ground_plane(points: Array, rig: StereoRig) -> Array | None:
    """Return n B / h (3,) of the ground; None without one."""
    if len(points) < 30:
        return None
    rays = np.column_stack(
        [
            (points[:, 0] - rig.cx_px) / rig.f_px,
            (points[:, 1] - rig.cy_px) / rig.f_px,
            np.ones(len(points)),
        ]
    )
    disparity = points[:, 2] / rig.f_px
    rng = np.random.default_rng(0)
    if len(points) > 20_000:
        some = rng.choice(len(points), 20_000, replace=False)
        rays, disparity = rays[some], disparity[some]
    best: Array | None = None
    most = MIN_SHARE * len(rays)
    for rows in rng.integers(len(rays), size=(TRIALS, 3)):
        if abs(np.linalg.det(rays[rows])) < 1e-6:
            continue
        plane = np.linalg.solve(rays[rows], disparity[rows])
        count = float(_on(plane, rays, disparity, rig).sum()) if _is_level(plane) else 0.0
        if count > most:
            best, most = plane, count
    for _ in range(3 if best is not None else 0):
        rows = _on(best, rays, disparity, rig)  # pyrefly: ignore
        best = np.linalg.lstsq(rays[rows], disparity[rows])[0]
    return best


def _is_level(plane: Array) -> bool:
    across, down, along = plane / np.linalg.norm(plane)
    return bool(
        down > 0 and abs(across) < MAX_ROLL and abs(along) < math.sin(math.radians(MAX_TILT_DEG))
    )


def _on(plane: Array, rays: Array, disparity: Array, rig: StereoRig) -> Array:
    return abs(rays @ plane - disparity) * rig.f_px < MAX_OFF_PX


def estimate_motion(steps_m: Array, period_s: float) -> list[CameraSetting]:
    """Estimate speed and frame rate from the distances (N,) between frames.

    Images tell the distance from frame to frame alone: where the speed is beyond that of the
    simulated carrier, both are lowered by the same factor.
    """
    speed, rate = "drive.speed_mps", "rig.rate_hz"
    if not len(steps_m) or not steps_m.max() > 0:
        return [CameraSetting(rate, round(1 / period_s, 3), note="of the times")]
    step_m = float(np.median(steps_m[steps_m > SLOW * steps_m.max()]))
    wanted = step_m / period_s
    speed_mps = min(wanted, FASTEST_MPS)
    note = "median of the estimated steps"
    if speed_mps < wanted:
        note += f": {wanted:.3g} m/s at {1 / period_s:.3g} Hz, slowed with the frame rate"
    slowed = speed_mps < wanted
    rate_hz = max(speed_mps / step_m if slowed else 1 / period_s, SLOWEST_HZ)
    return [
        CameraSetting(speed, round(max(speed_mps, 0.02), 4), note=note),
        CameraSetting(rate, round(rate_hz, 4), note=note if slowed else "of the times"),
    ]
