"""Constant transforms between the frames of a bag, and poses over time."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import DatasetError
from vo.contract.remarks import remark
from vo.contract.trajectory import NS_PER_S, Trajectory
from vo.recordings.ros.bag import Bag
from vo.recordings.ros.topics import TF

LATCHED = "/tf_static"
NOISE = 1e-9
"""Largest change of a transform that is constant."""


@dataclass(frozen=True)
class Transforms:
    """A forest of frames.

    Attributes:
        fixed: Frame to its parent and T_parent_frame (4, 4), where that is constant.
        moving: Frame to its parent and poses over time, where they change.
    """

    fixed: Mapping[str, tuple[str, Array]]
    moving: Mapping[str, tuple[str, Trajectory]]

    def root(self, frame: str) -> tuple[str, Array]:
        """Return the frame above all to which a frame is fixed, and T_root_frame (4, 4)."""
        T, passed = np.eye(4), {frame}
        while frame in self.fixed:
            parent, T_parent_frame = self.fixed[frame]
            if parent in passed:
                raise DatasetError(f"tf: {parent} is a parent of itself")
            passed.add(parent)
            frame, T = parent, T_parent_frame @ T
        return frame, T

    def between(self, target: str, source: str) -> Array | None:
        """Return T_target_source (4, 4); None if they are not fixed to each other."""
        (root, T_root_source), (other, T_other_target) = self.root(source), self.root(target)
        return se3.inverse(T_other_target) @ T_root_source if root == other else None


@lru_cache(maxsize=4)
def read_transforms(bag: Bag) -> Transforms:
    """Read all transforms of a bag; frames without a leading slash, as in ROS 2.

    Raises:
        DatasetError: If messages are damaged.
    """
    found: dict[str, tuple[str, list[int], list[Array]]] = {}
    fixed: dict[str, tuple[str, Array]] = {}
    topics = sorted((x for x, kind in bag.types.items() if kind == TF), key=lambda x: x != LATCHED)
    for topic in topics:
        for message in bag.messages(topic):
            for x in message.transforms:
                child, parent = frame_name(x.child_frame_id), frame_name(x.header.frame_id)
                T = pose_matrix(x.transform.translation, x.transform.rotation)
                if topic.endswith(LATCHED):
                    fixed[child] = parent, T
                elif child not in fixed:
                    _, times, poses = found.setdefault(child, (parent, [], []))
                    times.append(stamp_ns(x.header))
                    poses.append(T)
    moving: dict[str, tuple[str, Trajectory]] = {}
    for child, (parent, times, poses) in found.items():
        T = np.array(poses)
        if np.abs(T - T[0]).max() <= NOISE:
            fixed[child] = parent, T[0]
        else:
            moving[child] = parent, in_order(f"{bag.path}: tf of {child}", np.array(times), T)
    return Transforms(fixed, moving)


def in_order(place: str, times_ns: Indices, T: Array, point_cam: Array | None = None) -> Trajectory:
    """Make a trajectory of poses (N, 4, 4) in any order; a remark counts repeated times."""
    times, rows = np.unique(times_ns, return_index=True)
    finite = np.isfinite(T[rows]).all(axis=(1, 2))
    if left := len(times_ns) - int(finite.sum()):
        remark(f"{place}: {left} poses with the time of another, or with NaN, left out")
    return Trajectory(times[finite], T[rows][finite], point_cam)


def pose_matrix(position: Any, orientation: Any | None) -> Array:
    """Return the pose (4, 4) of a position and a quaternion, NaN if that has no length."""
    t = np.array([position.x, position.y, position.z])
    if orientation is None:
        return se3.pose(np.eye(3), t)
    quat = np.array([getattr(orientation, x) for x in "wxyz"])
    length = np.linalg.norm(quat)
    if not np.isfinite(length) or length == 0:
        return np.full((4, 4), np.nan)
    return se3.from_quat_wxyz(quat / length, t)


def stamp_ns(header: Any) -> int:
    """Return the time of a header, ns."""
    return header.stamp.sec * NS_PER_S + header.stamp.nanosec


def frame_name(frame_id: str) -> str:
    """Return the name of a frame without the slash that tf of ROS 1 has."""
    return frame_id.strip("/\0 ")
