"""Calibration of recordings by their own images."""

from collections.abc import Callable

from driftyard.dataset import Dataset, PathLike, dataset_of
from driftyard.failures import in_one_family
from vo.recording_calibration import Calibration, calibrate_recording
from vo.recordings.readers import read_imu


@in_one_family
def calibrate(
    dataset: Dataset | PathLike, *, progress: Callable[[int, int], None] | None = None
) -> Calibration:
    """Estimate what a recording shows of the calibration of its pair, with standard errors.

    The rows in which both cameras see the same points give their relative rotation, the delay of
    the right camera, and the differences of principal points along v and of focal lengths. A
    gyroscope and wheels give the offsets of their clocks; changes of the motion give the line time
    of a rolling shutter (`line_time`). The baseline, the common focal length
    and the principal points along u change no row; they are left as they are.

    Args:
        dataset: An open recording, or its folder.
        progress: Called with the number of frames done and that of all frames.

    Raises:
        DatasetError: If the recording is invalid, or too few points are seen by both cameras.

    Example:
        >>> calibration = dy.calibrate(ds)
        >>> calibration.quantities[0].name, calibration.estimate.errors.delay_s
        ('pitch_rad', 0.0)
        >>> calibration.save("cameras.yaml").name
        'cameras.yaml'
    """
    opened = dataset_of(dataset)
    return calibrate_recording(opened.sequence, read_imu(opened.path), progress)
