"""TartanAir V2: images, depth and flow in its encodings, poses in its axes.

Source: Wang et al., TartanAir: a dataset to push the limits of visual SLAM, IROS 2020; its page on
modalities (tartanair.org), and the masks of its tool for optical flow.
"""

import json
from pathlib import Path

import cv2
import numpy as np

from sim.dataset.image_codecs import encode_png
from trials.formats.folder import Advance, put
from trials.formats.recording import Recording
from vo.contract import se3
from vo.contract.arrays import Array, Mask
from vo.contract.remarks import remark
from vo.recordings.tartanair import T_NED_WORLD, T_OPTICAL_CAMERA
from vo.recordings.tartanair_labels import (
    BEYOND,
    FLOW_ZERO,
    HIDDEN,
    LEVELS_PER_PX,
    OUTSIDE,
    SKY_M,
)

MASKS = np.array([0, HIDDEN, OUTSIDE, 0, HIDDEN], np.uint16)
"""Mask of each code of the label covisibility: visible, occluded, outside, no surface, edge."""


def write_tartanair(recording: Recording, out: Path, advance: Advance) -> None:
    """Write a trajectory folder, such as `Data_easy/P000`.

    It holds image_lcam_front, image_rcam_front, depth_lcam_front, pose_lcam_front.txt,
    pose_rcam_front.txt, imu/cam_time.txt and camera.json; flow_lcam_front and seg_lcam_front where
    the dataset has these labels.

    Raises:
        DatasetError: If there are no labels of depth or disparity.
    """
    T_world_left = recording.poses
    things = _things(recording)
    T_left_right = se3.pose(np.eye(3), np.array([recording.rig.baseline_m, 0.0, 0.0]))
    for i in range(len(recording)):
        for side, data in zip("lr", recording.eyes(i), strict=True):
            put(out / f"image_{side}cam_front/{i:06d}_{side}cam_front.png", data)
        depth = encode_depth(recording.depth(i))
        put(out / f"depth_lcam_front/{i:06d}_lcam_front_depth.png", depth)
        flow = recording.label("flow", i)
        if flow is not None:
            encoded = encode_flow(flow[..., :2], recording.label("covisibility", i))
            put(out / f"flow_lcam_front/{i:06d}_{i + 1:06d}_flow.png", encoded)
        objects = recording.label("segmentation", i) if things else None
        if objects is not None:
            encoded = encode_png(objects.astype(np.uint8))
            put(out / f"seg_lcam_front/{i:06d}_lcam_front_seg.png", encoded)
        advance(i)
    for side, T_left_camera in (("l", np.eye(4)), ("r", T_left_right)):
        T_ned = ned_poses(T_world_left @ T_left_camera)
        quat_wxyz = se3.to_quat_wxyz(T_ned)
        rows = np.hstack([T_ned[:, :3, 3], quat_wxyz[:, 1:], quat_wxyz[:, :1]])
        text = "".join(" ".join(f"{x:.12g}" for x in row) + "\n" for row in rows)
        put(out / f"pose_{side}cam_front.txt", text)
    times = "".join(f"{recording.seconds(i)}\n" for i in range(len(recording)))
    put(out / "imu/cam_time.txt", times)
    if things:
        put(out / "seg_label_map.json", json.dumps({"name_map": things}, indent=1) + "\n")
    rig = recording.rig
    camera = {"fx": rig.f_px, "fy": rig.f_px, "cx": rig.cx_px, "cy": rig.cy_px}
    size = {"width": rig.width_px, "height": rig.height_px, "baseline": rig.baseline_m}
    put(out / "camera.json", json.dumps({**camera, **size}, indent=1) + "\n")


def _things(recording: Recording) -> dict[str, int]:
    """Return the number of each object; none without labels, or if one byte does not hold them."""
    if recording.manifest is None or not recording.has("segmentation"):
        return {}
    things = recording.manifest["things"]
    if len(things) > np.iinfo(np.uint8).max:
        remark(f"{recording.folder}: {len(things)} objects, of which TartanAir holds 255; left out")
        return {}
    return {"sky": 0} | {thing["name"]: thing["id"] for thing in things}


def ned_poses(T_world_cam: Array) -> Array:
    """Return camera poses (N, 4, 4) in TartanAir's axes.

    The world is z up; its NED frame is the world turned by 180 degrees about x, so that z is down.
    A camera's axes are forward, right, down.
    """
    return T_NED_WORLD @ T_world_cam @ T_OPTICAL_CAMERA


def encode_depth(depth_m: Array) -> bytes:
    """Encode (H, W) metres as PNG of four channels: the bytes of float32, in OpenCV's order."""
    values = np.where(np.isnan(depth_m), SKY_M, depth_m).astype("<f4")
    return _opencv_png(np.ascontiguousarray(values).view(np.uint8).reshape(*values.shape, 4))


def encode_flow(flow_px: Array, covisibility: Array | None) -> bytes:
    """Encode (H, W, 2) motion as 16-bit PNG: channels u, v and mask in OpenCV's order."""
    levels = np.rint(np.nan_to_num(flow_px.astype(np.float64)) * LEVELS_PER_PX) + FLOW_ZERO
    representable = np.isfinite(flow_px) & (levels >= 0) & (levels <= 65535)
    known: Mask = np.all(representable, axis=-1)
    height, width = known.shape
    ends = flow_px + np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    inside = ((ends >= -0.5) & (ends <= np.array([width, height]) - 0.5)).all(axis=-1)
    mask = np.where(inside, 0 if covisibility is None else MASKS[covisibility], OUTSIDE)
    mask = np.where(known, mask, BEYOND)
    levels = np.where(known[..., None], levels, FLOW_ZERO)
    return _opencv_png(np.dstack([levels, mask]).astype(np.uint16))


def _opencv_png(channels: Array) -> bytes:
    _, data = cv2.imencode(".png", channels)
    return data.tobytes()
