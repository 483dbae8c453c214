"""Check of every row of the true states: poses, velocities, biases and inertial readings agree.

Between two of its rows, the inertial unit's positions follow from its velocities, and its turn and
change of velocity from the reading. The rows of the body are those of the unit, interpolated.
"""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sim.sensors.inertial import T_body_imu
from sim.settings import RecordSettings
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.dataset import TRUTH
from vo.recordings.tables import read_columns

POSITION_M, TURN_RAD, VELOCITY_MPS, BIAS = 2e-4, 2e-4, 2e-3, 1e-7
"""Smallest errors of a row that count. Shocks within an interval of the unit add to them."""
SHOCK_SHARE = 0.5
"""Fraction of the change of velocity around an interval by which it may vary within."""


def read_states(table: Path) -> tuple[Indices, Array, Array]:
    """Return times (N,), poses (N, 4, 4) and velocity and biases (N, 9)."""
    times_ns, values = read_columns(table)
    return times_ns, se3.from_quat_wxyz(values[:, 3:7], values[:, :3]), values[:, 7:]


def check_trajectory(folder: Path, settings: RecordSettings) -> dict[str, Any]:
    """Return the table of the certificate, with the first rows that are wrong."""
    unit_ns, T_world_unit, unit_rest = read_states(folder / "mav0/imu0/truth.csv")
    body_ns, T_world_body, body_rest = read_states(folder / TRUTH / "data.csv")
    dt = np.diff(unit_ns)[:, None] * 1e-9
    position, v = T_world_unit[:, :3, 3], unit_rest[:, :3]
    step = np.diff(position, axis=0) - (v[:-1] + v[1:]) / 2 * dt
    # What changes within an interval is bounded by what changes in it and beside it.
    shock = SHOCK_SHARE * _around(np.linalg.norm(np.diff(v, axis=0), axis=1))
    R = Rotation.from_matrix(T_world_unit[:, :3, :3])
    turn = (R[:-1].inv() * R[1:]).as_rotvec()
    twist = np.linalg.norm(np.diff(turn, axis=0, prepend=turn[:1]), axis=1)
    step_excess = np.linalg.norm(step, axis=1) / (POSITION_M + shock * dt[:, 0])

    k = np.clip(np.searchsorted(unit_ns, body_ns, side="right") - 1, 0, len(dt) - 1)
    share = ((body_ns - unit_ns[k]) * 1e-9 / dt[k, 0])[:, None]
    near = _hermite(position, v, dt, k, share)
    R_near = R[k] * Rotation.from_rotvec(share * turn[k])
    T_unit = T_body_imu(settings.imu)
    T_near = se3.pose(R_near.as_matrix(), near) @ se3.inverse(T_unit)
    gap = se3.inverse(T_near) @ T_world_body
    arm_world = T_near[:, :3, :3] @ T_unit[:3, 3]
    w_world = R_near.apply(turn[k] / dt[k])
    v_near = (1 - share) * v[k] + share * v[k + 1] - np.cross(w_world, arm_world)
    slower = np.linalg.norm(body_rest[:, :3] - v_near, axis=1)
    moved, turned = np.linalg.norm(gap[:, :3, 3], axis=1), se3.rotation_angle(gap)
    spin = _around(twist)[k] / 2
    reach = np.linalg.norm(T_unit[:3, 3])
    position_max = POSITION_M + shock[k] * dt[k, 0] + reach * spin
    velocity_max = VELOCITY_MPS + 2 * shock[k] + 4 * reach * spin / dt[k, 0]
    biases = np.stack([np.interp(body_ns, unit_ns, b) for b in unit_rest[:, 3:].T], axis=1)
    bias_error = np.abs(biases - body_rest[:, 3:]).max(axis=1)
    excess = np.max(
        [
            moved / position_max,
            turned / (TURN_RAD + spin),
            slower / velocity_max,
            bias_error / (BIAS + np.abs(np.diff(unit_rest[:, 3:], axis=0)).max()),
        ],
        axis=0,
    )
    outside = (body_ns < unit_ns[0]) | (body_ns > unit_ns[-1] + np.diff(unit_ns)[-1])
    wrong = [*body_ns[(excess > 1) | outside], *unit_ns[1:][step_excess > 1]]
    return {
        "about": "every true pose, velocity and bias of the body against those of the inertial "
        "unit, and every position of the unit against its velocities",
        "rows": len(body_ns) + len(unit_ns),
        "position_max_m": round(float(moved.max()), 7),
        "turn_max_deg": round(float(np.degrees(turned.max())), 6),
        "velocity_max_mps": round(float(slower.max()), 6),
        "step_max_m": round(float(np.linalg.norm(step, axis=1).max()), 7),
        "failed_rows_ns": [int(x) for x in sorted(wrong)],
        "passed": not wrong,
    }


def _around(values: Array) -> Array:
    """Largest of each value and its two neighbours on each side, (N,)."""
    padded = np.pad(values, 2)
    return np.max([padded[i : i + len(values)] for i in range(5)], axis=0)


def _hermite(position: Array, v: Array, dt: Array, k: Indices, share: Array) -> Array:
    """Interpolate positions (N, 3) within intervals k (N,) by positions and velocities."""
    s, h = share, dt[k]
    start, end = position[k], position[k + 1]
    towards = (2 * s**3 - 3 * s**2 + 1) * start + (3 * s**2 - 2 * s**3) * end
    return towards + (s**3 - 2 * s**2 + s) * h * v[k] + (s**3 - s**2) * h * v[k + 1]
