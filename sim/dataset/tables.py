"""Sensors of a dataset: the sensor.yaml and the table of each, in EuRoC's keys."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sim.camera.camera import FrameExposure
from sim.camera_settings import SensorSettings
from sim.imaging.distortion import coefficients, has_distortion, is_equidistant
from sim.imaging.lens import raw_focal_px
from sim.labels.formats import FORWARD, LABELS
from sim.sensors.inertial import T_body_imu, ideal_readings, imu_states, with_noise
from sim.settings import RecordSettings
from sim.world.random_streams import stream
from sim.world.rover import TRACK_M, WHEEL_RADIUS_M
from sim.world.trip import Trip
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.dataset import RECTIFIED_EYE, TRUTH, DatasetWriter
from vo.contract.rig import StereoRig

EXPOSURES = "mav0/cam0/exposure.csv"
"""Table with the exposure of each frame."""
STAMP = "timestamp [ns]"
IMU_COLUMNS = (
    STAMP,
    *(f"w_RS_S_{axis} [rad s^-1]" for axis in "xyz"),
    *(f"a_RS_S_{axis} [m s^-2]" for axis in "xyz"),
)
TRUTH_COLUMNS = (
    "timestamp",
    *(f"p_RS_R_{axis} [m]" for axis in "xyz"),
    *(f"q_RS_{axis} []" for axis in "wxyz"),
    *(f"v_RS_R_{axis} [m s^-1]" for axis in "xyz"),
    *(f"b_w_RS_S_{axis} [rad s^-1]" for axis in "xyz"),
    *(f"b_a_RS_S_{axis} [m s^-2]" for axis in "xyz"),
)


def write_cameras(
    writer: DatasetWriter,
    rig: StereoRig,
    delivered: StereoRig,
    settings: RecordSettings,
    trip: Trip,
) -> None:
    """Write descriptions and file lists of the images and labels, of a true and a delivered rig."""
    times, sensor = trip.timestamps_ns[trip.delivered].tolist(), settings.sensor
    sheets: dict[str, tuple[dict[str, Any], list[int], str]] = {}
    for camera, side in enumerate(("left", "right")):
        pixels = _pixels(delivered, settings, camera) | _shutter(settings)
        sheet = _sheet("camera", f"{side} {RECTIFIED_EYE}", **pixels, **_lens(delivered))
        sheets[f"cam{camera}"] = sheet, times, ".png"
        if has_distortion(sensor) or sensor.bits > 8:
            f_px = raw_focal_px(sensor, rig) * delivered.f_px / rig.f_px
            raw = replace(delivered, f_px=f_px if is_equidistant(sensor) else delivered.f_px)
            optics = {**pixels, **_lens(raw, sensor)}
            optics |= {"bits": sensor.bits} if sensor.bits > 8 else {}
            sheet = _sheet("camera", f"{side} eye as it leaves the sensor, distorted", **optics)
            sheets[f"raw{camera}"] = sheet, times, ".png"
    for name, form in LABELS.items():
        if getattr(settings.labels, name):
            exact = replace(rig, f_px=raw_focal_px(sensor, rig))
            sheet = _sheet(
                form.folder[:-1],
                form.about,
                **_pixels(delivered, settings, int(form.folder[-1])),
                **(_lens(exact, sensor) if name.startswith("raw") else {}),
                unit=form.unit,
                encoding=form.encoding,
                invalid_value=form.invalid,
            )
            sheets[form.folder] = sheet, times[:-1] if name in FORWARD else times, form.suffix
    for folder, (sheet, listed, suffix) in sheets.items():
        writer.add_yaml(f"mav0/{folder}/sensor.yaml", sheet)
        rows = ((t, f"{t}{suffix}") for t in listed)
        writer.add_csv(f"mav0/{folder}/data.csv", (STAMP, "filename"), rows)


def _lens(rig: StereoRig, sensor: SensorSettings | None = None) -> dict[str, Any]:
    """Describe a camera with the focal length of a rig: a lens, or none."""
    return {
        "camera_model": "pinhole",
        "intrinsics": [rig.f_px, rig.f_px, rig.cx_px, rig.cy_px],
        "distortion_model": sensor.lens.replace("_", "-") if sensor else "radial-tangential",
        "distortion_coefficients": coefficients(sensor) if sensor else [0.0] * 4,
    }


def write_exposures(writer: DatasetWriter, exposures: Sequence[FrameExposure]) -> None:
    """Write how each frame was exposed."""
    rows = ((x.timestamp_ns, x.exposure_ms, x.gain, x.subframes, x.brightness) for x in exposures)
    columns = STAMP, "exposure [ms]", "gain []", "sub-frames []", "brightness []"
    writer.add_csv(EXPOSURES, columns, rows)


def write_inertial(
    writer: DatasetWriter, settings: RecordSettings, trip: Trip, gravity_mps2: Array
) -> None:
    """Write inertial readings under a gravity (3,), and the true states of unit and body."""
    imu, motions, T_body_unit = settings.imu, trip.motions, T_body_imu(settings.imu)
    states = motions.T_world_body, motions.v_world_body, motions.w_world_body, T_body_unit
    ideal = ideal_readings(motions.times_ns, *states, gravity_mps2)
    readings, biases = with_noise(ideal, imu, stream(settings.seed, "imu"))
    sheet = _sheet(
        "imu",
        "angular rate and specific force, each the mean over an interval, stamped at its middle",
        T_BS=_matrix(T_body_unit),
        rate_hz=imu.rate_hz,
        gyroscope_noise_density=imu.noise * imu.gyroscope_noise_density,
        gyroscope_random_walk=imu.noise * imu.gyroscope_random_walk,
        accelerometer_noise_density=imu.noise * imu.accelerometer_noise_density,
        accelerometer_random_walk=imu.noise * imu.accelerometer_random_walk,
    )
    writer.add_yaml("mav0/imu0/sensor.yaml", sheet)
    values = np.hstack([readings.gyro_radps, readings.accel_mps2])
    writer.add_csv("mav0/imu0/data.csv", IMU_COLUMNS, _stamped(readings.times_ns, values))
    tables = (
        ("mav0/imu0/truth.csv", motions.times_ns, *imu_states(*states)),
        (f"{TRUTH}/data.csv", trip.timestamps_ns, trip.T_world_body, trip.v_world_body),
    )
    for name, times_ns, T_world_frame, v_world_frame in tables:
        at_times = [np.interp(times_ns, readings.times_ns, b) for b in biases.T]
        parts = T_world_frame[:, :3, 3], se3.to_quat_wxyz(T_world_frame), v_world_frame
        rows = np.hstack([*parts, np.stack(at_times, axis=1)])
        writer.add_csv(name, TRUTH_COLUMNS, _stamped(times_ns, rows))
    sheet = _sheet(
        "truth",
        "T_world_body at mid-exposure; body: origin midway between the driven wheels, "
        "x forward, y left, z up, rigid with cameras and inertial unit; biases are the "
        "inertial unit's",
        T_BS=_matrix(np.eye(4)),
        rate_hz=settings.rig.rate_hz,
    )
    writer.add_yaml(f"{TRUTH}/sensor.yaml", sheet)


def write_wheels(writer: DatasetWriter, settings: RecordSettings, trip: Trip) -> None:
    """Write encoder readings and wheel loads, if the carrier has wheels."""
    if not len(trip.wheel_counts):
        return
    sheet = _sheet(
        "wheel_encoders",
        "ticks since the start, forward positive; stamps are exact, their spacing is "
        "the sampling period to one physics step",
        rate_hz=settings.encoders.rate_hz,
        ticks_per_turn=settings.encoders.ticks_per_turn,
        wheel_radius_m=WHEEL_RADIUS_M,
        track_m=TRACK_M,
    )
    writer.add_yaml("mav0/wheels0/sensor.yaml", sheet)
    counts = zip(trip.wheel_times_ns.tolist(), *trip.wheel_counts.T.tolist(), strict=True)
    writer.add_csv("mav0/wheels0/data.csv", (STAMP, "left [ticks]", "right [ticks]"), counts)
    comment = "normal force between ground and wheel at an instant"
    sheet = _sheet("wheel_loads", comment, rate_hz=settings.imu.rate_hz, unit="N")
    writer.add_yaml("mav0/contact0/sensor.yaml", sheet)
    loads = _stamped(trip.motions.times_ns, trip.motions.wheel_forces_n)
    columns = STAMP, "left [N]", "right [N]", "caster [N]"
    writer.add_csv("mav0/contact0/data.csv", columns, loads)


def _sheet(sensor_type: str, comment: str, **content: Any) -> dict[str, Any]:
    return {"sensor_type": sensor_type, "comment": comment, **content}


def _pixels(rig: StereoRig, settings: RecordSettings, camera: int) -> dict[str, Any]:
    T_left_camera = se3.pose(np.eye(3), np.array([rig.baseline_m * camera, 0.0, 0.0]))
    return {
        "T_BS": _matrix(rig.T_body_cam @ T_left_camera),
        "rate_hz": settings.rig.rate_hz,
        "resolution": [rig.width_px, rig.height_px],
    }


def _shutter(settings: RecordSettings) -> dict[str, Any]:
    line_time_us = settings.exposure.line_time_us
    return {"line_delay": round(line_time_us * 1e-6, 12)} if line_time_us else {}


def _matrix(T: Array) -> dict[str, Any]:
    return {"cols": 4, "rows": 4, "data": T.ravel().tolist()}


def _stamped(times_ns: Indices, values: Array) -> Iterator[list[float]]:
    return ([t, *row] for t, row in zip(times_ns.tolist(), values.tolist(), strict=True))
