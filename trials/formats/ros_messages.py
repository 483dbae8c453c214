"""Messages of ROS 2 Humble, from this project's quantities."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.typesys import Stores, get_typestore

from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig
from vo.contract.trajectory import NS_PER_S

INVALID_PX = -1.0
"""Disparity of pixels without one: below min_disparity, as DisparityImage marks them."""

_FOREVER = QosTime(9223372036, 854775807)
LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    *(_FOREVER, _FOREVER, QosLiveliness.AUTOMATIC, _FOREVER, False),
)
"""Quality of service of /tf_static, which late subscribers receive too."""


class Messages:
    """Makes messages; times are integer nanoseconds.

    Attributes:
        store: Types of messages, which also serializes them.
    """

    def __init__(self) -> None:
        self.store = get_typestore(Stores.ROS2_HUMBLE)

    def make(self, kind: str, *values: Any) -> Any:
        """Make a message of a kind such as `std_msgs/Header`, with values in its fields' order."""
        package, name = kind.split("/")
        return self.store.types[f"{package}/msg/{name}"](*values)

    def header(self, time_ns: int, frame: str) -> Any:
        """Make a header."""
        stamp = self.make("builtin_interfaces/Time", *divmod(time_ns, NS_PER_S))
        return self.make("std_msgs/Header", stamp, frame)

    def image(self, time_ns: int, frame: str, pixels: Array) -> Any:
        """Make an image: (H, W) mono8, (H, W, 3) rgb8, or (H, W) float32 as 32FC1."""
        kind = "32FC1" if pixels.dtype == np.float32 else "mono8" if pixels.ndim == 2 else "rgb8"
        data = np.ascontiguousarray(pixels)
        height, width = data.shape[:2]
        step, raw = data.strides[0], data.reshape(-1).view(np.uint8)
        header = self.header(time_ns, frame)
        return self.make("sensor_msgs/Image", header, height, width, kind, 0, step, raw)

    def camera_info(self, time_ns: int, eye: str, rig: StereoRig, baseline_m: float) -> Any:
        """Make the calibration of a rectified eye at (baseline, 0, 0) in the left one."""
        P = np.hstack([rig.K, [[-rig.f_px * baseline_m], [0.0], [0.0]]])
        return self.make(
            "sensor_msgs/CameraInfo",
            self.header(time_ns, f"{eye}_camera"),
            rig.height_px,
            rig.width_px,
            "plumb_bob",
            np.zeros(5),
            rig.K.ravel(),
            np.eye(3).ravel(),
            P.ravel(),
            0,
            0,
            self._region(0, 0),
        )

    def disparity(self, time_ns: int, disparity_px: Array, rig: StereoRig) -> Any:
        """Make the disparity u_left - u_right (H, W) of the left image; NaN becomes INVALID_PX."""
        known = disparity_px[np.isfinite(disparity_px)]
        most = float(known.max()) if len(known) else 0.0
        values = np.where(np.isfinite(disparity_px), disparity_px, INVALID_PX).astype(np.float32)
        header = self.header(time_ns, "left_camera")
        image = self.image(time_ns, "left_camera", values)
        region = self._region(*disparity_px.shape)
        kind = "stereo_msgs/DisparityImage"
        return self.make(kind, header, image, rig.f_px, rig.baseline_m, region, 0.0, most, 0.0)

    def imu(self, time_ns: int, gyro_radps: Array, accel_mps2: Array) -> Any:
        """Make angular rate and specific force, (3,) each; orientation is absent."""
        rate, force = self._vector(gyro_radps), self._vector(accel_mps2)
        absent, unknown = np.append(-1.0, np.zeros(8)), np.zeros(9)
        turn = self.make("geometry_msgs/Quaternion", 0.0, 0.0, 0.0, 1.0)
        header = self.header(time_ns, "imu")
        kind = "sensor_msgs/Imu"
        return self.make(kind, header, turn, absent, rate, unknown, force, unknown.copy())

    def joints(self, time_ns: int, names: Sequence[str], angles_rad: Array) -> Any:
        """Make the angles of joints."""
        header, absent = self.header(time_ns, ""), np.zeros(0)
        return self.make("sensor_msgs/JointState", header, list(names), angles_rad, absent, absent)

    def odometry(self, time_ns: int, T_world_body: Array, twist_body: Array) -> Any:
        """Make pose, and twist (6,) as (v in m/s, w in rad/s) in the body; covariances are zero."""
        place = self.make("geometry_msgs/Point", *map(float, T_world_body[:3, 3]))
        pose = self.make("geometry_msgs/Pose", place, self._quaternion(T_world_body))
        speeds = (self._vector(x) for x in (twist_body[:3], twist_body[3:]))
        twist = self.make("geometry_msgs/Twist", *speeds)
        return self.make(
            "nav_msgs/Odometry",
            self.header(time_ns, "world"),
            "base_link",
            self.make("geometry_msgs/PoseWithCovariance", pose, np.zeros(36)),
            self.make("geometry_msgs/TwistWithCovariance", twist, np.zeros(36)),
        )

    def transform(self, time_ns: int, parent: str, child: str, T_parent_child: Array) -> Any:
        """Make the transform of a child frame in its parent."""
        place = self._vector(T_parent_child[:3, 3])
        T = self.make("geometry_msgs/Transform", place, self._quaternion(T_parent_child))
        header = self.header(time_ns, parent)
        return self.make("geometry_msgs/TransformStamped", header, child, T)

    def transforms(self, transforms: Sequence[Any]) -> Any:
        """Make the message of transforms."""
        return self.make("tf2_msgs/TFMessage", list(transforms))

    def _vector(self, values: Array) -> Any:
        return self.make("geometry_msgs/Vector3", *map(float, values))

    def _quaternion(self, T: Array) -> Any:
        w, x, y, z = map(float, se3.to_quat_wxyz(T))
        return self.make("geometry_msgs/Quaternion", x, y, z, w)

    def _region(self, height: int, width: int) -> Any:
        return self.make("sensor_msgs/RegionOfInterest", 0, 0, height, width, False)
