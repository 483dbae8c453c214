"""A trajectory, and its writing as TUM text."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array, Indices
from vo.contract.errors import TrajectoryError
from vo.contract.files import write_text

NS_PER_S = 1_000_000_000

TUM_HEADER = "# timestamp tx ty tz qx qy qz qw"


@dataclass(frozen=True)
class Trajectory:
    """Poses (N, 4, 4) of a frame (usually `cam`) in a fixed one (`world`, `odom`), over time.

    The timestamps (N,) strictly increase. Of a truth without attitude, the poses are positions of
    `point_cam` (3,), metres in the left camera's frame, without rotation; None for full poses.

    Example:
        >>> truth = dy.open("ds").truth
        >>> truth.at(truth.timestamps_ns[:1] + 1_000_000).T_ref_frame.shape
        (1, 4, 4)
    """

    timestamps_ns: Indices
    T_ref_frame: Array
    point_cam: Array | None = None

    def __post_init__(self) -> None:
        if self.T_ref_frame.shape != (len(self.timestamps_ns), 4, 4):
            raise TrajectoryError(
                f"trajectory: {len(self.timestamps_ns)} times but poses {self.T_ref_frame.shape}"
            )
        if not np.isfinite(self.T_ref_frame).all():
            raise TrajectoryError("trajectory: a pose is not finite")
        if (np.diff(self.timestamps_ns) <= 0).any():
            raise TrajectoryError("trajectory: timestamps must increase")

    def __len__(self) -> int:
        return len(self.timestamps_ns)

    def at(self, timestamps_ns: Indices) -> "Trajectory":
        """Interpolate (linear in position, spherical in rotation) at times within the range.

        Raises:
            TrajectoryError: If a time lies outside the trajectory.
        """
        times = np.asarray(timestamps_ns, dtype=np.int64)
        if len(times) == 0:
            return Trajectory(times, np.zeros((0, 4, 4)))
        start, end = self.timestamps_ns[[0, -1]]
        if times[0] < start or times[-1] > end:
            raise TrajectoryError(
                f"trajectory covers {start}..{end} ns, requested {times[0]}..{times[-1]} ns"
            )
        # Relative to the first time, seconds in double precision are exact to far below 1 ns.
        known, queried = (self.timestamps_ns - start) / NS_PER_S, (times - start) / NS_PER_S
        if len(known) == 1:
            return replace(
                self, timestamps_ns=times, T_ref_frame=self.T_ref_frame.repeat(len(times), axis=0)
            )
        T_ref_frame = se3.interpolate(known, self.T_ref_frame, queried)
        return replace(self, timestamps_ns=times, T_ref_frame=T_ref_frame)


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write `timestamp tx ty tz qx qy qz qw` lines: seconds, metres, scalar last."""
    write_text(path, "\n".join([TUM_HEADER, *tum_lines(trajectory)]) + "\n")


def tum_lines(trajectory: Trajectory) -> list[str]:
    """Format the lines of a TUM trajectory, without the header."""
    t = trajectory.T_ref_frame[:, :3, 3]
    quat_wxyz = se3.to_quat_wxyz(trajectory.T_ref_frame)
    rows = np.hstack([t, quat_wxyz[:, 1:], quat_wxyz[:, :1]])
    lines: list[str] = []
    for time, row in zip(trajectory.timestamps_ns, rows, strict=True):
        seconds, nanoseconds = divmod(int(time), NS_PER_S)
        lines.append(f"{seconds}.{nanoseconds:09d} " + " ".join(f"{x:.9f}" for x in row))
    return lines
