"""Bags of ROS 1 and 2 that tests write message by message."""

from pathlib import Path

import numpy as np
from folders import BASELINE_M, F_PX, PERIOD_NS
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

TFMESSAGE = get_types_from_msg(
    "geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"
)
STORES = {1: get_typestore(Stores.ROS1_NOETIC), 2: get_typestore(Stores.ROS2_HUMBLE)}
STORES[1].register(TFMESSAGE)
LATE_NS = 70_000_000
"""Time from a header's to the receipt of its message."""


class BagWriter:
    """Messages of one bag: `.bag`, `.mcap`, `.db3`, or a folder of ROS 2."""

    def __init__(self, path: Path, storage: StoragePlugin = StoragePlugin.SQLITE3):
        self.path, self.ros = path, 1 if path.suffix == ".bag" else 2
        self.store = STORES[self.ros]
        self.storage = StoragePlugin.MCAP if path.suffix == ".mcap" else storage
        self.topics, self.numbers = {}, {}

    def __enter__(self):
        if self.ros == 1:
            self.writer = rosbag1.Writer(self.path)
        else:
            self.folder = self.path.with_name(f"{self.path.stem}.folder")
            self.writer = rosbag2.Writer(
                self.folder if self.path.suffix else self.path,
                version=8,
                storage_plugin=self.storage,
            )
        self.writer.open()
        return self

    def __exit__(self, *_):
        self.writer.close()
        if self.ros == 2 and self.path.suffix:
            (file,) = (x for x in self.folder.iterdir() if x.suffix == self.path.suffix)
            file.rename(self.path)

    def make(self, kind, **values):
        package, name = kind.split("/")
        return self.store.types[f"{package}/msg/{name}"](**values)

    def stamp(self, time_ns):
        seconds, nanoseconds = divmod(time_ns, 10**9)
        return self.make("builtin_interfaces/Time", sec=seconds, nanosec=nanoseconds)

    def header(self, time_ns, frame="cam"):
        values = {"stamp": self.stamp(time_ns), "frame_id": frame}
        return self.make("std_msgs/Header", **values, **({"seq": 0} if self.ros == 1 else {}))

    def write(self, topic, time_ns, message, received_ns=None):
        kind = message.__msgtype__
        if topic not in self.topics:
            self.topics[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        pack = self.store.serialize_ros1 if self.ros == 1 else self.store.serialize_cdr
        received = time_ns + LATE_NS if received_ns is None else received_ns
        self.writer.write(self.topics[topic], received, pack(message, kind))

    def image(self, topic, time_ns, pixels, encoding="mono8", **changes):
        rows = np.ascontiguousarray(pixels)
        values = {
            "header": self.header(time_ns, f"{topic.split('/')[1]}_frame"),
            "height": rows.shape[0],
            "width": rows.shape[1],
            "encoding": encoding,
            "is_bigendian": 0,
            "step": rows.strides[0],
            "data": rows.reshape(-1).view(np.uint8),
        }
        stamp = changes.pop("stamp_ns", time_ns)
        values["header"] = self.header(stamp, f"{topic.split('/')[1]}_frame")
        self.write(topic, time_ns, self.make("sensor_msgs/Image", **values | changes))

    def info(self, topic, size, K, D, R, P, model="plumb_bob"):
        region = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
        matrices = {"K": K, "D": D, "R": R, "P": P}
        arrays = {x: np.array(value, float).ravel() for x, value in matrices.items()}
        if self.ros == 2:
            arrays = {x.lower(): value for x, value in arrays.items()}
        message = self.make(
            "sensor_msgs/CameraInfo",
            header=self.header(PERIOD_NS, f"{topic.split('/')[1]}_frame"),
            width=size[0],
            height=size[1],
            distortion_model=model,
            binning_x=0,
            binning_y=0,
            roi=self.make("sensor_msgs/RegionOfInterest", **region),
            **arrays,
        )
        self.write(topic, PERIOD_NS, message)

    def pose(self, T):
        from scipy.spatial.transform import Rotation

        x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
        place = dict(zip("xyz", map(float, T[:3, 3]), strict=True))
        return self.make(
            "geometry_msgs/Pose",
            position=self.make("geometry_msgs/Point", **place),
            orientation=self.make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w),
        )

    def pose_stamped(self, topic, time_ns, T):
        message = {"header": self.header(time_ns, "world"), "pose": self.pose(T)}
        self.write(topic, time_ns, self.make("geometry_msgs/PoseStamped", **message))

    def transform(self, topic, time_ns, parent, child, T):
        pose = self.pose(T)
        place = {x: getattr(pose.position, x) for x in "xyz"}
        inner = self.make(
            "geometry_msgs/Transform",
            translation=self.make("geometry_msgs/Vector3", **place),
            rotation=pose.orientation,
        )
        stamped = self.make(
            "geometry_msgs/TransformStamped",
            header=self.header(time_ns, parent),
            child_frame_id=child,
            transform=inner,
        )
        message = self.make("tf2_msgs/TFMessage", transforms=[stamped])
        self.write(topic, time_ns, message)


def rectified_infos(bag, topics, size, baseline_m=BASELINE_M):
    """Write the calibrations of a rectified pair, as `folders.write_euroc` has it."""
    K = np.array([[F_PX, 0, (size[0] - 1) / 2], [0, F_PX, (size[1] - 1) / 2], [0, 0, 1]])
    for topic, shift in zip(topics, (0.0, -F_PX * baseline_m), strict=True):
        bag.info(topic, size, K, np.zeros(5), np.eye(3), np.c_[K, [shift, 0, 0]])
