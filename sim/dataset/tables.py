"""The sensor.yaml files and tables of a dataset."""

from collections.abc import Iterator, Sequence

import numpy as np

from sim.camera.camera import FrameExposure
from sim.dataset.sensor_yaml import (
    EXPOSURES,
    LABELS,
    T_body_imu,
    camera_sheet,
    contact_sheet,
    imu_sheet,
    label_sheet,
    truth_sheet,
    wheels_sheet,
)
from sim.imaging.lens import has_distortion
from sim.labels.annotate import FORWARD
from sim.sensors.inertial import GRAVITY_MPS2, ideal_readings, imu_states, with_noise
from sim.settings import RecordSettings
from sim.world.random_streams import stream
from sim.world.trip import Trip
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.dataset import TRUTH, DatasetWriter
from vo.contract.rig import StereoRig

STAMP = "timestamp [ns]"
IMAGE_COLUMNS = (STAMP, "filename")
EXPOSURE_COLUMNS = (STAMP, "exposure [ms]", "gain []", "sub-frames []", "brightness []")
WHEEL_COLUMNS = (STAMP, "left [ticks]", "right [ticks]")
CONTACT_COLUMNS = (STAMP, "left [N]", "right [N]", "caster [N]")
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
    writer: DatasetWriter, delivered: StereoRig, settings: RecordSettings, trip: Trip
) -> None:
    """Write descriptions and file lists of the images and labels."""
    rate_hz = settings.rig.rate_hz
    times = trip.timestamps_ns[trip.delivered].tolist()
    sheets = {}
    for k in (0, 1):
        sheets[f"cam{k}"] = camera_sheet(delivered, rate_hz, k), times, ".png"
        if has_distortion(settings.sensor):
            sheets[f"raw{k}"] = camera_sheet(delivered, rate_hz, k, settings.sensor), times, ".png"
    for name, wanted in settings.labels:
        if wanted:
            form, listed = LABELS[name], times[:-1] if name in FORWARD else times
            sheets[form.folder] = label_sheet(delivered, rate_hz, form), listed, form.suffix
    for folder, (sheet, listed, suffix) in sheets.items():
        writer.add_yaml(f"mav0/{folder}/sensor.yaml", sheet)
        rows = ((t, f"{t}{suffix}") for t in listed)
        writer.add_csv(f"mav0/{folder}/data.csv", IMAGE_COLUMNS, rows)


def write_exposures(writer: DatasetWriter, exposures: Sequence[FrameExposure]) -> None:
    """Write how each frame was exposed."""
    rows = ((x.timestamp_ns, x.exposure_ms, x.gain, x.subframes, x.brightness) for x in exposures)
    writer.add_csv(EXPOSURES, EXPOSURE_COLUMNS, rows)


def write_inertial(writer: DatasetWriter, settings: RecordSettings, trip: Trip) -> None:
    """Write the inertial readings, and the true states of unit and body with the biases."""
    motions, T_body_unit = trip.motions, T_body_imu(settings.imu)
    states = motions.T_world_body, motions.v_world_body, motions.w_world_body, T_body_unit
    ideal = ideal_readings(motions.times_ns, *states, GRAVITY_MPS2)
    readings, biases = with_noise(ideal, settings.imu, stream(settings.seed, "imu"))
    writer.add_yaml("mav0/imu0/sensor.yaml", imu_sheet(settings.imu))
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
    writer.add_yaml(f"{TRUTH}/sensor.yaml", truth_sheet(settings))


def write_wheels(writer: DatasetWriter, settings: RecordSettings, trip: Trip) -> None:
    """Write encoder readings and wheel loads, if the carrier has wheels."""
    if len(trip.wheel_counts):
        writer.add_yaml("mav0/wheels0/sensor.yaml", wheels_sheet(settings.encoders))
        counts = zip(trip.wheel_times_ns.tolist(), *trip.wheel_counts.T.tolist(), strict=True)
        writer.add_csv("mav0/wheels0/data.csv", WHEEL_COLUMNS, counts)
        motions = trip.motions
        writer.add_yaml("mav0/contact0/sensor.yaml", contact_sheet(settings.imu.rate_hz))
        loads = _stamped(motions.times_ns, motions.wheel_forces_n)
        writer.add_csv("mav0/contact0/data.csv", CONTACT_COLUMNS, loads)


def _stamped(times_ns: Indices, values: Array) -> Iterator[list[float]]:
    return ([t, *row] for t, row in zip(times_ns.tolist(), values.tolist(), strict=True))
