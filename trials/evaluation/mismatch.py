"""Mismatch of the frames of an estimate and the truth: the body's, or another convention."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from trials.evaluation.alignment import Pair, associate
from trials.evaluation.runs import SavedRun
from trials.evaluation.time_shift import find_time_shift
from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import TrajectoryError
from vo.contract.remarks import remark
from vo.contract.trajectory import Trajectory

MAX_MOTIONS = 200
"""Number of motions, evenly spaced, from which a mismatch is found."""

MIN_ERROR, MAX_RATIO = 0.005, 0.4
"""Relative error of motions from which a mismatch is looked for, and the largest share that it may
leave: of the errors of estimators, a constant transform leaves 0.6 and more."""

MIN_ANGLE_DEG, MIN_LEVER_M = 0.5, 0.01
"""Smallest rotation and lever arm of which there is a remark."""

MIN_SCALE = 2.0
"""Factor between lengths from which they are in another unit; less is an error of the estimator."""

MIN_SCALE_M = 1e-3
"""Motion, root mean square, below which nothing is looked for."""

MIN_ROTATION_RAD = 0.05
"""Rotation that an error of rotation is compared with where the rig hardly turns."""

PRIOR = 0.05
"""Weight of the assumption that rotation and lever arm are zero, where the motion shows neither."""


class Frame(StrEnum):
    """Frame whose poses a trajectory file holds."""

    CAM = "cam"
    """The (rectified) left camera."""
    BODY = "body"
    """The body frame of the recording's calibration: the inertial unit's in EuRoC and TUM-VI."""

    def T_frame_cam(self, T_body_cam: Array) -> Array:
        """Return the left camera (4, 4) in this frame."""
        return T_body_cam if self is Frame.BODY else np.eye(4)


def remark_mismatches(
    truth: Trajectory, run: SavedRun, T_body_cam: Array, frame: Frame = Frame.CAM
) -> None:
    """Issue a remark on a shift of time, and on poses that are not the left camera's.

    Args:
        truth: T_world_cam.
        run: The run, its poses converted from `frame` to those of the left camera.
        T_body_cam: (4, 4) left camera in the body frame.
        frame: Frame of the poses in the file.
    """
    if shift := find_time_shift(truth, run.trajectory):
        remark(f"{run.path}: {shift}")
    try:
        pair = associate(truth, run.trajectory)
    except TrajectoryError:
        return
    other = Frame.CAM if frame is Frame.BODY else Frame.BODY
    T_cam_frame = se3.inverse(frame.T_frame_cam(T_body_cam))
    if mismatch := frame_mismatch(pair, T_cam_frame @ other.T_frame_cam(T_body_cam), other):
        remark(f"{run.path}: {mismatch}")


@dataclass(frozen=True)
class Motions:
    """K true motions (K, 4, 4) of the left camera, and the scales of relative errors."""

    true: Array
    starts: Indices
    ends: Indices
    scale_m: float
    scale_rad: float

    @staticmethod
    def of(pair: Pair) -> "Motions":
        """Take motions over an eighth of the sequence."""
        step = max(1, len(pair.timestamps_ns) // 8)
        starts = np.arange(len(pair.timestamps_ns) - step)
        starts = starts[:: max(1, len(starts) // MAX_MOTIONS)]
        true = _motions(pair.T_world_cam, starts, starts + step)
        scale_m = _rms_length(true)
        scale_rad = float(np.sqrt(np.mean(se3.rotation_angle(true) ** 2)))
        return Motions(true, starts, starts + step, scale_m, max(scale_rad, MIN_ROTATION_RAD))

    def errors(self, T_odom_cam: Array) -> Array:
        """Return relative errors (K, 6) of motions of poses (N, 4, 4): translation, rotation."""
        error = se3.inverse(self.true) @ _motions(T_odom_cam, self.starts, self.ends)
        scaled = (error[:, :3, 3] / self.scale_m, se3.rotation_vector(error) / self.scale_rad)
        return np.concatenate(scaled, axis=1)

    def rms(self, T_odom_cam: Array) -> float:
        """Return the root mean square of the relative errors of the motions."""
        return float(np.sqrt(np.mean(np.sum(self.errors(T_odom_cam) ** 2, axis=1))))


def frame_mismatch(pair: Pair, T_est_cam: Array, other: Frame) -> str:
    """Describe the mismatch that explains most of the errors of motions; empty if none does.

    Args:
        pair: Truth and estimate.
        T_est_cam: (4, 4) from the left camera to the estimated frame if that is the other one.
        other: The other value of the option --frame.
    """
    if not pair.has_attitude or len(pair.timestamps_ns) < 3:
        return ""
    motions = Motions.of(pair)
    if motions.scale_m < MIN_SCALE_M or (before := motions.rms(pair.T_odom_cam)) < MIN_ERROR:
        return ""
    known: dict[str, Callable[[Array], Array]] = {
        f"its poses fit those of the {other}; use --frame {other}": lambda T: T @ T_est_cam,
        "its quaternions fit in the order w, x, y, z": lambda T: _reordered(T, [1, 2, 3, 0]),
        "its quaternions fit in the order x, y, z, w": lambda T: _reordered(T, [3, 0, 1, 2]),
        "its poses fit when inverted, as the world in the camera frame": se3.inverse,
    }
    scale = motions.scale_m / max(
        _rms_length(_motions(pair.T_odom_cam, motions.starts, motions.ends)), 1e-9
    )
    if max(scale, 1 / scale) > MIN_SCALE:
        text = f"its positions fit when multiplied by {scale:.3g}; are they in metres?"
        known[text] = lambda T: se3.pose(T[:, :3, :3], scale * T[:, :3, 3])
    errors = {text: motions.rms(change(pair.T_odom_cam)) for text, change in known.items()}
    best = min(errors, key=lambda text: errors[text])
    if errors[best] < MAX_RATIO * before:
        return best
    T_est_cam = _constant_transform(motions, pair.T_odom_cam)
    angle_deg = float(np.degrees(se3.rotation_angle(T_est_cam)))
    lever_m = float(np.linalg.norm(T_est_cam[:3, 3]))
    after = motions.rms(pair.T_odom_cam @ T_est_cam)
    if after >= MAX_RATIO * before or (angle_deg < MIN_ANGLE_DEG and lever_m < MIN_LEVER_M):
        return ""
    return (
        f"its poses fit those of a frame that is turned by {angle_deg:.1f}° from the left camera "
        f"and {lever_m:.2f} m away"
    )


def _rms_length(T: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(T[:, :3, 3] ** 2, axis=1))))


def _motions(T: Array, starts: Indices, ends: Indices) -> Array:
    return se3.inverse(T[starts]) @ T[ends]


def _reordered(T: Array, order: list[int]) -> Array:
    """Return poses whose quaternions, scalar first, are read in another order."""
    return se3.from_quat_wxyz(se3.to_quat_wxyz(T)[:, order], T[:, :3, 3])


def _constant_transform(motions: Motions, T_odom_est: Array) -> Array:
    """Fit T_est_cam (4, 4), constant: A X = X B of hand-eye calibration, by least squares.

    It starts from the rotation that aligns translations and rotation vectors.
    """
    estimated = _motions(T_odom_est, motions.starts, motions.ends)

    def vectors(T: Array) -> Array:
        turns = se3.rotation_vector(T) / motions.scale_rad
        return np.concatenate([T[:, :3, 3] / motions.scale_m, turns])

    scatter = vectors(estimated).T @ vectors(motions.true)
    R_est_cam, _ = se3.nearest_rotation(scatter + PRIOR * np.trace(np.abs(scatter)) * np.eye(3))
    start = np.concatenate([np.zeros(3), Rotation.from_matrix(R_est_cam).as_rotvec()])

    def residuals(x: Array) -> Array:
        T_est_cam = se3.pose(Rotation.from_rotvec(x[3:]).as_matrix(), x[:3])
        errors = motions.errors(T_odom_est @ T_est_cam).ravel()
        return np.concatenate([errors / np.sqrt(len(motions.starts)), PRIOR * x])

    x = least_squares(residuals, start, max_nfev=30).x
    return se3.pose(Rotation.from_rotvec(x[3:]).as_matrix(), x[:3])
