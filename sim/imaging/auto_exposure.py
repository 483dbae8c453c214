"""Automatic exposure: exposure time and gain from the mean grey level of earlier images."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from sim.camera_settings import SensorSettings
from sim.imaging.linear_light import curve_of, levels_to_light

EXPOSURE_MIN_MS = 0.02
DAMPING = 0.5
"""Exponent of each correction: 1 would go to the wanted exposure at once."""
STEP_MAX = 8.0
"""Largest correction from one image: a saturated or black one does not measure the light."""


@dataclass(frozen=True)
class Exposure:
    """Exposure time of an image, also over the reference exposure time, and gain of at least 1."""

    time_ms: float
    brightness: float
    gain: float


class AutoExposure:
    """Control of the mean grey level by exposure time up to a limit, then by gain.

    Each image's mean grey level gives the right exposure; the exposure `delay_frames` images
    later is a damped step towards it. Call `next` and `update` once for each image, in order;
    `next` may be up to `delay_frames` calls ahead of `update`.
    """

    def __init__(self, settings: SensorSettings, reference_ms: float) -> None:
        """Start at the reference exposure time, whose images have the rendered brightness."""
        self._settings = settings
        self._reference_ms = reference_ms
        self._wanted = 1.0
        self._queue = deque([self._exposure()] * settings.delay_frames)
        self._pending: deque[Exposure] = deque()

    def next(self) -> Exposure:
        """Return the exposure of the next image.

        Raises:
            IndexError: If more than `delay_frames` images lack their `update`.
        """
        self._pending.append(self._queue.popleft())
        return self._pending[-1]

    def update(self, mean_grey: float) -> None:
        """Correct the exposure by the mean grey level, 0 to 255, of the oldest pending image."""
        settings, taken = self._settings, self._pending.popleft()
        black, white = settings.black_grey, settings.white_grey
        levels = np.clip([settings.target_grey, mean_grey], black + 0.5, white)
        target, measured = levels_to_light(curve_of(settings), levels)
        step = float(np.clip(target / measured, 1 / STEP_MAX, STEP_MAX))
        right = taken.brightness * taken.gain * step
        self._wanted *= (right / self._wanted) ** DAMPING
        self._queue.append(self._exposure())

    def _exposure(self) -> Exposure:
        """Split the wanted light into exposure time and gain, and limit it to their ranges."""
        shortest = EXPOSURE_MIN_MS / self._reference_ms
        longest = self._settings.exposure_max_ms / self._reference_ms
        brightness = min(max(self._wanted, shortest), longest)
        gain = min(max(self._wanted / brightness, 1.0), 10 ** (self._settings.gain_max_db / 20))
        self._wanted = brightness * gain
        return Exposure(brightness * self._reference_ms, brightness, gain)
