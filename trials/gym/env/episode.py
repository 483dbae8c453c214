"""One trial from its reset to its outcome: observations, rewards, and the truth about it."""

import math
from typing import Any

import cv2
import numpy as np

from sim.world.drive import TIPPED_RAD
from sim.world.rover import WHEEL_RADIUS_M
from sim.world.world import START_S, thing_of
from trials.gym.env.localization import make_localization
from trials.gym.env.settings import TrialSettings
from trials.gym.env.spaces import STEREO, wheel_speeds
from trials.gym.env.tasks import FAILURE, Evaluation, Task
from trials.gym.world.scene_instance import SceneInstance
from trials.gym.world.sensors import InertialUnit
from trials.gym.world.simulation import Simulation
from vo.contract import se3
from vo.contract.arrays import Array, Image
from vo.contract.estimator import Status
from vo.stereo.dense import DenseStereo

Observation = dict[str, Array]

STUCK_AFTER_S = 10.0
MIN_MOTION_M, MIN_MOTION_RAD = 0.05, math.radians(10)
"""Displacement and turn that end a period without motion."""
MIN_COMMAND_MPS = 0.02
"""Speed of a wheel's rim below which the rover is meant to stand."""


class Episode:
    """One trial in an instance whose simulation was reset to the start of the task.

    Attributes:
        localization: Source of the pose.
        noise_seed: Seed of the camera's noise.
        outcome: success, a failure or timeout; empty while the trial is running.
        observation: The last one: an array for each channel.
    """

    def __init__(
        self,
        trial: TrialSettings,
        instance: SceneInstance,
        task: Task,
        localization: str,
        noise_seed: int,
    ) -> None:
        self.instance, self.task, self.localization = instance, task, localization
        self.noise_seed, self.outcome = noise_seed, ""
        self._trial, self._steps = trial, 0
        settings, camera = instance.settings, instance.camera
        camera.reset(noise_seed, trial.max_steps + 1)
        ticks_per_turn = settings.encoders.ticks_per_turn
        self._localization = make_localization(localization, camera.rig, ticks_per_turn, noise_seed)
        self._needs_images = trial.needs_images(localization)
        self._stereo = DenseStereo(STEREO)
        self._imu = InertialUnit(settings.imu, np.random.default_rng([noise_seed, 1]))
        self._monitor = FailureMonitor(instance.simulation)
        self._driven_m, self._position = 0.0, instance.simulation.pose2[:2]
        self._evaluation = Evaluation(0.0, False, "", task.path_m, 0.0)
        self._trace: list[Array] = []
        self.observation = self._observe()

    @property
    def trace(self) -> Array:
        """(steps + 1, 2, 2) true and estimated x, y."""
        return np.array(self._trace)

    def step(self, action: Array) -> tuple[float, bool, bool]:
        """Drive for one control step.

        Returns:
            The reward, whether the trial has ended, and whether the time limit has truncated it.

        Raises:
            TrialError: If the action is out of range.
        """
        speeds = wheel_speeds(action, self._trial)
        simulation = self.instance.simulation
        simulation.advance(speeds)
        self._steps += 1
        x, y, _ = simulation.pose2
        self._driven_m += math.hypot(x - self._position[0], y - self._position[1])
        self._position = x, y
        self.observation = self._observe()
        evaluation = self._evaluation = self.task.evaluate(np.array([x, y]))
        failure = self._monitor.failure(float(np.abs(speeds).max()) * WHEEL_RADIUS_M)
        lost = self._trial.on_loss == "end" and self._estimate.status is Status.LOST
        failure = failure or ("lost" if lost else evaluation.failure)
        success = evaluation.success and not failure
        terminated = success or bool(failure)
        truncated = not terminated and self._steps >= self._trial.max_steps
        self.outcome = failure or ("success" if success else "timeout" if truncated else "")
        reward = evaluation.reward + FAILURE * bool(failure)
        return reward, terminated, truncated

    def info(self) -> dict[str, Any]:
        """Return what the rover must not know: the truth, and how far the trial has come."""
        simulation, T_estimated = self.instance.simulation, self._estimate.T_world_body
        T_true = simulation.snapshot.T_world_body
        T_error = se3.inverse(T_true) @ T_estimated
        success, way_m = self.outcome == "success", self.task.path_m
        longer_m = max(way_m, self._driven_m)
        return {
            "T_true": T_true.copy(),
            "T_estimated": T_estimated.copy(),
            "error_m": float(np.linalg.norm(T_error[:3, 3])),
            "error_deg": math.degrees(float(se3.rotation_angle(T_error))),
            "status": str(self._estimate.status),
            "reason": self._estimate.reason,
            "contacts": self._monitor.contacts,
            "time_s": simulation.time_s - START_S,
            "driven_m": self._driven_m,
            "way_m": way_m,
            "left_m": self._evaluation.remaining_m,
            "share": self._evaluation.progress,
            "outcome": self.outcome,
            "success": success,
            "spl": way_m / longer_m if success and longer_m else 0.0,
        }

    def _observe(self) -> Observation:
        """Take images, localize, and gather the channels."""
        simulation, camera = self.instance.simulation, self.instance.camera
        snapshot, wanted = simulation.snapshot, self._trial.channels
        images = camera.capture(simulation) if self._needs_images else None
        grey = (_grey(images[0]), _grey(images[1])) if images else None
        measured = grey if images and camera.delivered[-1] else None
        self._estimate = self._localization.update(snapshot, measured)
        T_estimated = self._estimate.T_world_body
        self._trace.append(np.array([snapshot.T_world_body[:2, 3], T_estimated[:2, 3]]))
        channels: Observation = {}
        if images and grey:
            for side, image in zip(("left", "right"), images, strict=True):
                channels[side] = np.atleast_3d(image).copy()  # the estimator keeps its own
            if "disparity" in wanted:
                dense = np.nan_to_num(self._stereo(*grey)).astype(np.float32)
                channels["disparity"] = dense[..., None]
        if "imu" in wanted:
            channels["imu"] = self._imu.read(simulation).astype(np.float32)
        channels["encoders"] = np.array(snapshot.wheel_ticks, np.int64)
        x, y = T_estimated[:2, 3].tolist()
        yaw = math.atan2(T_estimated[1, 0], T_estimated[0, 0])
        channels["pose"] = np.array([x, y, yaw], np.float32)
        if "goal" in wanted:
            ahead = self.task.goal(np.array([x, y])) - (x, y)
            c, s = math.cos(yaw), math.sin(yaw)
            channels["goal"] = np.array([[c, s], [-s, c]], np.float32) @ ahead.astype(np.float32)
        return {name: channels[name] for name in wanted}


class FailureMonitor:
    """Detects collisions, falls, tipping over and wheels without effect, from the truth."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._from = simulation.pose2
        self._since_s = simulation.time_s

    def failure(self, command_mps: float) -> str:
        """Return the failure of the last step: collision, fell, tipped, stuck, or "".

        The commanded speed is that of the faster wheel's rim.
        """
        simulation = self._simulation
        if (simulation.touched & simulation.rigid).any():
            return "collision"
        if simulation.has_fallen:
            return "fell"
        if simulation.upright < math.cos(TIPPED_RAD):
            return "tipped"
        pose = simulation.pose2
        moved = math.dist(pose[:2], self._from[:2]) > MIN_MOTION_M
        turned = abs(math.remainder(pose[2] - self._from[2], 2 * math.pi)) > MIN_MOTION_RAD
        if abs(command_mps) < MIN_COMMAND_MPS or moved or turned:
            self._from, self._since_s = pose, simulation.time_s
        return "stuck" if simulation.time_s - self._since_s > STUCK_AFTER_S else ""

    @property
    def contacts(self) -> tuple[str, ...]:
        """Names of what was touched in the last step, sorted; the ground is left out."""
        simulation = self._simulation
        geoms = np.flatnonzero(simulation.touched & simulation.obstacles)
        return tuple(sorted({thing_of(simulation.world, int(k)).name for k in geoms}))


def _grey(image: Image) -> Image:
    """(H, W) of grey or RGB."""
    if image.ndim == 2:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
