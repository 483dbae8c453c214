"""Plausibility: truth, encoders, inertial readings and flow of a folder against each other.

Everything is read back from the files, so that a recording and its verification compute the same.
"""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sim.dataset.sensor_yaml import LABELS, label_file
from sim.labels.labels import flow
from sim.sensors.inertial import GRAVITY_MPS2, ImuReadings, integrate
from sim.settings import RecordSettings
from sim.world.rig import stereo_rig
from sim.world.rover import TRACK_M, WHEEL_RADIUS_M
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.dataset import TRUTH
from vo.contract.files import read_float

SPAN_S = 5.0
"""Inertial readings are integrated over this long from true states."""
DRIFT_MAX_M, TURN_MAX_DEG = 0.01, 0.05
"""What perfect readings may drift over SPAN_S."""
NOISE_DEVIATIONS = 6.0
SLIP_MAX = 0.02
"""Share of the path by which wheels and truth may differ on ground that nobody made slippery."""
FLOW_MAX_PX = 0.01
FLOW_FRAMES = 8


def check_folder(folder: Path, settings: RecordSettings, ended: str) -> dict[str, Any]:
    """Compare what the sensors of a dataset folder say with its truth.

    Args:
        folder: Of the dataset.
        settings: Of the recording.
        ended: Why it ended early; empty if it did not.

    Returns:
        One JSON-ready table for each check, with `passed`; no table where files are missing.
    """
    checks: dict[str, Any] = {"inertial": _check_inertial(folder, settings)}
    if (folder / "mav0/wheels0").is_dir():
        checks["encoders"] = _check_encoders(folder, settings, ended)
    if all((folder / "mav0" / LABELS[name].folder).is_dir() for name in ("flow", "depth")):
        checks["geometry"] = _check_flow(folder, settings)
    return checks


def _read_states(table: Path) -> tuple[Indices, Array, Array]:
    """Times (N,), poses (N, 4, 4) and what follows them (N, 9): velocity and biases."""
    times_ns, values = _read_table(table)
    return times_ns, se3.from_quat_wxyz(values[:, 3:7], values[:, :3]), values[:, 7:]


def _read_table(table: Path) -> tuple[Indices, Array]:
    """Times (N,) int64, too long for a float, and the other columns (N, C)."""
    times_ns = np.loadtxt(table, delimiter=",", usecols=0, dtype=np.int64, ndmin=1)
    return times_ns, np.loadtxt(table, delimiter=",", ndmin=2)[:, 1:]


def _check_inertial(folder: Path, settings: RecordSettings) -> dict[str, Any]:
    """Dead-reckon from true states, span after span; the true biases are taken out first."""
    times_ns, poses, rest = _read_states(folder / "mav0/imu0/truth.csv")
    middles_ns, values = _read_table(folder / "mav0/imu0/data.csv")
    values = values - (rest[:-1, 3:] + rest[1:, 3:]) / 2
    step = max(1, round(SPAN_S * settings.imu.rate_hz))
    starts = range(0, max(1, len(middles_ns) - step + 1), step)
    drift_m, turn_deg = 0.0, 0.0
    for start in starts:
        span = slice(start, start + step)
        readings = ImuReadings(
            middles_ns[span],
            np.diff(times_ns[start : start + step + 1]),
            values[span, :3],
            values[span, 3:],
        )
        reckoned, _ = integrate(readings, poses[start], rest[start, :3], GRAVITY_MPS2)
        error = se3.inverse(poses[start + len(readings.times_ns)]) @ reckoned[-1]
        drift_m = max(drift_m, float(np.linalg.norm(error[:3, 3])))
        turn_deg = max(turn_deg, float(np.degrees(se3.rotation_angle(error))))
    limit_m, limit_deg = _inertial_limits(settings)
    return {
        "about": f"inertial readings less true biases, integrated over {SPAN_S:g} s at a time from "
        "true states",
        "drift_max_m": round(drift_m, 6),
        "turn_max_deg": round(turn_deg, 6),
        "limit_m": round(limit_m, 6),
        "limit_deg": round(limit_deg, 6),
        "passed": drift_m <= limit_m and turn_deg <= limit_deg,
    }


def _inertial_limits(settings: RecordSettings) -> tuple[float, float]:
    """What noise may add: white force noise twice integrated, a tilt by the gyroscope with it."""
    deviations = NOISE_DEVIATIONS * settings.imu.noise
    turn_rad = deviations * settings.imu.gyroscope_noise_density * SPAN_S**0.5
    drift_m = deviations * settings.imu.accelerometer_noise_density * (SPAN_S**3 / 3) ** 0.5
    drift_m += turn_rad * 9.81 * SPAN_S**2 / 2
    return DRIFT_MAX_M + drift_m, TURN_MAX_DEG + float(np.degrees(turn_rad))


def _check_encoders(folder: Path, settings: RecordSettings, ended: str) -> dict[str, Any]:
    """Compare the path that the wheels rolled with the one that the rover went.

    They are free to differ where the ground was made slippery or rough, and after a failure: the
    wheels of a rover that is stuck keep turning.
    """
    wheel_ns, counts = _read_table(folder / "mav0/wheels0/data.csv")
    times_ns, poses, _ = _read_states(folder / TRUTH / "data.csv")
    at_frames = np.stack([np.interp(times_ns, wheel_ns, c) for c in counts.T], axis=1)
    rolled_m = at_frames * 2 * np.pi / settings.encoders.ticks_per_turn * WHEEL_RADIUS_M
    wheels_m = float(np.abs(np.diff(rolled_m.mean(axis=1))).sum())
    moved = np.diff(poses[:, :3, 3], axis=0)
    forward = np.einsum("nij,ni->nj", poses[:-1, :3, :3], moved)[:, 0]
    true_m = float(np.abs(forward).sum())
    turned_rad = float(np.diff(rolled_m[[0, -1]] @ np.array([-1, 1]))[0]) / TRACK_M
    yaw = np.unwrap(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    slip = (wheels_m - true_m) / max(true_m, 1e-9)
    terrain = settings.terrain
    is_rough = terrain.ice_share > 0 or terrain.boxes_per_m > 0
    return {
        "about": "path length by the wheels' turning against the true one",
        "wheels_m": round(wheels_m, 4),
        "true_m": round(true_m, 4),
        "slip_percent": round(100 * slip, 3),
        "turned_deg": round(float(np.degrees(turned_rad)), 2),
        "true_turned_deg": round(float(np.degrees(yaw[-1] - yaw[0])), 2),
        "passed": is_rough or bool(ended) or abs(slip) <= SLIP_MAX,
    }


def _check_flow(folder: Path, settings: RecordSettings) -> dict[str, Any]:
    """Predict the flow of what stands still from depth and poses; a few frames, evenly spread."""
    rig = stereo_rig(settings.rig)
    times_ns, poses, _ = _read_states(folder / TRUTH / "data.csv")
    pairs = list(pairwise(_frame_times(folder, "depth").tolist()))
    chosen = np.linspace(0, len(pairs) - 1, min(FLOW_FRAMES, len(pairs))).astype(int)
    worst_px = 0.0
    for now, following in (pairs[k] for k in chosen):
        T_world_cam = poses[np.searchsorted(times_ns, [now, following])] @ rig.T_body_cam
        depth = read_float(label_file(folder, "depth", now))
        predicted = flow(
            rig,
            depth,
            np.zeros(depth.shape, int),
            (se3.inverse(T_world_cam[1]) @ T_world_cam[0])[None],
        )
        error = np.abs(predicted - read_float(label_file(folder, "flow", now), 3))[..., :2].max(
            axis=-1
        )
        worst_px = max(worst_px, float(np.nanquantile(error, 0.5)))
    return {
        "about": "flow label against depth label and true poses, median of the worst frame",
        "flow_px": round(worst_px, 6),
        "passed": worst_px <= FLOW_MAX_PX,
    }


def _frame_times(folder: Path, label: str) -> Indices:
    table = folder / "mav0" / LABELS[label].folder / "data.csv"
    return np.loadtxt(table, delimiter=",", usecols=0, dtype=np.int64, ndmin=1)
