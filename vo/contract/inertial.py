"""Readings of an inertial unit."""

from dataclasses import dataclass, field

import numpy as np

from vo.contract.arrays import Array, Indices


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
