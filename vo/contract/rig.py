"""The rectified stereo pair: one focal length, parallel axes, rows aligned."""

from dataclasses import dataclass, field

import numpy as np

from vo.contract.arrays import Array
from vo.contract.errors import CalibrationError


@dataclass(frozen=True)
class StereoRig:
    """Calibration of a rectified pair; `cam` is the left camera in OpenCV axes.

    Attributes:
        f_px: Focal length of both cameras and both axes.
        cx_px: Principal point of both cameras along u; (W - 1) / 2 when centred; so cy_px along v.
        baseline_m: Distance of the right camera along the left camera's x axis, > 0.
        T_body_cam: (4, 4) left camera in the carrier's body frame.
        line_time_s: Time from the exposure of a row to that of the next one below; 0: global
            shutter. A frame's timestamp is that of its middle row.

    Raises:
        CalibrationError: If a value is not finite, or size, focal length or baseline not positive.

    Example:
        >>> rig = dy.StereoRig(640, 480, f_px=450.0, cx_px=319.5, cy_px=239.5, baseline_m=0.09)
        >>> rig.project(np.array([0.1, 0.0, 2.0])).tolist()
        [342.0, 239.5, 20.25]
    """

    width_px: int
    height_px: int
    f_px: float
    cx_px: float
    cy_px: float
    baseline_m: float
    T_body_cam: Array = field(default_factory=lambda: np.eye(4))
    line_time_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("width_px", "height_px", "f_px", "baseline_m"):
            value = getattr(self, name)
            if not np.isfinite(value) or value <= 0:
                raise CalibrationError(f"calibration: {name} is {value}, must be positive")
        for name in ("cx_px", "cy_px", "line_time_s"):
            if not np.isfinite(getattr(self, name)):
                raise CalibrationError(f"calibration: {name} is {getattr(self, name)}")
        T = np.asarray(self.T_body_cam, dtype=float)
        orthonormal = T.shape == (4, 4) and np.allclose(
            T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-3
        )
        if not orthonormal or not np.isfinite(T).all() or np.linalg.det(T[:3, :3]) < 0:
            raise CalibrationError("calibration: T_body_cam is not a rigid 4x4 transform")

    @property
    def K(self) -> Array:
        """(3, 3) pinhole matrix of both cameras, pixels."""
        return np.array([[self.f_px, 0, self.cx_px], [0, self.f_px, self.cy_px], [0, 0, 1.0]])

    def project(self, points_cam: Array) -> Array:
        """Project (..., 3) points_cam in metres to (..., 3) (u_left, v, disparity) in pixels.

        u = f x / z + cx, v = f y / z + cy, d = f b / z (thesis eqs. 2.1, 2.5); NaN if z <= 0.
        """
        z = points_cam[..., 2]
        inverse_z = np.divide(1.0, z, out=np.full_like(z, np.nan), where=z > 0)
        u = self.f_px * points_cam[..., 0] * inverse_z + self.cx_px
        v = self.f_px * points_cam[..., 1] * inverse_z + self.cy_px
        return np.stack([u, v, self.f_px * self.baseline_m * inverse_z], axis=-1)

    def triangulate(self, pixels_left: Array, disparity_px: Array) -> Array:
        """Back-project (..., 2) left pixels with (...,) disparities u_left - u_right to points_cam.

        (..., 3) points_cam are in metres, Z = f b / d (thesis eq. 2.5); NaN unless d > 0.
        """
        d = np.asarray(disparity_px, dtype=float)
        inverse_d = np.divide(1.0, d, out=np.full_like(d, np.nan), where=d > 0)
        z = self.f_px * self.baseline_m * inverse_d
        x = (pixels_left[..., 0] - self.cx_px) * z / self.f_px
        y = (pixels_left[..., 1] - self.cy_px) * z / self.f_px
        return np.stack([x, y, z], axis=-1)

    def normalized(self, pixels: Array) -> Array:
        """Map (..., 2) pixels to normalised image coordinates (x/z, y/z)."""
        return (pixels - np.array([self.cx_px, self.cy_px])) / self.f_px
