"""KITTI odometry: one sequence of rectified pairs, with calibration, times and poses.

Source: Geiger, Lenz, Urtasun, Are we ready for autonomous driving?, CVPR 2012, and the readme of
the odometry development kit.
"""

from pathlib import Path

import numpy as np

from trials.formats.folder import Advance, put
from trials.formats.recording import Recording
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig

EYES = ("image_0", "image_1")


def write_kitti(recording: Recording, out: Path, advance: Advance) -> None:
    """Write image_0, image_1, calib.txt, times.txt and poses.txt."""
    poses = se3.inverse(recording.poses[0]) @ recording.poses
    for i in range(len(recording)):
        for eye, data in zip(EYES, recording.eyes(i), strict=True):
            put(out / eye / f"{i:06d}.png", data)
        advance(i)
    times = "".join(f"{recording.seconds(i)}\n" for i in range(len(recording)))
    put(out / "times.txt", times)
    put(out / "poses.txt", "".join(f"{row_of(T)}\n" for T in poses))
    put(out / "calib.txt", calibration(recording.rig))


def calibration(rig: StereoRig) -> str:
    """Return calib.txt: P0 to P3 (of which P2 and P3 repeat the pair), and Tr = T_cam_body.

    Tr is that of the laser scanner in KITTI, whose axes are those of the body.
    """
    left, right = projections(rig)
    rows = {"P0": left, "P1": right, "P2": left, "P3": right, "Tr": se3.inverse(rig.T_body_cam)}
    return "".join(f"{key}: {row_of(matrix)}\n" for key, matrix in rows.items())


def projections(rig: StereoRig) -> tuple[Array, Array]:
    """Return K [I | 0] and K [I | (-baseline, 0, 0)], (3, 4) each, pixels and metres."""
    left = np.hstack([rig.K, np.zeros((3, 1))])
    right = left.copy()
    right[0, 3] = -rig.f_px * rig.baseline_m
    return left, right


def row_of(matrix: Array) -> str:
    """Format the upper three rows of a matrix."""
    return " ".join(f"{x:.15g}" for x in matrix[:3].ravel())
