"""The certificate: photometric residuals summarised, and sensors compared with ground truth.

Sensors are read from the files, so that recording and verification compute the same.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sim.certificate.photometric import BINS_PER_GREY, METHOD, FrameResidual, Residual, quantile
from sim.labels.formats import LABELS, label_file
from sim.labels.labels import flow
from sim.sensors.inertial import GRAVITY_MPS2, ImuReadings, integrate
from sim.settings import RecordSettings
from sim.world.rig import stereo_rig
from sim.world.rover import TRACK_M, WHEEL_RADIUS_M
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.dataset import TRUTH
from vo.contract.images import read_float
from vo.contract.tables import read_columns, read_table

SPAN_S = 5.0
"""Duration of each integration of inertial readings from a true state."""
DRIFT_MAX_M, TURN_MAX_DEG = 0.01, 0.05
"""Largest drift of perfect readings over SPAN_S, in metres and degrees."""
NOISE_DEVIATIONS = 6.0
SLIP_MAX = 0.02
"""Largest relative difference of the path lengths of wheels and truth on ground without ice."""
FLOW_MAX_PX = 0.01
FLOW_FRAMES = 8


def exempt_parts(settings: RecordSettings) -> frozenset[str]:
    """Return the parts that cannot fail, because not all pixels were exposed at one time.

    Labels hold for both cameras at once and for the middle row; the residuals are only reported.
    """
    exposure = settings.exposure
    stereo = {"stereo"} if exposure.right_offset_ms != 0 else set[str]()
    return frozenset(stereo | ({"flow"} if exposure.line_time_us > 0 else set()))


def certify(
    frames: Iterable[FrameResidual], checks: dict[str, Any], exempt: frozenset[str] = frozenset()
) -> dict[str, Any]:
    """Return the manifest's `certificate`: the same images and labels always give the same numbers.

    Checks come from `check_folder`; exempt parts, from `exempt_parts`, cannot fail.
    """
    frames = list(frames)
    stereo = {frame.timestamp_ns: frame.stereo for frame in frames}
    flow = {frame.timestamp_ns: frame.flow for frame in frames if frame.flow is not None}
    parts = {"stereo": _summary(stereo, "stereo" not in exempt)}
    if flow:
        parts["flow"] = _summary(flow, "flow" not in exempt)
    passed = all(part["passed"] for part in [*parts.values(), *checks.values()])
    return {**METHOD, **parts, **checks, "passed": passed}


def _summary(residuals: dict[int, Residual], judged: bool) -> dict[str, Any]:
    total = np.sum([r.histogram for r in residuals.values()], axis=0)
    levels = np.arange(len(total)) / BINS_PER_GREY
    worst_ns, worst = max(residuals.items(), key=lambda item: (item[1].median, -item[0]))
    visible = np.mean([r.visible_fraction for r in residuals.values()])
    failed = [time_ns for time_ns, r in residuals.items() if judged and not r.passed]
    return {
        "median_grey": quantile(total, 0.5),
        "rms_grey": round(float(np.sqrt((total * levels**2).sum() / max(total.sum(), 1))), 4),
        "p95_grey": quantile(total, 0.95),
        "noise_median_grey": _median([r.noise_median for r in residuals.values()]),
        "shifted_median_grey": _median([r.shifted_median for r in residuals.values()]),
        "visible_fraction": round(float(visible), 6),
        "worst_frame_ns": worst_ns,
        "worst_frame_median_grey": worst.median,
        "judged": judged,
        "failed_frames_ns": failed,
        "passed": not failed,
    }


def _median(values: Sequence[float]) -> float:
    return round(float(np.median(values)), 4)


def check_folder(folder: Path, settings: RecordSettings, ended: str) -> dict[str, Any]:
    """Compare the sensors of a dataset folder with its ground truth.

    One JSON-ready table for each check, with `passed`; no table where files are missing.
    """
    checks: dict[str, Any] = {"inertial": _check_inertial(folder, settings)}
    if (folder / "mav0/wheels0").is_dir():
        checks["encoders"] = _check_encoders(folder, settings, ended)
    if all((folder / "mav0" / LABELS[name].folder).is_dir() for name in ("flow", "depth")):
        checks["geometry"] = _check_flow(folder, settings)
    return checks


def _read_states(table: Path) -> tuple[Indices, Array, Array]:
    """Return times (N,), poses (N, 4, 4) and velocity and biases (N, 9)."""
    times_ns, values = read_columns(table)
    return times_ns, se3.from_quat_wxyz(values[:, 3:7], values[:, :3]), values[:, 7:]


def _check_inertial(folder: Path, settings: RecordSettings) -> dict[str, Any]:
    """Integrate readings less true biases from true states, span after span."""
    times_ns, poses, rest = _read_states(folder / "mav0/imu0/truth.csv")
    middles_ns, values = read_columns(folder / "mav0/imu0/data.csv")
    values = values - (rest[:-1, 3:] + rest[1:, 3:]) / 2
    step = max(1, round(SPAN_S * settings.imu.rate_hz))
    starts = range(0, max(1, len(middles_ns) - step + 1), step)
    drift_m, turn_deg = 0.0, 0.0
    for start in starts:
        span = slice(start, start + step)
        intervals_ns = np.diff(times_ns[start : start + step + 1])
        readings = ImuReadings(middles_ns[span], intervals_ns, values[span, :3], values[span, 3:])
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
    """Return the drift from noise: white force noise integrated twice, and gyroscope tilt."""
    deviations = NOISE_DEVIATIONS * settings.imu.noise
    turn_rad = deviations * settings.imu.gyroscope_noise_density * SPAN_S**0.5
    drift_m = deviations * settings.imu.accelerometer_noise_density * (SPAN_S**3 / 3) ** 0.5
    drift_m += turn_rad * 9.81 * SPAN_S**2 / 2
    return DRIFT_MAX_M + drift_m, TURN_MAX_DEG + float(np.degrees(turn_rad))


def _check_encoders(folder: Path, settings: RecordSettings, ended: str) -> dict[str, Any]:
    """Compare the path length of the wheels with that of the rover.

    They may differ on slippery or rough ground, and where the wheels of a stuck rover turn on.
    """
    wheel_ns, counts = read_columns(folder / "mav0/wheels0/data.csv")
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
    """Predict the flow of the static world from depth and poses in a few frames, evenly spaced."""
    rig = stereo_rig(settings.rig)
    times_ns, poses, _ = _read_states(folder / TRUTH / "data.csv")
    labelled = read_table(folder / "mav0" / LABELS["depth"].folder / "data.csv")
    pairs = list(pairwise(int(words[0]) for words in labelled.rows))
    chosen = np.linspace(0, len(pairs) - 1, min(FLOW_FRAMES, len(pairs))).astype(int)
    worst_px = 0.0
    for now, following in (pairs[k] for k in chosen):
        T_world_cam = poses[np.searchsorted(times_ns, [now, following])] @ rig.T_body_cam
        depth = read_float(label_file(folder, "depth", now))
        T_next_now = (se3.inverse(T_world_cam[1]) @ T_world_cam[0])[None]
        predicted = flow(rig, depth, np.zeros(depth.shape, int), T_next_now)
        error = np.abs(predicted - read_float(label_file(folder, "flow", now), 3))
        worst_px = max(worst_px, float(np.nanquantile(error[..., :2].max(axis=-1), 0.5)))
    return {
        "about": "flow label against depth label and true poses, median of the worst frame",
        "flow_px": round(worst_px, 6),
        "passed": worst_px <= FLOW_MAX_PX,
    }
