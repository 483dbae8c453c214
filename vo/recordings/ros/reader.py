"""Reader of bags of ROS 1 and 2: stereo pairs, cameras, inertial readings and true poses.

A recording is a file `run.bag`, `run.mcap` or `run.db3`, or a folder of ROS 2. Its topics are found
by type and name, or chosen by the end of its name: `run.bag@left=/cam0/image_raw,truth=/gt`.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.errors import TrajectoryError
from vo.contract.inertial import ImuLog
from vo.contract.remarks import remark
from vo.contract.sequence import StereoSequence
from vo.contract.trajectory import Trajectory
from vo.recordings.pairing import ALL_FRAMES, FrameSelection, StereoFiles, pair_by_time
from vo.recordings.recording import open_recording
from vo.recordings.rectify import rectify
from vo.recordings.ros.calibration import body_frame, read_bag_cameras
from vo.recordings.ros.images import levels_of
from vo.recordings.ros.topics import TF, Source, open_source, split_choice
from vo.recordings.ros.transforms import (
    Transforms,
    frame_name,
    in_order,
    pose_matrix,
    read_transforms,
    stamp_ns,
)
from vo.recordings.ros.wheels import read_bag_wheels


def open_stereo_bag(path: Path, frames: FrameSelection = ALL_FRAMES) -> StereoSequence:
    """Open the stereo pairs of a bag; images are rectified on loading, unless they are already.

    Raises:
        DatasetError: If the bag cannot be read, or lacks a topic; lists those there are.
        CalibrationError: If there is none, or it describes no stereo pair.
        SettingsError: If the selection is empty, or a role of a topic is unknown.
    """
    source = open_source(path)
    files = list_bag(path, frames.tolerance_ms)
    cameras = read_bag_cameras(source, read_transforms(source.bag))
    wheels = read_bag_wheels(source)
    sequence = open_recording(path, files, frames, lambda *_: cameras, wheels)
    return replace(sequence, name=bag_name(path))


def bag_name(path: Path) -> str:
    """Return the name of a bag, without suffix and choice of topics."""
    place = split_choice(path)[0].resolve()
    return place.stem if place.is_file() else place.name


def list_bag(path: Path, tolerance_ms: float | None = None) -> StereoFiles:
    """List the stereo pairs by the times in the headers of the images.

    Raises:
        DatasetError: As `open_stereo_bag`; or if no times agree.
    """
    source = open_source(path)
    bag, topics = source.bag, (source.left, source.right)
    bag.index(topics)
    times = [bag.times_ns(x) for x in topics]
    names = [
        [Path(f"{bag.path}{topic}") / str(t) for t in eye.tolist()]
        for topic, eye in zip(topics, times, strict=True)
    ]
    places = {
        name: (topic, i)
        for topic, eye in zip(topics, names, strict=True)
        for i, name in enumerate(eye)
    }

    def levels(name: Path) -> Array:
        return levels_of(name, bag.read(*places[name]))

    left, right = zip(times, names, strict=True)
    return replace(pair_by_time(path, left, right, tolerance_ms), levels=levels)


def read_bag_pose(path: Path) -> Array:
    """Read T_body_cam (4, 4) of the rectified left camera.

    Raises:
        DriftyardError: As `open_stereo_bag`.
    """
    source = open_source(path)
    return rectify(*read_bag_cameras(source, read_transforms(source.bag)))[0].T_body_cam


def read_bag_imu(path: Path) -> ImuLog | None:
    """Read the inertial readings; None without a topic of them.

    Raises:
        DatasetError: If the bag cannot be read, or lacks a topic.
    """
    source = open_source(path)
    if source.imu is None:
        return None
    topic, bag = source.imu, source.bag
    rows: list[tuple[float, ...]] = []
    frame = ""
    times = bag.times_ns(topic)
    for i in range(len(times)):
        message = bag.read(topic, i)
        frame = frame_name(message.header.frame_id)
        vectors = (message.angular_velocity, message.linear_acceleration)
        rows.append(tuple(getattr(x, axis) for x in vectors for axis in "xyz"))
    readings = np.array(rows, dtype=float).reshape(-1, 6)
    transforms = read_transforms(bag)
    T_body_imu = transforms.between(body_frame(source, transforms), frame)
    if T_body_imu is None:
        T_body_imu = np.eye(4)
    return ImuLog(times, readings[:, :3], readings[:, 3:], T_body_imu)


def read_bag_truth(path: Path, T_body_cam: Array) -> Trajectory | None:
    """Read T_world_cam of the left camera from the topic that is named as the truth, or chosen.

    It is None without one; a remark lists other topics of poses, which may be estimates.
    T_body_cam (4, 4) is the rectified left camera in the body. Poses are those of the frame that
    their messages name, which tf relates to the body; or of the body, with a remark.

    Raises:
        DatasetError: If the bag cannot be read, or lacks a topic.
        TrajectoryError: If the chosen topic holds no poses.
    """
    source = open_source(path)
    topic, transforms = source.truth, read_transforms(source.bag)
    if topic is None:
        if others := [*source.poses, *(["/tf"] if transforms.moving else [])]:
            bag = source.bag.path
            remark(
                f"{bag}: no topic is named as the truth; choose one that is with "
                f"{bag}@truth=TOPIC; topics of poses: {', '.join(others)}"
            )
        return None
    if source.bag.types[topic] == TF:
        return _tf_truth(source, transforms, T_body_cam)
    return _topic_truth(source, topic, transforms, T_body_cam)


def _topic_truth(
    source: Source, topic: str, transforms: Transforms, T_body_cam: Array
) -> Trajectory:
    place = f"{source.bag.path}: {topic}"
    times: list[int] = []
    poses: list[Array] = []
    child, has_attitude = "", True
    for message in source.bag.messages(topic):
        child = frame_name(getattr(message, "child_frame_id", ""))
        inner = getattr(message, "pose", None) or getattr(message, "transform", message)
        inner = getattr(inner, "pose", inner)
        position = next(
            getattr(inner, x) for x in ("position", "translation", "point") if hasattr(inner, x)
        )
        orientation = getattr(inner, "orientation", getattr(inner, "rotation", None))
        has_attitude = orientation is not None
        times.append(stamp_ns(message.header))
        poses.append(pose_matrix(position, orientation))
    if not times:
        raise TrajectoryError(f"{place}: holds no poses")
    if not has_attitude:
        remark(
            f"{place}: has positions only, of the body's origin; errors are ATE without attitude"
        )
        point_cam = se3.inverse(T_body_cam)[:3, 3]
        return in_order(place, np.array(times), np.array(poses), point_cam)
    body = body_frame(source, transforms)
    T_child_body = transforms.between(child, body) if child and body else None
    if T_child_body is None:
        of_child = f" of {child}, which tf does not relate to the camera," if child else ""
        remark(f"{place}: poses{of_child} are taken for those of the body")
        T_child_body = np.eye(4)
    return in_order(place, np.array(times), np.array(poses) @ (T_child_body @ T_body_cam))


def _tf_truth(source: Source, transforms: Transforms, T_body_cam: Array) -> Trajectory:
    """Return the poses of the body in the frame above it, through all transforms that move."""
    body = body_frame(source, transforms)
    if body not in transforms.moving:
        frames = ", ".join(transforms.moving) or "none"
        raise TrajectoryError(
            f"{source.bag.path}: tf does not move {body or 'the camera'}; it moves {frames}"
        )
    parent, found = transforms.moving[body]
    passed = {body}
    while True:
        above, T_above_parent = transforms.root(parent)
        found = replace(found, T_ref_frame=T_above_parent @ found.T_ref_frame)
        if above not in transforms.moving or above in passed:
            return replace(found, T_ref_frame=found.T_ref_frame @ T_body_cam)
        passed.add(above)
        parent, upper = transforms.moving[above]
        start, end = upper.timestamps_ns[[0, -1]]
        inside = (found.timestamps_ns >= start) & (found.timestamps_ns <= end)
        times = found.timestamps_ns[inside]
        T = upper.at(times).T_ref_frame @ found.T_ref_frame[inside]
        found = Trajectory(times, T)
