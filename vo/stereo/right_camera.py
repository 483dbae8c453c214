"""The right camera where it is: turned, moved or later than the calibration of the pair says.

A rectified pair has a right camera with parallel axes, beside the left one, exposed at the same
time. Errors of this are small, so images stay as they are: patches are searched in the rows where
the right camera sees them, and what is found there is turned into the disparity of a rectified
pair.
"""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame


@dataclass(frozen=True)
class StereoErrors:
    """Errors of a rectified pair's calibration: the true right camera against the stated one.

    Attributes:
        pitch_rad: Rotation about x, positive upwards.
        roll_rad: Rotation about z, positive clockwise as seen.
        keystone_rad: What a rotation about y, positive to the right, does to rows. What it does to
            columns, calibrations set off by the principal point, and rows do not show that.
        delay_s: Time from the exposure of the left camera to that of the right one.
        row_px: Principal point along v, less that of the left camera.
        magnification: Focal length over that of the left camera, less one.
        drop: Position along y of the left camera, of the baseline.
        advance: Position along z of the left camera, of the baseline.
    """

    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    keystone_rad: float = 0.0
    delay_s: float = 0.0
    row_px: float = 0.0
    magnification: float = 0.0
    drop: float = 0.0
    advance: float = 0.0

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of the quantities in the order of their vector."""
        return tuple(x.name for x in fields(cls))

    @property
    def vector(self) -> Array:
        """(8,) in the order of the attributes."""
        return np.array([getattr(self, name) for name in self.names()])


@dataclass(frozen=True)
class RightCamera:
    """The right camera at one frame, or at the frames of N pixels.

    Attributes:
        errors: Of the calibration.
        rig: The calibration.
        velocity: (6,) or (N, 6) of the left camera, tangent (v m/s, w rad/s) in its own frame.
    """

    errors: StereoErrors
    rig: StereoRig
    velocity: Array

    @property
    def T_cam_right(self) -> Array:
        """(..., 4, 4), metres."""
        R_cam_right, t = self._pose
        return se3.pose(R_cam_right, self.rig.baseline_m * t)

    @cached_property
    def _pose(self) -> tuple[Array, Array]:
        """R_cam_right (..., 3, 3) and the right camera's position (..., 3) over the baseline."""
        e = self.errors
        (cp, cr), (sp, sr) = (f([e.pitch_rad, e.roll_rad]) for f in (np.cos, np.sin))
        R = np.array([[cr, -sr, 0], [cp * sr, cp * cr, -sp], [sp * sr, sp * cr, cp]])  # X, then Z
        t = np.array([1.0, e.drop, e.advance])
        if not e.delay_s:
            return R, t
        moved, turned = np.split(e.delay_s * self.velocity, 2, axis=-1)
        S = se3.skew(turned)
        R_cam_later = np.eye(3) + S + S @ S / 2  # of a small rotation
        return R_cam_later @ R, moved / self.rig.baseline_m + R_cam_later @ t

    @property
    def _f_px(self) -> float:
        return self.rig.f_px * (1 + self.errors.magnification)

    def see(self, pixels: Array, disparity_px: Array) -> Array:
        """Pixels (N, 2) where it sees what the left camera sees at pixels (N, 2).

        The disparities (N,) are those of a rectified pair; they may be zero or less.
        """
        R_cam_right, t = self._pose
        points = self._rays(pixels) - disparity_px[:, None] / self.rig.f_px * t
        in_right = (points[:, None, :] @ R_cam_right)[:, 0, :]
        seen = in_right[:, :2] / in_right[:, 2:]
        seen[:, 1] *= 1 - self.errors.keystone_rad * seen[:, 0]
        return self._f_px * seen + [self.rig.cx_px, self.rig.cy_px + self.errors.row_px]

    def disparity(self, pixels: Array, u_right: Array) -> Array:
        """Disparity (N,) of a rectified pair, of pixels (N, 2) that it sees in columns (N,).

        A column is a plane through the camera, which the ray of the left pixel meets in the point.
        """
        R_cam_right, t = self._pose
        column = np.stack([np.full(len(u_right), self._f_px), self.rig.cx_px - u_right], axis=-1)
        plane = (R_cam_right[..., [0, 2]] @ column[..., None])[..., 0]
        along_ray, along_baseline = (np.sum(plane * x, axis=-1) for x in (self._rays(pixels), t))
        return self.rig.f_px * along_ray / along_baseline

    def _rays(self, pixels: Array) -> Array:
        return np.column_stack([self.rig.normalized(pixels), np.ones(len(pixels))])


@dataclass(frozen=True)
class MisalignedFrame(StereoFrame):
    """A pair whose right camera is not where the calibration says."""

    right_camera: RightCamera | None = None


def right_camera_of(frame: StereoFrame) -> RightCamera | None:
    """Return the right camera of a misaligned frame; None of others."""
    return frame.right_camera if isinstance(frame, MisalignedFrame) else None
