"""COLMAP's text model: cameras, images with true poses, and points of the depth labels.

Source: Schönberger, Frahm, Structure-from-motion revisited, CVPR 2016, and COLMAP's page on output
formats. COLMAP's pixels have their centres at half-integers.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trials.formats.folder import Advance, put
from trials.formats.recording import VISIBLE, Recording
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.remarks import remark
from vo.contract.rig import StereoRig

CENTRE = 0.5
"""What COLMAP adds to coordinates of pixels with centres on integers."""
POINT_FRAMES, GRID = 24, (24, 18)
"""Frames whose points are written, evenly over the recording, and points along u and v of each."""
MOVING = 3
"""Code of the label classes for moving objects, whose points are left out."""


@dataclass(frozen=True)
class Points:
    """K points of one frame.

    Attributes:
        world: (K, 3) metres.
        colours: (K, 3) RGB.
        left: (K, 2) pixels in the left image, COLMAP's.
        right: (K, 2) pixels in the right image; NaN where it does not show the point.
    """

    world: Array
    colours: Array
    left: Array
    right: Array


def write_colmap(recording: Recording, out: Path, advance: Advance) -> None:
    """Write images and sparse/0/cameras.txt, images.txt and points3D.txt."""
    poses = recording.poses
    if not recording.has_depth:
        remark(f"{recording.folder}: has no labels of depth or disparity: no points are written")
    chosen = np.unique(np.linspace(0, len(recording) - 1, POINT_FRAMES).round()).astype(int)
    T_left_right = se3.pose(np.eye(3), np.array([recording.rig.baseline_m, 0.0, 0.0]))
    images: list[str] = []
    landmarks: list[str] = []
    for i in range(len(recording)):
        with_points = recording.has_depth and i in chosen
        points = _points(recording, i) if with_points else None
        T_cams = poses[i], poses[i] @ T_left_right
        seen = ("", "") if points is None else _observations(points, len(landmarks) + 1)
        if points is not None:
            landmarks += _landmarks(points, len(landmarks) + 1, 2 * i + 1)
        for eye, data in enumerate(recording.eyes(i)):
            name = f"{i:06d}_{('left', 'right')[eye]}.png"
            put(out / "images" / name, data)
            images.append(_image(2 * i + 1 + eye, T_cams[eye], eye + 1, name))
            images.append(seen[eye])
        advance(i)
    sparse = out / "sparse" / "0"
    put(
        sparse / "cameras.txt",
        _text("CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]", _cameras(recording.rig)),
    )
    head = (
        "IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)"
    )
    put(sparse / "images.txt", _text(head, images))
    head = "POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"
    put(sparse / "points3D.txt", _text(head, landmarks))


def _text(head: str, lines: Sequence[str]) -> str:
    return "".join(f"{line}\n" for line in (f"# {head}", *lines))


def _cameras(rig: StereoRig) -> list[str]:
    """Return one camera for each eye, with the same parameters."""
    parameters = f"{rig.f_px} {rig.f_px} {rig.cx_px + CENTRE} {rig.cy_px + CENTRE}"
    return [f"{k} PINHOLE {rig.width_px} {rig.height_px} {parameters}" for k in (1, 2)]


def _image(number: int, T_world_cam: Array, camera: int, name: str) -> str:
    T_cam_world = se3.inverse(T_world_cam)
    values = *se3.to_quat_wxyz(T_cam_world), *T_cam_world[:3, 3]
    return f"{number} {' '.join(f'{x:.12g}' for x in values)} {camera} {name}"


def _points(recording: Recording, i: int) -> Points:
    """Read points at a grid of pixels that show a surface at rest."""
    rig = recording.rig
    u, v = (
        np.linspace(0, size - 1, count + 2).round().astype(int)[1:-1]
        for size, count in zip((rig.width_px, rig.height_px), GRID, strict=True)
    )
    pixels = np.stack(np.meshgrid(np.unique(u), np.unique(v)), axis=-1).reshape(-1, 2)
    disparity, classes = recording.disparity(i), recording.label("classes", i)
    at = pixels[:, 1], pixels[:, 0]
    known = np.isfinite(disparity[at])
    if classes is not None:
        known &= classes[at] != MOVING
    pixels = pixels[known]
    at = pixels[:, 1], pixels[:, 0]
    d = disparity[at].astype(float)
    hidden = recording.label("occlusion", i)
    right = pixels - np.column_stack([d, np.zeros_like(d)])
    right[np.full(len(d), True) if hidden is None else hidden[at] != VISIBLE] = np.nan
    image = recording.pixels(i)[0]
    colours = np.broadcast_to(image.reshape(*image.shape[:2], -1), (*image.shape[:2], 3))[at]
    world = se3.transform(recording.poses[i], recording.true_rig.triangulate(pixels, d))
    return Points(world, colours, pixels + CENTRE, right + CENTRE)


def _observations(points: Points, first: int) -> tuple[str, str]:
    """Return the lines of points of both images; ids of points count from `first`."""
    ids = np.arange(first, first + len(points.world))
    left, right = (
        " ".join(f"{u:.9g} {v:.9g} {k}" for (u, v), k in zip(pixels, ids, strict=True) if u == u)
        for pixels in (points.left, points.right)
    )
    return left, right


def _landmarks(points: Points, first: int, left_image: int) -> list[str]:
    """Return the lines of points; the right image follows the left."""
    lines: list[str] = []
    rows_right = np.cumsum(~np.isnan(points.right[:, 0])) - 1
    for k, (world, colour) in enumerate(zip(points.world, points.colours, strict=True)):
        track = f"{left_image} {k}"
        if not np.isnan(points.right[k, 0]):
            track += f" {left_image + 1} {rows_right[k]}"
        place = " ".join(f"{x:.9g}" for x in world)
        lines.append(f"{first + k} {place} {' '.join(map(str, colour))} 0 {track}")
    return lines
