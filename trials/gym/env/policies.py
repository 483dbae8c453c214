"""A policy for RoverNav that drives from observations alone."""

import math

import numpy as np

from trials.gym.env.episode import Observation
from trials.gym.env.rover_env import RoverEnv
from trials.navigation.navigator import Navigator
from trials.navigation.occupancy_grid import OccupancyGrid
from trials.navigation.settings import NavigatorSettings
from trials.navigation.steering import Pose2, SteeringSettings
from vo.contract.arrays import Array


class NavigatorPolicy:
    """The navigator behind an environment that observes `disparity`, `pose` and `goal`.

    Attributes:
        NEEDS: Channels that the environment must observe.
        navigator: Its map, planner and controller.

    Example:
        >>> import gymnasium
        >>> needs = {"observe": dy.NavigatorPolicy.NEEDS, "settings": {"rig.width_px": 160}}
        >>> env = gymnasium.make("driftyard/RoverNav-v0", scene="yard.xml", **needs)
        >>> observation, info = env.reset(seed=3)
        >>> policy = dy.NavigatorPolicy(env.unwrapped)
        >>> policy.act(observation).shape
        (2,)
        >>> env.close()
    """

    NEEDS = ("disparity", "pose", "goal")

    def __init__(
        self,
        env: RoverEnv,
        settings: NavigatorSettings | None = None,
        floor_plan: OccupancyGrid | None = None,
        replanning: bool = True,
    ) -> None:
        """Begin a trial; make a new policy after every reset.

        The environment, unwrapped, gives calibration and limits, and nothing else; for the other
        arguments see Navigator.
        """
        trial = env.trial
        self._limits = np.array([trial.speed_max_mps, trial.turn_max_radps])
        steering = SteeringSettings(
            forward_max_mps=trial.speed_max_mps,
            turn_max_radps=trial.turn_max_radps,
            period_s=1 / trial.rate_hz,
        )
        rig = env.instance.camera.rig
        self.navigator = Navigator(rig, steering, settings, floor_plan, replanning)
        self._goal_m: Array | None = None

    def act(self, observation: Observation) -> Array:
        """Choose the next action; the goal stays where it was first observed."""
        x, y, yaw = (float(value) for value in observation["pose"])
        if self._goal_m is None:
            c, s = math.cos(yaw), math.sin(yaw)
            ahead, left = (float(value) for value in observation["goal"])
            self._goal_m = np.array([x + c * ahead - s * left, y + s * ahead + c * left])
        disparity = observation["disparity"][..., 0]
        twist = self.navigator.act(disparity, Pose2(x, y, yaw), self._goal_m)
        return np.clip(np.array(twist) / self._limits, -1, 1).astype(np.float32)
