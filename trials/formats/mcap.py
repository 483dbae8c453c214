"""MCAP with ROS 2 messages, as `ros2 bag record -s mcap` writes it.

Source: mcap.dev; ROS 2 Humble's sensor_msgs, stereo_msgs, nav_msgs, geometry_msgs and tf2_msgs;
REP 103 and 105.
"""

from collections.abc import Iterator, Sequence
from heapq import merge
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trials.formats.folder import Advance
from trials.formats.recording import Recording
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import DatasetError, SettingsError
from vo.contract.inertial import ImuLog
from vo.contract.trajectory import NS_PER_S
from vo.recordings.calibration_files import read_yaml
from vo.recordings.readers import read_imu
from vo.recordings.ros.wheels import TICKS_PER_TURN

if TYPE_CHECKING:
    from trials.formats.ros_messages import Messages

EYES = ("left", "right")
JOINTS = ("left_wheel_joint", "right_wheel_joint")
MAX_TIME_NS = 2**31 * NS_PER_S
"""End of the times that messages hold."""
NO_READINGS = ImuLog(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)))
Message = tuple[str, int, Any]
"""Topic, time in ns, and message."""


def write_mcap(recordings: Sequence[Recording], out: Path, advance: Advance) -> None:
    """Write a bag NAME of each recording: a folder with NAME.mcap and metadata.yaml.

    Raises:
        SettingsError: If the package rosbags is missing.
        DatasetError: If times are beyond those of ROS, of 2038.
    """
    for recording in recordings:
        if recording.times_ns[-1] >= MAX_TIME_NS:
            raise DatasetError(
                f"{recording.folder}: frames at {recording.times_ns[-1]} ns; ROS messages hold "
                f"times below {MAX_TIME_NS} ns"
            )
    try:
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

        from trials.formats.ros_messages import LATCHED, Messages
    except ImportError:
        raise SettingsError(
            "the format mcap needs the package rosbags: pip install 'driftyard[mcap]'"
        ) from None
    out.mkdir(parents=True, exist_ok=True)
    messages = Messages()
    for recording in recordings:
        writer = Writer(out / recording.name, version=8, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            connections: dict[str, Any] = {}
            for topic, time_ns, message in _messages(recording, messages, advance):
                kind = message.__msgtype__
                if topic not in connections:
                    services = [LATCHED] if topic == "/tf_static" else []
                    connections[topic] = writer.add_connection(
                        topic, kind, typestore=messages.store, offered_qos_profiles=services
                    )
                data = messages.store.serialize_cdr(message, kind)
                writer.write(connections[topic], time_ns, data)


def _messages(recording: Recording, make: "Messages", advance: Advance) -> Iterator[Message]:
    """Yield the messages of a recording in the order of their times."""
    imu = read_imu(recording.folder) or NO_READINGS
    yield from _static_transforms(recording, make, imu.T_body_imu)
    sensors = _inertial(recording, make, imu), _wheels(recording, make)
    yield from merge(*sensors, _frames(recording, make, advance), key=lambda x: x[1])


def _frames(recording: Recording, make: "Messages", advance: Advance) -> Iterator[Message]:
    for i in range(len(recording)):
        yield from _frame(recording, make, i)
        advance(i)


def _inertial(recording: Recording, make: "Messages", imu: ImuLog) -> Iterator[Message]:
    """Yield the readings from the first to the last frame."""
    start, end = recording.times_ns[0], recording.times_ns[-1]
    for t, gyro_radps, accel_mps2 in zip(
        imu.timestamps_ns.tolist(), imu.gyro_radps, imu.accel_mps2, strict=True
    ):
        if start <= t <= end:
            yield "/imu", t, make.imu(t, gyro_radps, accel_mps2)


def _wheels(recording: Recording, make: "Messages") -> Iterator[Message]:
    """Yield the angles of the wheels from the last reading before the first frame to the last."""
    wheels = recording.sequence.wheels
    if wheels is None:
        return
    sheet = recording.folder / "mav0/wheels0/sensor.yaml"
    ticks_per_turn = read_yaml(sheet).get("ticks_per_turn") if sheet.is_file() else None
    angles_rad = wheels.ticks * (2 * np.pi / float(ticks_per_turn or TICKS_PER_TURN))
    times = wheels.timestamps_ns
    first = max(int(np.searchsorted(times, recording.times_ns[0], side="right")) - 1, 0)
    for k in range(first, int(np.searchsorted(times, recording.times_ns[-1], side="right"))):
        yield "/joint_states", int(times[k]), make.joints(int(times[k]), JOINTS, angles_rad[k])


def _static_transforms(
    recording: Recording, make: "Messages", T_body_imu: Array
) -> Iterator[Message]:
    rig, start_ns = recording.rig, recording.times_ns[0]
    T_left_right = se3.pose(np.eye(3), np.array([rig.baseline_m, 0.0, 0.0]))
    fixed = (
        ("left_camera", rig.T_body_cam),
        ("right_camera", rig.T_body_cam @ T_left_right),
        ("imu", T_body_imu),
    )
    transforms = [make.transform(start_ns, "base_link", name, T) for name, T in fixed]
    yield "/tf_static", start_ns, make.transforms(transforms)


def _frame(recording: Recording, make: "Messages", i: int) -> Iterator[Message]:
    """Yield images, calibrations, disparity, true pose and transform of a frame."""
    t = recording.times_ns[i]
    for eye, pixels in zip(EYES, recording.pixels(i), strict=True):
        yield f"/stereo/{eye}/image_rect", t, make.image(t, f"{eye}_camera", pixels)
        baseline_m = recording.rig.baseline_m if eye == "right" else 0.0
        yield f"/stereo/{eye}/camera_info", t, make.camera_info(t, eye, recording.rig, baseline_m)
    if recording.has_depth:
        label = recording.disparity(i)
        yield "/stereo/disparity", t, make.disparity(t, label, recording.true_rig)
    if recording.pose(i) is not None:
        T_world_body = recording.poses @ se3.inverse(recording.rig.T_body_cam)
        twist = _twist(T_world_body, recording.sequence.timestamps_ns, i)
        yield "/ground_truth/odometry", t, make.odometry(t, T_world_body[i], twist)
        yield "/tf", t, make.transforms([make.transform(t, "world", "base_link", T_world_body[i])])


def _twist(T_world_body: Array, times_ns: Indices, i: int) -> Array:
    """Return the mean velocity (6,) in the body from frame i to the next pose, or to the last."""
    known = np.flatnonzero(~np.isnan(T_world_body[:, 0, 0]))
    if len(known) < 2:
        return np.zeros(6)
    k = min(int(np.searchsorted(known, i)), len(known) - 2)
    start, end = known[k : k + 2]
    step = se3.log(se3.inverse(T_world_body[start]) @ T_world_body[end])
    return step / (float(times_ns[end] - times_ns[start]) / NS_PER_S)
