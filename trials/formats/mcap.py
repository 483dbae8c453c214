"""MCAP with ROS 2 messages, as `ros2 bag record -s mcap` writes it.

Source: mcap.dev; ROS 2 Humble's sensor_msgs, stereo_msgs, nav_msgs, geometry_msgs and tf2_msgs;
REP 103 and 105.
"""

from collections.abc import Iterator, Sequence
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
from vo.recordings.readers import read_imu

if TYPE_CHECKING:
    from trials.formats.ros_messages import Messages

EYES = ("left", "right")
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
    passed = int(np.searchsorted(imu.timestamps_ns, recording.times_ns[0]))
    for i, time_ns in enumerate(recording.times_ns):
        until = int(np.searchsorted(imu.timestamps_ns, time_ns, side="right"))
        for k in range(passed, until):
            t = int(imu.timestamps_ns[k])
            yield "/imu", t, make.imu(t, imu.gyro_radps[k], imu.accel_mps2[k])
        passed = until
        yield from _frame(recording, make, i)
        advance(i)


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
