"""Cameras of a bag: of its messages, or of a file beside it."""

from pathlib import Path
from typing import Any

import numpy as np

from vo.contract.arrays import Array
from vo.contract.errors import CalibrationError
from vo.contract.remarks import remark
from vo.recordings.calibration import describe_cameras, read_cameras
from vo.recordings.calibration_files import find_stereo_file
from vo.recordings.rectify import Camera
from vo.recordings.ros.topics import Source
from vo.recordings.ros.transforms import Transforms, frame_name

EYES = ("left", "right")


def read_bag_cameras(source: Source, transforms: Transforms) -> tuple[Camera, Camera]:
    """Read camera_info of both eyes; without it, a file of both cameras beside the bag.

    The body is the frame above all to which the left camera is fixed by tf; without tf, the left
    camera. Of rectified images, the camera is `P`; of others `K` and `D`, with `R` and `P`.

    Raises:
        CalibrationError: If there is neither, or it describes no stereo pair.
    """
    bag, infos = source.bag, _infos(source)
    if not infos:
        return _beside(source)
    messages = infos.values()
    left, right = (_sheet(x, source.is_rectified) for x in messages)
    frames = [frame_name(x.header.frame_id) for x in messages]
    body, T_body_left = transforms.root(frames[0])
    if body != frames[0]:
        left["T_BS"] = T_body_left.ravel().tolist()
    T_left_right = transforms.between(*frames)
    if left["P"][3] == right["P"][3] and frames[0] != frames[1] and T_left_right is not None:
        left["T_BS"] = T_body_left.ravel().tolist()
        right["T_BS"] = (T_body_left @ T_left_right).ravel().tolist()
    places = [Path(f"{bag.path}{x}") for x in infos]
    return describe_cameras((places[0], places[1]), (left, right))


def body_frame(source: Source, transforms: Transforms) -> str:
    """Return the frame of the body of `read_bag_cameras`; empty if a file beside the bag has it."""
    infos = list(_infos(source).values())
    return transforms.root(frame_name(infos[0].header.frame_id))[0] if infos else ""


def _infos(source: Source) -> dict[str, Any]:
    """Return the first calibration of each eye by topic; none unless both are calibrated."""
    topics = [x for eye in EYES if (x := source.info(eye))]
    first = ((x, next(source.bag.messages(x), None)) for x in topics)
    found = {x: info for x, info in first if info is not None and _value(info, "K")[0] > 0}
    return found if len(found) == len(EYES) else {}


def _sheet(message: Any, is_rectified: bool) -> dict[str, Any]:
    """Return a camera_info by the keys of its YAML file."""
    P = np.array(_value(message, "P"))
    sheet = {"width": message.width, "height": message.height, "P": P.tolist()}
    if is_rectified:
        return sheet | {"K": P.reshape(3, 4)[:, :3].ravel().tolist(), "R": np.eye(3).tolist()}
    sheet |= {key: np.array(_value(message, key)).tolist() for key in "KDR"}
    return sheet | {"distortion_model": message.distortion_model}


def _value(message: Any, key: str) -> Array:
    """Return a matrix of camera_info, whose name is in lower case in ROS 2."""
    return getattr(message, key if hasattr(message, key) else key.lower())


def _beside(source: Source) -> tuple[Camera, Camera]:
    bag = source.bag
    folder = bag.path.resolve()
    found = find_stereo_file((folder, folder.parent))
    if found is None:
        raise CalibrationError(
            f"{bag.path}: has no calibration of {source.left} and {source.right}: expected topics "
            "camera_info beside them (or choose @left_info=TOPIC,right_info=TOPIC), or beside the "
            "bag a YAML file of both cameras, of Kalibr, ORB-SLAM, VINS-Fusion or OpenCV"
        )
    remark(f"{bag.path}: has no camera_info; the calibration is that of {found}")
    return read_cameras(found, found)
