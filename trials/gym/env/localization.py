"""Where the rover believes to be: by the truth, by its wheels, or by an estimator."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim.world.rover import TRACK_M, WHEEL_RADIUS_M
from trials.estimators.choice import ESTIMATORS, make_estimator
from trials.estimators.plugins.guard import Guarded
from vo.contract import se3
from vo.contract.arrays import Array, Image
from vo.contract.errors import SettingsError
from vo.contract.estimator import Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame


@dataclass(frozen=True)
class Sight:
    """What there is to localise by, at one moment.

    Attributes:
        time_ns: Of the picture.
        pair: Left and right grey image; None if the picture was lost or nobody asked for one.
        wheel_ticks: Of both encoders.
        T_world_body: (4, 4) the truth, for `truth` alone.
    """

    time_ns: int
    pair: tuple[Image, Image] | None
    wheel_ticks: tuple[int, int]
    T_world_body: Array


@dataclass(frozen=True)
class Belief:
    """Where the rover believes to be.

    Attributes:
        T_world_body: (4, 4); if the status is `lost`, the last one before.
        status: Of the estimate.
        reason: Why it is not `tracked`.
    """

    T_world_body: Array
    status: Status
    reason: str = ""


class Localization(Protocol):
    """Follows a rover from a start that it knows."""

    def update(self, sight: Sight) -> Belief:
        """Take what there is at the next moment; the first call defines the start."""
        ...


class Truth:
    """Knows."""

    def update(self, sight: Sight) -> Belief:
        """Return the truth."""
        return Belief(sight.T_world_body, Status.TRACKED)


DRIFT = "drift:"
DRIFT_DEG_PER_M = 0.25
"""Rotation error beside one per cent of drift: what the estimator shows over all scenes."""


class Drifting:
    """The truth with an injected drift: a random walk of position and heading.

    It grows with what the faster wheel rolls, so that turning on the spot has its errors too.
    """

    def __init__(self, percent: float, seed: int) -> None:
        """Choose how much.

        Args:
            percent: Mean error of position after one metre, had the heading no error.
            seed: Of the walk.
        """
        self._rng = np.random.default_rng([seed, 2])
        across_m = percent / 100 / math.sqrt(math.pi / 2)  # of a mean length of a 2-D Gaussian
        turned_rad = math.radians(DRIFT_DEG_PER_M * percent) * math.sqrt(math.pi / 2)
        self._sigmas = np.array([across_m, across_m, 0, 0, 0, turned_rad])
        self._belief: Array | None = None

    def update(self, sight: Sight) -> Belief:
        """Go on by the true motion and an error."""
        truth = sight.T_world_body
        if self._belief is None:
            self._belief, self._last = truth, truth
            return Belief(self._belief, Status.START)
        motion = se3.inverse(self._last) @ truth
        ahead_m = float(np.linalg.norm(motion[:3, 3]))
        rolled_m = ahead_m + TRACK_M / 2 * float(se3.rotation_angle(motion))
        error = self._rng.normal(size=6) * self._sigmas * math.sqrt(rolled_m)
        self._belief = self._belief @ motion @ se3.exp(error)
        self._last = truth
        return Belief(self._belief, Status.TRACKED)


class Wheels:
    """Dead reckoning by the wheels, along arcs in the plane that the rover stood on at first."""

    def __init__(self, ticks_per_turn: int) -> None:
        self._metres_per_tick = 2 * np.pi * WHEEL_RADIUS_M / ticks_per_turn
        self._T_world_body: Array | None = None
        self._ticks = (0, 0)

    def update(self, sight: Sight) -> Belief:
        """Go on by what the wheels turned."""
        if self._T_world_body is None:
            self._T_world_body, self._ticks = sight.T_world_body, sight.wheel_ticks
            return Belief(self._T_world_body, Status.START)
        left_m, right_m = (np.array(sight.wheel_ticks) - self._ticks) * self._metres_per_tick
        ahead_m, turned_rad = (left_m + right_m) / 2, (right_m - left_m) / TRACK_M
        step = se3.exp(np.array([ahead_m, 0, 0, 0, 0, turned_rad]))
        self._T_world_body, self._ticks = self._T_world_body @ step, sight.wheel_ticks
        return Belief(self._T_world_body, Status.TRACKED)


class Visual:
    """An estimator, from the body's true pose at its first frame on."""

    def __init__(self, name: str, rig: StereoRig) -> None:
        """Build the estimator.

        Raises:
            SettingsError: If there is no such estimator.
        """
        estimator, _ = make_estimator(name, rig)
        self._estimator = estimator if name in ESTIMATORS else Guarded(estimator)
        self._rig = rig
        self._T_world_odom: Array | None = None

    def update(self, sight: Sight) -> Belief:
        """Track the next picture; without a pose, the last one holds.

        Raises:
            PluginError: If an estimator of someone's own fails frame after frame.
        """
        T_body_cam = self._rig.T_body_cam
        if self._T_world_odom is None:
            self._T_world_odom = sight.T_world_body @ T_body_cam
            self._last = sight.T_world_body
        if sight.pair is None:
            return Belief(self._last, Status.LOST, "the picture was lost")
        frame = StereoFrame(sight.time_ns, *sight.pair, sight.wheel_ticks)
        estimate = self._estimator.track(frame)
        if estimate.T_odom_cam is not None:
            self._last = self._T_world_odom @ estimate.T_odom_cam @ se3.inverse(T_body_cam)
        return Belief(self._last, estimate.status, estimate.reason)


def make_localization(
    name: str, rig: StereoRig, ticks_per_turn: int, seed: int = 0
) -> Localization:
    """Build a fresh localisation.

    Args:
        name: truth, drift:PERCENT, wheels, vo, another estimator's name or `module:Class`.
        rig: Calibration as delivered.
        ticks_per_turn: Of the encoders.
        seed: Of an injected drift.

    Raises:
        SettingsError: If there is no such estimator, or no such drift.
        PluginError: If a class of someone's own cannot be built.
    """
    expect_localization(name)
    if name == "truth":
        return Truth()
    if name == "wheels":
        return Wheels(ticks_per_turn)
    if name.startswith(DRIFT):
        return Drifting(injected_percent(name), seed)
    return Visual("driftyard" if name == "vo" else name, rig)


def expect_localization(name: str) -> None:
    """Refuse what cannot be one; a class of someone's own is only built when a trial begins.

    Raises:
        SettingsError: If there is no such estimator, or no such drift.
    """
    if name.startswith(DRIFT):
        injected_percent(name)
    elif name not in ("truth", "wheels", "vo", *ESTIMATORS) and ":" not in name:
        valid = ", ".join(("truth", f"{DRIFT}PERCENT", "wheels", "vo", *sorted(ESTIMATORS)))
        raise SettingsError(f"unknown localization {name}; valid: {valid}, or module:Class")


def injected_percent(name: str) -> float:
    """Per cent of `drift:PERCENT`.

    Raises:
        SettingsError: If it is no number of per cent from 0 to 1000.
    """
    try:
        percent = float(name.removeprefix(DRIFT))
    except ValueError:
        percent = math.nan
    if not 0 <= percent <= 1000:
        raise SettingsError(f"localization {name}: needs {DRIFT} and per cent, 0 to 1000")
    return percent
