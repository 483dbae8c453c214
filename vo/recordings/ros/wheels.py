"""Wheel encoders of a bag: angles of two joints."""

import re

import numpy as np

from vo.contract.errors import DatasetError
from vo.contract.sequence import WheelLog
from vo.recordings.ros.topics import Source

TICKS_PER_TURN = 2000
"""Ticks to which angles are rounded: those of this project's encoders."""

WHEELS = tuple(
    re.compile(rf"(?<![a-z]){side}.*wheel|wheel.*(?<![a-z]){side}") for side in ("left", "right")
)
"""Names of the joints, such as `left_wheel_joint` and `wheel_right_joint`."""


def read_bag_wheels(source: Source) -> WheelLog | None:
    """Read the ticks of the joints that are named as a left and a right wheel; None without them.

    Raises:
        DatasetError: If a message has no angle of a joint that it names.
    """
    topic, bag = source.wheels, source.bag
    if topic is None:
        return None
    times = bag.times_ns(topic)
    angles_rad = np.zeros((len(times), 2))
    columns: list[int] = []
    kept: list[int] = []
    for i in range(len(times)):
        message = bag.read(topic, i)
        named = [[k for k, x in enumerate(message.name) if w.search(x.lower())] for w in WHEELS]
        if [len(x) for x in named] != [1, 1]:  # of other joints
            continue
        columns = [x[0] for x in named]
        if max(columns) >= len(message.position):
            raise DatasetError(f"{bag.path}: {topic}: the message at {times[i]} ns has no angles")
        angles_rad[i] = message.position[columns]
        if np.isfinite(angles_rad[i]).all():
            kept.append(i)
    ticks = np.rint(angles_rad[kept] * (TICKS_PER_TURN / (2 * np.pi))).astype(np.int64)
    return WheelLog(times[kept], ticks) if kept else None
