"""Localization of the rover: by the truth, by wheel odometry, or by an estimator."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim.world.rover import TRACK_M, WHEEL_RADIUS_M
from trials.estimators.choice import ESTIMATORS, make_estimator
from trials.estimators.plugins.classes import Guarded
from trials.estimators.systems.environments import SYSTEMS
from trials.gym.world.simulation import Snapshot
from vo.contract import se3
from vo.contract.arrays import Array, Image
from vo.contract.errors import SettingsError
from vo.contract.estimator import Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame

DRIFT = "drift:"
DRIFT_DEG_PER_M = 0.25
"""Rotation error for each per cent of drift, as the estimator has it over all scenes."""


GreyPair = tuple[Image, Image] | None
"""Left and right grey image, (H, W); None if they were lost or are not needed."""


@dataclass(frozen=True)
class LocalizationEstimate:
    """Estimated pose (4, 4) of the rover, the last one if it is lost, and why it is not tracked."""

    T_world_body: Array
    status: Status
    reason: str = ""


class Localization(Protocol):
    """Estimates the pose of a rover from a known start."""

    def update(self, snapshot: Snapshot, images: GreyPair) -> LocalizationEstimate:
        """Estimate the pose of the next time step; the first call defines the start.

        The true pose is for the start, `truth` and `drift:PERCENT`.
        """
        ...


class TruthLocalization:
    """The true pose."""

    def update(self, snapshot: Snapshot, images: GreyPair) -> LocalizationEstimate:
        """Return the truth."""
        return LocalizationEstimate(snapshot.T_world_body, Status.TRACKED)


class DriftLocalization:
    """The truth with an injected drift: a random walk of position and heading.

    It grows with the distance that the faster wheel rolls, so that turning on the spot has errors.
    """

    def __init__(self, percent: float, seed: int) -> None:
        """Set the mean position error after one metre, if the heading had no error, per cent."""
        self._rng = np.random.default_rng([seed, 2])
        across_m = percent / 100 / math.sqrt(math.pi / 2)  # of a mean length of a 2-D Gaussian
        turned_rad = math.radians(DRIFT_DEG_PER_M * percent) * math.sqrt(math.pi / 2)
        self._sigmas = np.array([across_m, across_m, 0, 0, 0, turned_rad])
        self._T_world_body: Array | None = None

    def update(self, snapshot: Snapshot, images: GreyPair) -> LocalizationEstimate:
        """Continue by the true motion and an error."""
        truth = snapshot.T_world_body
        if self._T_world_body is None:
            self._T_world_body = self._last = truth
            return LocalizationEstimate(truth, Status.START)
        motion = se3.inverse(self._last) @ truth
        ahead_m = float(np.linalg.norm(motion[:3, 3]))
        rolled_m = ahead_m + TRACK_M / 2 * float(se3.rotation_angle(motion))
        error = self._rng.normal(size=6) * self._sigmas * math.sqrt(rolled_m)
        self._T_world_body = self._T_world_body @ motion @ se3.exp(error)
        self._last = truth
        return LocalizationEstimate(self._T_world_body, Status.TRACKED)


class WheelOdometry:
    """Dead reckoning along arcs in the plane that the rover stood on at the start."""

    def __init__(self, ticks_per_turn: int) -> None:
        self._metres_per_tick = 2 * np.pi * WHEEL_RADIUS_M / ticks_per_turn
        self._T_world_body: Array | None = None

    def update(self, snapshot: Snapshot, images: GreyPair) -> LocalizationEstimate:
        """Continue by the turn of the wheels."""
        ticks = snapshot.wheel_ticks
        if self._T_world_body is None:
            self._T_world_body, self._ticks = snapshot.T_world_body, ticks
            return LocalizationEstimate(self._T_world_body, Status.START)
        left_m, right_m = (np.array(ticks) - self._ticks) * self._metres_per_tick
        ahead_m, turned_rad = (left_m + right_m) / 2, (right_m - left_m) / TRACK_M
        step = se3.exp(np.array([ahead_m, 0, 0, 0, 0, turned_rad]))
        self._T_world_body, self._ticks = self._T_world_body @ step, ticks
        return LocalizationEstimate(self._T_world_body, Status.TRACKED)


class VisualLocalization:
    """An estimator, started at the true pose of its first frame."""

    def __init__(self, name: str, rig: StereoRig) -> None:
        estimator, _ = make_estimator(name, rig)
        self._estimator = estimator if name in ESTIMATORS else Guarded(estimator)
        self._rig = rig
        self._T_world_odom: Array | None = None

    def update(self, snapshot: Snapshot, images: GreyPair) -> LocalizationEstimate:
        """Track the next images; raises a PluginError if a user's estimator keeps failing."""
        T_body_cam = self._rig.T_body_cam
        if self._T_world_odom is None:
            self._T_world_odom = snapshot.T_world_body @ T_body_cam
            self._last = snapshot.T_world_body
        if images is None:
            return LocalizationEstimate(self._last, Status.LOST, "the images were lost")
        frame = StereoFrame(snapshot.time_ns, *images, snapshot.wheel_ticks)
        estimate = self._estimator.track(frame)
        if estimate.T_odom_cam is not None:
            self._last = self._T_world_odom @ estimate.T_odom_cam @ se3.inverse(T_body_cam)
        return LocalizationEstimate(self._last, estimate.status, estimate.reason)


def make_localization(name: str, rig: StereoRig, ticks_per_turn: int, seed: int) -> Localization:
    """Build a localization for a rig as delivered; the seed is that of an injected drift.

    The name is truth, drift:PERCENT, wheels, vo, another estimator's name or `module:Class`.

    Raises:
        SettingsError: If there is no such estimator or drift.
        PluginError: If a user's class cannot be built.
    """
    expect_localization(name)
    if name == "truth":
        return TruthLocalization()
    if name == "wheels":
        return WheelOdometry(ticks_per_turn)
    if name.startswith(DRIFT):
        return DriftLocalization(float(name.removeprefix(DRIFT)), seed)
    return VisualLocalization("driftyard" if name == "vo" else name, rig)


def expect_localization(name: str) -> None:
    """Refuse an unknown source with a SettingsError, also a drift not from 0 to 1000 per cent.

    A user's class is checked when a trial begins.
    """
    if name.startswith(DRIFT):
        try:
            valid = 0 <= float(name.removeprefix(DRIFT)) <= 1000
        except ValueError:
            valid = False
        if not valid:
            raise SettingsError(f"localization {name}: expected {DRIFT}PERCENT, from 0 to 1000")
    elif name not in ("truth", "wheels", "vo", *ESTIMATORS, *SYSTEMS) and ":" not in name:
        own = sorted(ESTIMATORS)
        known = ", ".join(("truth", f"{DRIFT}PERCENT", "wheels", "vo", *own, *SYSTEMS))
        raise SettingsError(f"unknown localization {name}; valid: {known}, or module:Class")
