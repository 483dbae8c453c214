"""A stereo sequence: the input of an estimator."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vo.contract.arrays import Image, Indices
from vo.contract.errors import DatasetError, ImageError
from vo.contract.inertial import ImuLog
from vo.contract.rig import StereoRig

STALE_NS = 250_000_000
"""Age from which a reading is ignored: silent encoders would look like wheels at rest."""


@dataclass(frozen=True)
class WheelLog:
    """Readings (N, 2) of the left and the right wheel encoder at increasing times (N,).

    Ticks are counted since the start, forward positive.

    Example:
        >>> dy.open("ds").wheels.at(1_000_000_000)
        (0, 0)
    """

    timestamps_ns: Indices
    ticks: Indices

    def at(self, timestamp_ns: int) -> tuple[int, int] | None:
        """Return the last reading at or before a time; None if there is none or it is stale."""
        i = int(np.searchsorted(self.timestamps_ns, timestamp_ns, side="right")) - 1
        if i < 0 or timestamp_ns - int(self.timestamps_ns[i]) > STALE_NS:
            return None
        left, right = self.ticks[i]
        return int(left), int(right)


@dataclass(frozen=True)
class StereoFrame:
    """One rectified grey pair, (H, W) uint8 each, exposed at the same time, in the middle of it.

    The wheel ticks are those of the left and the right encoder, forward positive; the gyroscope's
    angles, rad, are integrals of its rates since the start, about its axes; None without.

    Example:
        >>> frame = dy.StereoFrame(0, np.zeros((48, 64), np.uint8), np.zeros((48, 64), np.uint8))
        >>> dy.StereoOdometry(dy.StereoRig(64, 48, 50.0, 31.5, 23.5, 0.09)).track(frame).reason
        'left image dark (mean grey 0.0), right image dark (mean grey 0.0)'
    """

    timestamp_ns: int
    left: Image
    right: Image
    wheel_ticks: tuple[int, int] | None = None
    gyro_rad: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class StereoSequence:
    """Calibration, (N,) increasing times, N >= 1, and a loader of rectified pairs; no ground truth.

    `load` maps a frame index to its (left, right) images. `load_imu` reads the inertial readings,
    as late as with the first frame, for long recordings have many.
    """

    name: str
    rig: StereoRig
    timestamps_ns: Indices
    load: Callable[[int], tuple[Image, Image]]
    wheels: WheelLog | None = None
    load_imu: Callable[[], ImuLog | None] | None = None

    def __post_init__(self) -> None:
        if len(self.timestamps_ns) == 0:
            raise DatasetError(f"{self.name}: the sequence has no frames")
        steps = np.diff(self.timestamps_ns)
        if (steps <= 0).any():
            i = int(np.argmax(steps <= 0)) + 1
            raise DatasetError(
                f"{self.name}: time must increase, but frame {i} is at {self.timestamps_ns[i]} ns "
                f"after {self.timestamps_ns[i - 1]} ns"
            )

    def __len__(self) -> int:
        return len(self.timestamps_ns)

    @cached_property
    def imu(self) -> ImuLog | None:
        """Inertial readings; None without."""
        return self.load_imu() if self.load_imu else None

    def __getitem__(self, i: int) -> StereoFrame:
        """Load frame i.

        Raises:
            ImageError: If an image is missing, damaged or not of the calibrated size.
        """
        left, right = self.load(i)
        expected = (self.rig.height_px, self.rig.width_px)
        for side, image in (("left", left), ("right", right)):
            if image.shape != expected:
                raise ImageError(
                    f"{self.name}: {side} image of frame {i} is {image.shape[1]}x{image.shape[0]}, "
                    f"the calibration says {expected[1]}x{expected[0]}"
                )
        timestamp_ns = int(self.timestamps_ns[i])
        ticks = self.wheels.at(timestamp_ns) if self.wheels else None
        angles_rad = self.imu.angles_at(timestamp_ns) if self.imu else None
        return StereoFrame(timestamp_ns, left, right, ticks, angles_rad)

    def __iter__(self) -> Iterator[StereoFrame]:
        return (self[i] for i in range(len(self)))
