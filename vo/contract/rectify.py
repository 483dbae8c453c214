"""Rectification of two calibrated cameras."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Image
from vo.contract.errors import CalibrationError
from vo.contract.rig import StereoRig

Remap = Callable[[Image], Image]

ALIGNED = 1e-6
"""Tolerance on rotation, off-axis translation and intrinsics of a rectified pair."""


@dataclass(frozen=True)
class PinholeCamera:
    """A camera as a sensor.yaml, the path, describes it: (3, 3) pinhole matrix K and (4, 4) pose.

    The distortion (k,) is radial-tangential, in OpenCV's order; zeros for none.
    """

    path: Path
    width_px: int
    height_px: int
    K: Array
    distortion: Array
    T_body_cam: Array

    def __post_init__(self) -> None:
        values = np.concatenate([self.K.ravel(), self.distortion, self.T_body_cam.ravel()])
        if not np.isfinite(values).all():
            raise CalibrationError(f"{self.path}: calibration holds NaN or infinity")
        if self.K[0, 0] <= 0 or self.K[1, 1] <= 0 or self.width_px <= 0 or self.height_px <= 0:
            raise CalibrationError(f"{self.path}: focal lengths and resolution must be positive")


def rectify(left: PinholeCamera, right: PinholeCamera) -> tuple[StereoRig, Remap, Remap]:
    """Return the rectified rig and both image maps; a rectified pair stays unchanged.

    Raises:
        CalibrationError: If the cameras differ in size, coincide, or are not side by side.
    """
    if (left.width_px, left.height_px) != (right.width_px, right.height_px):
        raise CalibrationError(f"{right.path}: resolution differs from {left.path}")
    T_right_left = se3.inverse(right.T_body_cam) @ left.T_body_cam
    baseline_m = float(np.linalg.norm(T_right_left[:3, 3]))
    if baseline_m < ALIGNED:
        raise CalibrationError(f"{right.path}: zero baseline to {left.path}")
    size = (left.width_px, left.height_px)
    if _is_rectified(left, right, T_right_left):
        K = left.K
        rig = StereoRig(*size, K[0, 0], K[0, 2], K[1, 2], baseline_m, left.T_body_cam)
        return rig, _unchanged, _unchanged
    R_left, R_right, P_left, P_right = cv2.stereoRectify(
        left.K, left.distortion, right.K, right.distortion, size,
        T_right_left[:3, :3], T_right_left[:3, 3:], flags=cv2.CALIB_ZERO_DISPARITY, alpha=0,
    )[:4]  # fmt: skip
    if P_right[0, 3] >= 0:
        raise CalibrationError(
            f"{right.path}: not to the right of {left.path}; are the cameras swapped or stacked?"
        )
    T_body_rectified = left.T_body_cam @ se3.pose(R_left.T, np.zeros(3))
    f, cx, cy = P_left[0, 0], P_left[0, 2], P_left[1, 2]
    rig = StereoRig(*size, f, cx, cy, baseline_m, T_body_rectified)
    return rig, _remap(left, R_left, P_left), _remap(right, R_right, P_right)


def _is_rectified(left: PinholeCamera, right: PinholeCamera, T_right_left: Array) -> bool:
    straight = np.allclose(T_right_left[:3, :3], np.eye(3), rtol=0, atol=ALIGNED)
    sideways = T_right_left[0, 3] < 0 and (np.abs(T_right_left[1:3, 3]) < ALIGNED).all()
    pinholes = not left.distortion.any() and not right.distortion.any()
    one_focal_length = np.isclose(left.K[0, 0], left.K[1, 1], rtol=ALIGNED)
    return bool(
        straight and sideways and pinholes and one_focal_length and (left.K == right.K).all()
    )


def _unchanged(image: Image) -> Image:
    return image


def _remap(camera: PinholeCamera, R: Array, P: Array) -> Remap:
    size = (camera.width_px, camera.height_px)
    maps = cv2.initUndistortRectifyMap(camera.K, camera.distortion, R, P, size, cv2.CV_16SC2)

    def apply(image: Image) -> Image:
        if image.shape != (camera.height_px, camera.width_px):
            return image  # the sequence reports the wrong size
        return np.asarray(cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR), dtype=np.uint8)

    return apply
