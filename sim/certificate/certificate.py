"""The certificate: photometric residuals summarised, and sensors compared with ground truth.

Sensors are read from the files, so that recording and verification compute the same.
"""

from collections.abc import Iterable, Sequence
from functools import reduce
from operator import add
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sim.certificate.bias import DATASET_ERRORS, DATASET_MAX_PX, FRAME_ERRORS
from sim.certificate.highlights import beyond_noise_fraction
from sim.certificate.photometric import BINS_PER_GREY, METHOD, FrameResidual, Residual, quantile
from sim.certificate.trajectory_check import check_trajectory, read_states
from sim.sensors.inertial import ImuReadings, integrate
from sim.settings import RecordSettings
from sim.world.rover import TRACK_M, WHEEL_RADIUS_M
from vo.contract import se3
from vo.contract.arrays import Array, Indices, Mask
from vo.contract.dataset import TRUTH
from vo.recordings.tables import read_columns

SPAN_S = 5.0
"""Duration of each integration of inertial readings from a true state."""
DRIFT_MAX_M, TURN_MAX_DEG = 0.01, 0.05
"""Largest drift of perfect readings over SPAN_S, in metres and degrees."""
NOISE_DEVIATIONS = 6.0
READING_DEVIATIONS = 7.0
"""Norm of three standard normal variables that no reading in ten million exceeds."""
TURN_MIN_RAD, GAIN_MIN_MPS = 1e-6, 1e-6
"""Errors of turn and change of velocity of a perfect reading: biases vary within the interval."""
SLIP_MAX = 0.02
"""Largest relative difference of the path lengths of wheels and truth on ground without ice."""
FLOW_MAX_PX = 0.01
BIAS = "bias_px", "bias_error_px"
TEXTURE_FOUND_PX = 10.0
"""Smallest shift that is found in a frame, pixels, above which it counts as without texture."""
AIM_PX, FRAME_AIM_PX = 0.1, 0.5
"""Shifts over all frames and in one frame that a certificate should find."""
LITTLE_POWER = "little power"
"""Words of the statement on a label of which it finds only larger ones."""


def exempt_parts(settings: RecordSettings) -> frozenset[str]:
    """Return the parts that cannot fail, because not all pixels were exposed at one time.

    Labels hold for both cameras at once and for the middle row; the residuals are only reported.
    Nor do labels hold for dirt on a lens, and for rain.
    """
    if settings.sensor.soiling or settings.weather.rain_mm_h:
        return frozenset({"stereo", "flow"})
    exposure = settings.exposure
    stereo = {"stereo"} if exposure.right_offset_ms != 0 else set[str]()
    return frozenset(stereo | ({"flow"} if exposure.line_time_us > 0 else set()))


def certify(
    frames: Iterable[FrameResidual],
    checks: dict[str, Any],
    exempt: frozenset[str] = frozenset(),
    glossy: bool = False,
) -> dict[str, Any]:
    """Return the manifest's `certificate`: the same images and labels always give the same numbers.

    Checks come from `check_folder`; exempt parts, from `exempt_parts`, cannot fail. Of `glossy`
    surfaces, which look different from each side, the share of pixels beyond the noise is stated.
    """
    frames = list(frames)
    stereo = {frame.timestamp_ns: frame.stereo for frame in frames}
    flow = {frame.timestamp_ns: frame.flow for frame in frames if frame.flow is not None}
    parts: dict[str, Any] = {}
    if stereo:
        parts["stereo"] = _summary(stereo, "stereo" not in exempt, -1.0)
    if flow:
        parts["flow"] = _summary(flow, "flow" not in exempt, 1.0)
    if glossy:
        for name, residuals in (("stereo", stereo), ("flow", flow)):
            if name in parts:
                parts[name]["beyond_noise_fraction"] = beyond_noise_fraction(
                    list(residuals.values())
                )
    geometry = {x.timestamp_ns: x.geometry_px for x in frames if x.geometry_px is not None}
    if geometry:
        parts["geometry"] = _check_flow(geometry)
    passed = all(part["passed"] for part in [*parts.values(), *checks.values()])
    return {**METHOD, **parts, **checks, "passed": passed}


def _summary(residuals: dict[int, Residual], judged: bool, sign: float) -> dict[str, Any]:
    """Summarise one warp; `sign` is that of the label's bias for a shift of the positions."""
    total = np.sum([r.histogram for r in residuals.values()], axis=0)
    levels = np.arange(len(total)) / BINS_PER_GREY
    worst_ns, worst = max(residuals.items(), key=lambda item: (item[1].median, -item[0]))
    visible = np.mean([r.visible_fraction for r in residuals.values()])
    failed = [time_ns for time_ns, r in residuals.items() if judged and not r.passed]
    shifts = _shifts(residuals, sign)
    return {
        "median_grey": quantile(total, 0.5),
        "rms_grey": round(float(np.sqrt((total * levels**2).sum() / max(total.sum(), 1))), 4),
        "p95_grey": quantile(total, 0.95),
        "noise_median_grey": _median([r.noise_median for r in residuals.values()]),
        "shifted_median_grey": _median([r.shifted_median for r in residuals.values()]),
        "visible_fraction": round(float(visible), 6),
        "worst_frame_ns": worst_ns,
        "worst_frame_median_grey": worst.median,
        **shifts,
        "judged": judged,
        "failed_frames_ns": failed,
        "passed": not failed and not (judged and shifts["shifted"]),
    }


def _shifts(residuals: dict[int, Residual], sign: float) -> dict[str, Any]:
    """Return the bias of a label over all frames and in the worst one, and what would be found."""
    total = reduce(add, (r.shift for r in residuals.values()))
    bias, error = total.estimate()
    found = {
        time_ns: r.shift.smallest_found_px(r.shift_max_px, FRAME_ERRORS)
        for time_ns, r in residuals.items()
    }
    textured = {time_ns: x for time_ns, x in found.items() if x <= TEXTURE_FOUND_PX}
    frames = {t: np.abs(residuals[t].shift.estimate()[0]).max() for t in textured}
    worst_ns = max(frames, key=lambda t: frames[t]) if frames else None
    smallest = list(textured.values())
    return {
        "bias_px": [_px(sign * x) for x in bias],
        "bias_error_px": [_px(x) for x in error],
        "smallest_bias_found_px": _px(total.smallest_found_px(DATASET_MAX_PX, DATASET_ERRORS)),
        "worst_frame_bias_ns": worst_ns,
        "worst_frame_bias_px": _px(frames[worst_ns]) if worst_ns is not None else None,
        "smallest_frame_bias_found_px": _px(np.median(smallest)) if smallest else None,
        "smallest_worst_frame_bias_found_px": _px(max(smallest)) if smallest else None,
        "frames_without_texture": len(found) - len(textured),
        "shifted": total.is_found(DATASET_MAX_PX, DATASET_ERRORS),
    }


def detectable_shifts(certificate: dict[str, Any]) -> list[str]:
    """State for each label which shift of it the certificate would have found, a line each."""
    lines: list[str] = []
    for part, label in (("stereo", "disparity"), ("flow", "flow")):
        figures = certificate.get(part, {})
        if figures.get("smallest_bias_found_px") is None:
            lines += (
                [f"{label}: {LITTLE_POWER}, without texture no shift is found"] if figures else []
            )
            continue
        if not figures["judged"]:
            lines.append(f"{label}: not judged: not all pixels show the scene, or at one time")
            continue
        bias, error = (" ".join(f"{x:.3f}" for x in figures[key]) for key in BIAS)
        text = (
            f"{label}: bias {bias} px, standard error {error} px; the smallest shift that is found "
            f"is {figures['smallest_bias_found_px']:.2f} px over all frames"
        )
        in_frame, in_worst = (
            figures[f"smallest_{x}_bias_found_px"] for x in ("frame", "worst_frame")
        )
        if in_frame is not None:
            text += f", and in one frame {in_frame:.2f} px (median), {in_worst:.2f} px (worst)"
        if figures["frames_without_texture"]:
            text += f"; {figures['frames_without_texture']} frames have too little texture"
        if figures["smallest_bias_found_px"] > AIM_PX or (in_frame or np.inf) > FRAME_AIM_PX:
            text += (
                f"; {LITTLE_POWER}: noise, blur or lack of texture hide shifts of {AIM_PX:g} px "
                f"over all frames, or of {FRAME_AIM_PX:g} px in one"
            )
        lines.append(text)
    return lines


def _px(value: float) -> float | None:
    """Round pixels for the manifest; None without texture."""
    return round(float(value), 5) if np.isfinite(value) else None


def _median(values: Sequence[float]) -> float:
    return round(float(np.median(values)), 4)


def check_folder(
    folder: Path, settings: RecordSettings, ended: str, gravity_mps2: Array
) -> dict[str, Any]:
    """Compare the sensors of a dataset folder with its ground truth, under a gravity (3,).

    One JSON-ready table for each check, with `passed`; no table where files are missing.
    """
    checks: dict[str, Any] = {
        "inertial": _check_inertial(folder, settings, gravity_mps2),
        "trajectory": check_trajectory(folder, settings),
    }
    if (folder / "mav0/wheels0").is_dir():
        checks["encoders"] = _check_encoders(folder, settings, ended)
    return checks


def _check_flow(errors_px: dict[int, float]) -> dict[str, Any]:
    """Judge the flow of the static world against depth and poses, in every frame."""
    wrong = [time_ns for time_ns, x in errors_px.items() if x > FLOW_MAX_PX]
    return {
        "about": "flow label against depth label and true poses, median of the worst frame",
        "flow_px": round(float(np.nanmax([0.0, *errors_px.values()])), 6),
        "failed_frames_ns": wrong,
        "passed": not wrong,
    }


def _check_inertial(folder: Path, settings: RecordSettings, gravity_mps2: Array) -> dict[str, Any]:
    """Integrate readings less true biases from true states, span after span."""
    times_ns, poses, rest = read_states(folder / "mav0/imu0/truth.csv")
    middles_ns, values = read_columns(folder / "mav0/imu0/data.csv")
    values = values - (rest[:-1, 3:] + rest[1:, 3:]) / 2
    step = max(1, round(SPAN_S * settings.imu.rate_hz))
    starts = range(0, max(1, len(middles_ns) - step + 1), step)
    drift_m, turn_deg = 0.0, 0.0
    for start in starts:
        span = slice(start, start + step)
        intervals_ns = np.diff(times_ns[start : start + step + 1])
        readings = ImuReadings(middles_ns[span], intervals_ns, values[span, :3], values[span, 3:])
        reckoned, _ = integrate(readings, poses[start], rest[start, :3], gravity_mps2)
        error = se3.inverse(poses[start + len(readings.times_ns)]) @ reckoned[-1]
        drift_m = max(drift_m, float(np.linalg.norm(error[:3, 3])))
        turn_deg = max(turn_deg, float(np.degrees(se3.rotation_angle(error))))
    limit_m, limit_deg = _inertial_limits(settings, gravity_mps2)
    gain = np.diff(rest[:, :3], axis=0) - gravity_mps2 * np.diff(times_ns)[:, None] * 1e-9
    wrong = _wrong_readings(times_ns, poses, gain, values, settings)
    return {
        "about": f"inertial readings less true biases, integrated over {SPAN_S:g} s at a time from "
        "true states, and each of them from its own",
        "drift_max_m": round(drift_m, 6),
        "turn_max_deg": round(turn_deg, 6),
        "limit_m": round(limit_m, 6),
        "limit_deg": round(limit_deg, 6),
        "failed_readings_ns": middles_ns[wrong].tolist(),
        "passed": drift_m <= limit_m and turn_deg <= limit_deg and not wrong.any(),
    }


def _wrong_readings(
    times_ns: Indices, poses: Array, gain: Array, values: Array, settings: RecordSettings
) -> Mask:
    """Return which readings (N, 6) do not explain turn or change of velocity.

    Poses are (N + 1, 4, 4); the gain (N, 3) is what the specific force adds to the velocity.
    """
    dt, R = np.diff(times_ns)[:, None] * 1e-9, Rotation.from_matrix(poses[:, :3, :3])
    half_turn = Rotation.from_rotvec(values[:, :3] * dt / 2)
    turn_error = (R[1:].inv() * R[:-1] * half_turn * half_turn).magnitude()
    explained = (R[:-1] * half_turn).apply(values[:, 3:]) * dt
    gain_error = np.linalg.norm(gain - explained, axis=1)
    noise = READING_DEVIATIONS * settings.imu.noise * np.sqrt(dt[:, 0])
    turn_max = TURN_MIN_RAD + noise * settings.imu.gyroscope_noise_density
    gain_max = GAIN_MIN_MPS + noise * settings.imu.accelerometer_noise_density
    force = np.linalg.norm(values[:, 3:], axis=1) * dt[:, 0]
    return (turn_error > turn_max) | (gain_error > gain_max + force * turn_max)


def _inertial_limits(settings: RecordSettings, gravity_mps2: Array) -> tuple[float, float]:
    """Return the drift from noise: white force noise integrated twice, and gyroscope tilt."""
    deviations = NOISE_DEVIATIONS * settings.imu.noise
    turn_rad = deviations * settings.imu.gyroscope_noise_density * SPAN_S**0.5
    drift_m = deviations * settings.imu.accelerometer_noise_density * (SPAN_S**3 / 3) ** 0.5
    drift_m += turn_rad * float(np.linalg.norm(gravity_mps2)) * SPAN_S**2 / 2
    return DRIFT_MAX_M + drift_m, TURN_MAX_DEG + float(np.degrees(turn_rad))


def _check_encoders(folder: Path, settings: RecordSettings, ended: str) -> dict[str, Any]:
    """Compare the path length of the wheels with that of the rover.

    They may differ on slippery or rough ground, and where the wheels of a stuck rover turn on.
    """
    wheel_ns, counts = read_columns(folder / "mav0/wheels0/data.csv")
    times_ns, poses, _ = read_states(folder / TRUTH / "data.csv")
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
