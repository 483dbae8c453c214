"""A trial in Rerun's viewer while it is driven."""

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from typing import Any

import cv2
import numpy as np

from sim.world.world import START_S
from trials.gym.env.environments import RoverNav
from trials.gym.env.episode import Observation
from trials.view import rerun_sdk as rr
from trials.view.blueprint import blueprint
from trials.view.recording_log import RecordingLog, points
from trials.view.run_log import LOG, RunLog, run_style
from trials.view.run_rows import Row
from trials.view.scene_model import scene_model
from trials.view.stream import Stream, open_stream
from trials.view.target import Target
from vo.contract.arrays import Array, Image
from vo.contract.estimator import Estimate, Status
from vo.contract.sequence import StereoFrame
from vo.contract.trajectory import NS_PER_S

ERRORS = ("translation_error_m", "rotation_error_deg")
UP = np.array([0.0, 0.0, 1.0])
PLAN, PLAN_COLOUR = "world/plan", (90, 200, 110)
PLAN_POINTS, PLAN_M = 2.0, 0.02
"""Width on the screen, and height above the ground, of the path to the goal."""


class LiveTrial:
    """View of the trial of an environment that observes both images."""

    def __init__(self, stream: Stream, env: RoverNav, plan: Array) -> None:
        """Log the world and the path (N, 3) to the goal."""
        world, self._rig = env.instance.simulation.world, env.instance.camera.rig
        world.place_bodies()
        self._stream, self._steps = stream, 0
        nowhere = np.zeros((0, 3))
        self._log = RecordingLog(stream, self._rig, UP, nowhere, scene_model(world))
        self._run = RunLog(stream, run_style(0, env.episode.localization), self._rig)
        line = rr.LineStrips3D([plan], colors=[PLAN_COLOUR], radii=points(PLAN_POINTS))
        stream.log(PLAN, line, static=True)

    def add(self, observation: Observation, info: Mapping[str, Any]) -> None:
        """Show a step: its images, and the true and the estimated pose."""
        time_ns, step = round((info["time_s"] + START_S) * NS_PER_S), self._steps
        T_true, T_estimated = (info[x] @ self._rig.T_body_cam for x in ("T_true", "T_estimated"))
        images = StereoFrame(time_ns, _grey(observation["left"]), _grey(observation["right"]))
        self._log.add(step, time_ns, T_true, T_true[:3, 3], images)
        status = Status(info["status"])
        shown = None if status is Status.LOST else T_estimated
        estimate = Estimate(time_ns, status, shown, info["reason"])
        self._run.add(Row(step, estimate, shown, info["error_m"], info["error_deg"]))
        if info["outcome"]:
            self._stream.log(f"{LOG}/outcome", rr.TextLog(info["outcome"]))
        self._steps += 1


@contextmanager
def live_trial(env: RoverNav, name: str, target: Target) -> Generator[LiveTrial]:
    """Open a view of the trial that an environment has begun.

    Raises:
        DatasetError: If a file cannot be written.
    """
    path = env.episode.task.path
    plan = np.column_stack([path, np.full(len(path), PLAN_M)])
    layout = blueprint(
        names=[rr.escape_entity_path_part(env.episode.localization)],
        positions=plan,
        up=UP,
        errors=ERRORS,
        has_scene=True,
        has_depth=False,
        sensors=(),
    )
    with open_stream(name, target, layout, 0) as stream:
        yield LiveTrial(stream, env, plan)


def _grey(image: Array) -> Image:
    """Return (H, W) of (H, W, 1) grey or (H, W, 3) RGB."""
    grey = image[..., 0] if image.shape[-1] == 1 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    return np.ascontiguousarray(grey, np.uint8)
