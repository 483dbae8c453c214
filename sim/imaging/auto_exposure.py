"""Automatic exposure: the next picture's shutter and gain, from the grey of those before."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from sim.imaging.linear_light import levels_to_light
from sim.settings import SensorSettings

EXPOSURE_MIN_MS = 0.02
DAMPING = 0.5
"""Share of the way to the wanted exposure that each picture's answer goes."""
STEP_MAX = 8.0
"""Most that one picture can ask for: a saturated or black one does not know how far to go."""


@dataclass(frozen=True)
class Exposure:
    """How one picture is taken.

    Attributes:
        time_ms: Open shutter.
        brightness: `time_ms` over that for which the scene is painted.
        gain: Amplification, 1 or more.
    """

    time_ms: float
    brightness: float
    gain: float


class AutoExposure:
    """Holds the mean grey level: longer exposures up to a limit, then gain.

    Each picture's mean says which exposure would have been right; the exposure `delay_frames`
    pictures later goes DAMPING of the way there. Call `next` and `see` once for each picture, in
    order; up to `delay_frames` calls of `next` may run ahead of `see`.
    """

    def __init__(self, settings: SensorSettings, painted_ms: float) -> None:
        """Start at the exposure for which the scene is painted.

        Args:
            settings: Of the sensor.
            painted_ms: Exposure whose pictures have the painted brightness without gain.
        """
        self._settings = settings
        self._painted_ms = painted_ms
        self._wanted = 1.0
        self._ahead = deque([self._exposure()] * settings.delay_frames)
        self._taken: deque[Exposure] = deque()

    def next(self) -> Exposure:
        """Return how to take the next picture.

        Raises:
            IndexError: If more than `delay_frames` pictures have been taken, but not seen.
        """
        self._taken.append(self._ahead.popleft())
        return self._taken[-1]

    def update(self, mean_grey: float) -> None:
        """Answer to the oldest picture that was not seen yet.

        Args:
            mean_grey: Of its pixels, 0 to 255.
        """
        settings, taken = self._settings, self._taken.popleft()
        target, met = levels_to_light(
            settings.response, np.array([settings.target_grey, max(mean_grey, 0.5)])
        )
        step = float(np.clip(target / met, 1 / STEP_MAX, STEP_MAX))
        right = taken.brightness * taken.gain * step
        self._wanted *= (right / self._wanted) ** DAMPING
        self._ahead.append(self._exposure())

    def _exposure(self) -> Exposure:
        """Split what is wanted into exposure and gain; what neither can give is forgotten."""
        shortest = EXPOSURE_MIN_MS / self._painted_ms
        longest = self._settings.exposure_max_ms / self._painted_ms
        brightness = min(max(self._wanted, shortest), longest)
        gain = min(max(self._wanted / brightness, 1.0), 10 ** (self._settings.gain_max_db / 20))
        self._wanted = brightness * gain
        return Exposure(brightness * self._painted_ms, brightness, gain)
