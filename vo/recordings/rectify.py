"""Rectification of two calibrated cameras."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import cv2
import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Image
from vo.contract.errors import CalibrationError
from vo.contract.remarks import remark
from vo.contract.rig import StereoRig

Remap = Callable[[Image], Image]

ALIGNED = 1e-6
"""Tolerance on rotation, off-axis translation and intrinsics of a rectified pair."""

MAX_BASELINE_M = 5.0
"""Baseline above which a calibration is more likely in millimetres."""

MAX_POSITION_M = 1e6
"""Largest coordinate of a camera in the body frame."""

MAX_OFF_CENTRE, F_RANGE = 0.25, (0.2, 20.0)
"""Offset of a principal point from the middle, and range of focal lengths, in image widths, outside
of which a calibration is more likely of another image size, or not in pixels."""

MAX_ZOOM = 3.0
"""Change of the focal length by rectification above which a calibration is in doubt."""

BORDER_POINTS, ZOOM = 32, 1.02
"""Points along each side of an image that must be visible, and factor of the focal length."""


class Lens(StrEnum):
    """Distortion of a lens: how its image differs from that of a pinhole."""

    RADIAL_TANGENTIAL = "radial-tangential"
    """Brown–Conrady, with OpenCV's order of coefficients."""
    EQUIDISTANT = "equidistant"
    """Kannala–Brandt, four coefficients: r = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)."""


@dataclass(frozen=True)
class Camera:
    """A camera as a calibration file, the path, describes it: (3, 3) matrix K and (4, 4) pose.

    The distortion (k,) has 4, 5, 8, 12 or 14 radial-tangential or 4 equidistant coefficients. The
    line time is that from one row's exposure to the next one's, 0 with a global shutter.
    """

    path: Path
    width_px: int
    height_px: int
    K: Array
    distortion: Array
    T_body_cam: Array
    lens: Lens = Lens.RADIAL_TANGENTIAL
    line_time_s: float = 0.0

    def __post_init__(self) -> None:
        values = np.concatenate([self.K.ravel(), self.distortion, self.T_body_cam.ravel()])
        if not np.isfinite(values).all():
            raise CalibrationError(f"{self.path}: calibration holds NaN or infinity")
        if np.abs(self.T_body_cam[:3, 3]).max() > MAX_POSITION_M:
            raise CalibrationError(f"{self.path}: the camera is too far from the body's origin")
        if self.K[0, 0] <= 0 or self.K[1, 1] <= 0 or self.width_px <= 0 or self.height_px <= 0:
            raise CalibrationError(f"{self.path}: focal lengths and resolution must be positive")
        if self.K[0, 1] != 0:
            raise CalibrationError(f"{self.path}: a camera matrix with skew; expected 0")

    @property
    def is_pinhole(self) -> bool:
        """Whether the image is that of a pinhole."""
        return self.lens is Lens.RADIAL_TANGENTIAL and not self.distortion.any()


def rectify(left: Camera, right: Camera) -> tuple[StereoRig, Remap, Remap]:
    """Return the rectified rig and both image maps.

    A rectified pair stays unchanged. If only the right camera's focal length or principal point
    differ, its image alone is mapped, so that disparity is zero at infinity.

    Raises:
        CalibrationError: If the cameras differ in size, coincide, or are not side by side.
    """
    if (left.width_px, left.height_px) != (right.width_px, right.height_px):
        raise CalibrationError(f"{right.path}: resolution differs from {left.path}")
    if left.line_time_s != right.line_time_s:
        times = f"{1e6 * left.line_time_s:g} and {1e6 * right.line_time_s:g} us"
        remark(f"{right.path}: line times of {times}: the left camera's is taken for both")
    T_right_left = se3.inverse(right.T_body_cam) @ left.T_body_cam
    baseline_m = float(np.linalg.norm(T_right_left[:3, 3]))
    if baseline_m < ALIGNED:
        raise CalibrationError(f"{right.path}: zero baseline to {left.path}")
    for camera in (left, right):
        _remark_unlikely(camera)
    if baseline_m > MAX_BASELINE_M:
        remark(f"{right.path}: the baseline is {baseline_m:.6g} m; expected metres")
    size = (left.width_px, left.height_px)
    if _is_aligned(left, right, T_right_left):
        f, cx, cy = left.K[0, 0], left.K[0, 2], left.K[1, 2]
        rig = StereoRig(*size, f, cx, cy, baseline_m, left.T_body_cam, left.line_time_s)
        same = (left.K == right.K).all()
        return rig, _unchanged, _unchanged if same else _remap(right, np.eye(3), left.K)
    R_left, R_right, K = _rectified_axes(left, right, T_right_left)
    if not 1 / MAX_ZOOM < K[0, 0] / left.K[0, 0] < MAX_ZOOM:
        zoom = f"{left.K[0, 0]:.4g} px becomes {K[0, 0]:.4g} px"
        remark(
            f"{left.path}: the focal length of {zoom} by rectification: is the distortion right?"
        )
    T_body_rectified = left.T_body_cam @ se3.pose(R_left.T, np.zeros(3))
    centre = K[0, 2], K[1, 2]
    rig = StereoRig(*size, K[0, 0], *centre, baseline_m, T_body_rectified, left.line_time_s)
    return rig, _remap(left, R_left, K), _remap(right, R_right, K)


def _remark_unlikely(camera: Camera) -> None:
    size = np.array([camera.width_px, camera.height_px])
    f, centre = camera.K[0, 0], camera.K[:2, 2]
    if (np.abs(centre / size - 0.5) > MAX_OFF_CENTRE).any():
        what = f"the principal point ({centre[0]:g}, {centre[1]:g}) px is far from the middle"
    elif not F_RANGE[0] <= f / size[0] <= F_RANGE[1]:
        what = f"a focal length of {f:g} px is unlikely"
    else:
        return
    remark(f"{camera.path}: {what} of {size[0]}x{size[1]} px: is it of another image size or unit?")


def _is_aligned(left: Camera, right: Camera, T_right_left: Array) -> bool:
    straight = np.allclose(T_right_left[:3, :3], np.eye(3), rtol=0, atol=ALIGNED)
    sideways = T_right_left[0, 3] < 0 and (np.abs(T_right_left[1:3, 3]) < ALIGNED).all()
    one_focal_length = np.isclose(left.K[0, 0], left.K[1, 1], rtol=ALIGNED)
    return bool(straight and sideways and left.is_pinhole and right.is_pinhole and one_focal_length)


def _rectified_axes(left: Camera, right: Camera, T_right_left: Array) -> tuple[Array, Array, Array]:
    """Return the rotations from each camera to the rectified axes, and the matrix K of both."""
    is_fisheye = Lens.EQUIDISTANT in (left.lens, right.lens)
    # The rotations do not depend on the distortion, only the matrices do.
    distortions = [np.zeros(4) if is_fisheye else x.distortion for x in (left, right)]
    R_left, R_right, P_left, P_right = cv2.stereoRectify(
        left.K, distortions[0], right.K, distortions[1], (left.width_px, left.height_px),
        T_right_left[:3, :3], T_right_left[:3, 3:], flags=cv2.CALIB_ZERO_DISPARITY, alpha=0,
    )[:4]  # fmt: skip
    if P_right[0, 3] >= 0:
        raise CalibrationError(
            f"{right.path}: the right camera is not to the right of the left one; are the cameras "
            "swapped or stacked?"
        )
    if is_fisheye:
        return R_left, R_right, _central_matrix(((left, R_left), (right, R_right)))
    return R_left, R_right, P_left[:, :3]


def _central_matrix(eyes: tuple[tuple[Camera, Array], ...]) -> Array:
    """Return K of the pinhole that keeps the scale in the middle of wide-angle lenses.

    A pinhole of a lens' whole angle would shrink the middle, or be infinitely wide. The axes of
    both lenses stay at their mean principal point; the focal length grows until both images fill
    the pinhole.
    """
    f = float(np.mean([camera.K[[0, 1], [0, 1]] for camera, _ in eyes]))
    axes = np.mean([R[:2, 2] / R[2, 2] for _, R in eyes], axis=0)
    centre = np.mean([camera.K[:2, 2] for camera, _ in eyes], axis=0)
    while True:
        K = np.array([[f, 0, 0], [0, f, 0], [0, 0, 1.0]])
        K[:2, 2] = centre - f * axes
        if all(_fills(camera, R, K) for camera, R in eyes):
            return K
        if f > 4 * max(camera.width_px for camera, _ in eyes):
            raise CalibrationError(f"{eyes[1][0].path}: the images of the cameras do not overlap")
        f *= ZOOM


def _fills(camera: Camera, R: Array, K: Array) -> bool:
    """Whether the border of the rectified image with matrix K is inside the camera's image."""
    size = np.array([camera.width_px, camera.height_px]) - 1.0
    along = np.linspace(0, 1, BORDER_POINTS)
    ends = np.repeat([0.0, 1.0], BORDER_POINTS)
    border = np.stack([np.r_[np.tile(along, 2), ends], np.r_[ends, np.tile(along, 2)]], -1) * size
    rays = np.column_stack([(border - K[:2, 2]) / K[0, 0], np.ones(len(border))]) @ R
    if (rays[:, 2] <= 0).any():
        return False
    if camera.lens is Lens.EQUIDISTANT:
        points = (rays[:, :2] / rays[:, 2:])[None]
        pixels = cv2.fisheye.distortPoints(points, camera.K, camera.distortion)[0]
    else:
        nothing = np.zeros(3)
        pixels = cv2.projectPoints(rays, nothing, nothing, camera.K, camera.distortion)[0][:, 0]
    return bool((pixels >= 0).all() and (pixels <= size).all())


def _unchanged(image: Image) -> Image:
    return image


def _remap(camera: Camera, R: Array, K: Array) -> Remap:
    size = (camera.width_px, camera.height_px)
    module = cv2.fisheye if camera.lens is Lens.EQUIDISTANT else cv2
    maps = module.initUndistortRectifyMap(camera.K, camera.distortion, R, K, size, cv2.CV_16SC2)

    def apply(image: Image) -> Image:
        if image.shape != (camera.height_px, camera.width_px):
            return image  # the sequence reports the wrong size
        return np.asarray(cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR), dtype=np.uint8)

    return apply
