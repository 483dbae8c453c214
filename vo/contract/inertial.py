"""Readings of an inertial unit."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from vo.contract.arrays import Array, Indices

STALE_NS = 100_000_000
"""Time between readings from which the angles between them are not known."""


@dataclass(frozen=True)
class ImuLog:
    """Readings of an inertial unit at N increasing times, in the unit's own frame.

    Attributes:
        timestamps_ns: (N,).
        gyro_radps: (N, 3) angular rate, rad/s.
        accel_mps2: (N, 3) specific force, m/s²: at rest it points up, with 9.81.
        T_body_imu: (4, 4) the unit in the carrier's body frame.

    Example:
        >>> imu = dy.open("ds").imu
        >>> imu.gyro_radps.shape == imu.accel_mps2.shape == (len(imu), 3)
        True
    """

    timestamps_ns: Indices
    gyro_radps: Array
    accel_mps2: Array
    T_body_imu: Array = field(default_factory=lambda: np.eye(4))

    def __len__(self) -> int:
        return len(self.timestamps_ns)

    def angles_at(self, timestamp_ns: int) -> tuple[float, float, float] | None:
        """Integrate the angular rate about each axis from the first reading to a time, rad.

        None before and after the readings, and where they are more than 0.1 s apart.
        """
        i = int(np.searchsorted(self.timestamps_ns, timestamp_ns, side="right"))
        if i == len(self) and i and timestamp_ns == self.timestamps_ns[-1]:
            i -= 1
        if not 0 < i < len(self):
            return None
        before_ns, after_ns = int(self.timestamps_ns[i - 1]), int(self.timestamps_ns[i])
        if after_ns - before_ns > STALE_NS:
            return None
        share = (timestamp_ns - before_ns) / (after_ns - before_ns)
        x, y, z = self._angles_rad[i - 1] + share * (self._angles_rad[i] - self._angles_rad[i - 1])
        return float(x), float(y), float(z)

    @cached_property
    def _angles_rad(self) -> Array:
        """(N, 3) angles at the readings, by the trapezoidal rule."""
        steps_s = np.diff(self.timestamps_ns)[:, None] * 1e-9
        turned = 0.5 * steps_s * (self.gyro_radps[1:] + self.gyro_radps[:-1])
        return np.concatenate([np.zeros((1, 3)), np.cumsum(turned, axis=0)])
