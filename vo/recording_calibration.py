"""Calibration of a recording by its own images: what is wrong, how sure it is, and a file of it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vo.calibration.clock_offset import ClockOffset, estimate_clock_offset
from vo.calibration.line_time import LineTime, SeenFrame, estimate_line_time
from vo.calibration.stereo_errors import (
    LIMITS,
    Quantity,
    StereoEstimate,
    StereoSamples,
    estimate_errors,
    row_residuals,
)
from vo.config import OdometrySettings
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.errors import DatasetError
from vo.contract.files import replacing
from vo.contract.inertial import ImuLog
from vo.contract.observations import Observations
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoSequence
from vo.contract.trajectory import Trajectory
from vo.odometry import StereoOdometry
from vo.stereo.right_camera import RightCamera, StereoErrors

MIN_POINTS = 40
"""Points in both images that a calibration needs."""

MAX_FRAMES, PAIR_S = 600, 0.1
"""Frames that show the line time, and time between two of them that are compared, s."""

UNOBSERVED = (
    "baseline", "focal length of both cameras", "principal points along u", "yaw in columns"
)  # fmt: skip
"""What rows do not show; it is left as it is."""


@dataclass(frozen=True)
class Calibration:
    """What the images of a recording show of the calibration of their pair.

    Attributes:
        rig: The calibration as it is stated.
        samples: The points that both cameras saw.
        estimate: Its errors.
        clocks: Offset by sensor: s, to be added to the camera's times to get the sensor's.
        line_time: Of a rolling shutter; None if motion does not show it.

    Example:
        >>> calibration = dy.calibrate(ds)
        >>> [x.name for x in calibration.quantities if x.significant]
        []
    """

    rig: StereoRig
    samples: StereoSamples
    estimate: StereoEstimate
    clocks: Mapping[str, ClockOffset]
    line_time: LineTime | None = None

    @property
    def line_time_s(self) -> float:
        """Line time by the images where it is significant, else as it is stated."""
        found = self.line_time
        if found and abs(found.value - self.rig.line_time_s) > LIMITS.sigmas * found.standard_error:
            return found.value
        return self.rig.line_time_s

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """Errors of the pair: name, value (rad, s, px or a ratio), standard error, effect in px."""
        return self.estimate.quantities

    @property
    def row_offsets_px(self) -> tuple[Array, Array]:
        """(N,) rows in the right image less the expected ones, as they are and corrected, px."""
        errors = StereoErrors(), self.estimate.errors
        before, after = (row_residuals(self.samples, self.rig, x) for x in errors)
        return before, after

    def to_dict(self) -> dict[str, Any]:
        """Return all figures, ready for JSON."""
        return {
            "points": len(self.samples),
            "quantities": [x._asdict() for x in self.quantities],
            "row_sigma_px": dict(zip(("before", "after"), self.estimate.row_px, strict=True)),
            "clock_offsets_s": {name: x._asdict() for name, x in self.clocks.items()},
            "line_time_s": self.line_time._asdict() if self.line_time else None,
            "not_observable": list(UNOBSERVED),
        }

    def save(self, path: str | Path) -> Path:
        """Write the corrected cameras as Kalibr's camchain, which every reader here takes up.

        A delay has no place in it and is a comment.

        Raises:
            DatasetError: If the file cannot be written.
        """
        out, text = (
            Path(path),
            yaml.safe_dump(self._cameras(), default_flow_style=None, sort_keys=False),
        )
        delay_ms = 1e3 * self.estimate.errors.delay_s
        with replacing(out) as partial:
            partial.write_text(f"# right camera later by {delay_ms:.3f} ms\n{text}", "utf-8")
        return out

    def _cameras(self) -> dict[str, Any]:
        rig, errors = self.rig, self.estimate.corrected
        right = RightCamera(errors, rig, np.zeros(6))
        f_px, cy_px = rig.f_px * (1 + errors.magnification), rig.cy_px + errors.row_px
        shutter = {"line_delay": self.line_time_s} if self.line_time_s else {}
        T_cam_body, T_right_left = se3.inverse(rig.T_body_cam), se3.inverse(right.T_cam_right)

        def camera(f_px: float, cy_px: float, T_cam_body: Array) -> dict[str, Any]:
            return shutter | {
                "camera_model": "pinhole",
                "intrinsics": [float(x) for x in (f_px, f_px, rig.cx_px, cy_px)],
                "distortion_model": "radtan",
                "distortion_coeffs": [0.0] * 4,
                "resolution": [rig.width_px, rig.height_px],
                "T_cam_imu": T_cam_body.tolist(),
            }

        left = camera(rig.f_px, rig.cy_px, T_cam_body)
        of_right = camera(f_px, cy_px, T_right_left @ T_cam_body)
        return {"cam0": left, "cam1": of_right | {"T_cn_cnm1": T_right_left.tolist()}}


def calibrate_recording(
    sequence: StereoSequence, imu: ImuLog | None, progress: Callable[[int, int], None] | None = None
) -> Calibration:
    """Run the estimator over a recording, and estimate what its rows and its sensors show.

    Raises:
        DatasetError: If too few points are seen by both cameras.
    """
    odometry = StereoOdometry(sequence.rig, OdometrySettings(self_calibration="auto"))
    times: list[int] = []
    poses: list[Array] = []
    seen: list[Observations] = []
    for i, frame in enumerate(sequence):
        estimate = odometry.track(frame)
        if estimate.T_odom_cam is not None:
            times.append(estimate.timestamp_ns)
            poses.append(estimate.T_odom_cam)
            seen += [_stereo(estimate.observations)] if len(seen) < MAX_FRAMES else []
        if progress:
            progress(i + 1, len(sequence))
    samples = odometry.calibration_samples
    if len(samples) < MIN_POINTS:
        raise DatasetError(
            f"{sequence.name}: {len(samples)} points are seen by both cameras in keyframes of a "
            f"moving camera, need {MIN_POINTS}: is it moving, and is the calibration nearly right?"
        )
    path = Trajectory(np.array(times), np.array(poses))
    clocks = _clock_offsets(path, sequence, imu)
    line_time = estimate_line_time(_pairs(path, seen), sequence.rig)
    errors = estimate_errors(samples, sequence.rig)
    return Calibration(sequence.rig, samples, errors, clocks, line_time)


def _stereo(seen: Observations | None) -> Observations:
    """Inliers with a disparity; none of the first frame."""
    if seen is None:
        return Observations(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0))
    return seen.select(seen.inlier & ~np.isnan(seen.disparity_px))


def _pairs(path: Trajectory, seen: list[Observations]) -> list[tuple[SeenFrame, SeenFrame]]:
    """Pairs of frames about `PAIR_S` apart, each between two frames of about the same distance."""
    seconds, T = path.timestamps_ns * 1e-9, path.T_ref_frame
    if len(seen) < 3:
        return []
    velocity = se3.log(se3.inverse(T[:-2]) @ T[2:]) / (seconds[2:] - seconds[:-2])[:, None]
    frames = [
        SeenFrame(T[i], velocity[i - 1], seen[i]) for i in range(1, min(len(seen), len(T) - 1))
    ]
    step = max(round(PAIR_S / float(np.median(np.diff(seconds)))), 1)
    return list(zip(frames[:-step], frames[step:], strict=True))


def _clock_offsets(
    path: Trajectory, sequence: StereoSequence, imu: ImuLog | None
) -> dict[str, ClockOffset]:
    """Offsets of the clocks of gyroscope and wheels, where there are some and motion shows them."""
    T = path.T_ref_frame
    steps = se3.log(se3.inverse(T[:-1]) @ T[1:])
    sums: dict[str, tuple[Array, Array, Array]] = {}
    if imu is not None and len(imu) > 1:
        seconds = np.diff(imu.timestamps_ns)[:, None] * 1e-9
        between = (imu.gyro_radps[1:] + imu.gyro_radps[:-1]) / 2 * seconds
        turned = np.concatenate([np.zeros((1, 3)), np.cumsum(between, axis=0)])
        sums["gyroscope"] = np.linalg.norm(steps[:, 3:], axis=1), imu.timestamps_ns, turned
    if (wheels := sequence.wheels) is not None and len(wheels.ticks) > 1:
        rolled = wheels.ticks.mean(axis=1)
        sums["wheels"] = np.linalg.norm(steps[:, :3], axis=1), wheels.timestamps_ns, rolled
    found = {name: estimate_clock_offset(path.timestamps_ns, *x) for name, x in sums.items()}
    return {name: x for name, x in found.items() if x is not None}
