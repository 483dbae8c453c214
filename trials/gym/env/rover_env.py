"""The environment: a rover that is told how fast to go, and sees what it sees."""

import math
from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import cv2
import gymnasium
import numpy as np

from sim.world.rover import WHEEL_RADIUS_M
from sim.world.world import START_S
from trials.gym.env.failure_monitor import Watch
from trials.gym.env.inertial import InertialUnit
from trials.gym.env.localization import Belief, Sight, make_localization
from trials.gym.env.settings import TrialSettings
from trials.gym.env.spaces import ACTION, STEREO, observation_space, wheel_speeds
from trials.gym.env.tasks import FAILURE, Task, Verdict
from trials.gym.media.pictures import Painter
from trials.gym.media.trial_log import Diary
from trials.gym.media.viewer import Window, render_modes
from trials.gym.world.scene_instance import Site, open_site
from trials.gym.world.start_goal_sampling import TrialError
from vo.contract import se3
from vo.contract.arrays import Array, Image
from vo.contract.errors import SettingsError
from vo.contract.estimator import Status
from vo.contract.settings import validated
from vo.stereo.dense import DenseStereo

Observation = dict[str, Array]
MOST_LAYOUTS = 2**31 - 1
TRIES = 10
"""Starts that are tried where something moves about; the same one, if it is given."""


class RoverEnv(gymnasium.Env[Observation, Array]):
    """What the three environments share; see `docs/navigation.md`.

    A reset with a seed takes the layout of that seed, unless `layout` says otherwise; one without
    keeps the layout, which is a matter of milliseconds where building is one of seconds, and draws
    places anew. A trial is judged on the truth, whatever the rover believes.
    """

    metadata: dict[str, Any] = {"render_modes": render_modes()}  # noqa: RUF012, as its base
    model: ClassVar[type[TrialSettings]]
    """Of the options."""

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        """Check everything that can be checked without building a world.

        Args:
            render_mode: None, rgb_array, or human where there is a display.
            options: Fields of `model`.

        Raises:
            SettingsError: If an option is unknown or refused, or there is no such render mode.
        """
        self.trial = validated(self.model, options)
        settings = self.trial.recorded(0)
        if render_mode == "human":
            Window.check()
        elif render_mode not in (None, "rgb_array"):
            raise SettingsError(f"render_mode {render_mode}: valid are rgb_array, human and none")
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": self.trial.rate_hz}
        self.observation_space = observation_space(self.trial.observe, settings)
        self.action_space = ACTION
        self._site: Site | None = None
        self._stage: Site | None = None
        self._painter: Painter | None = None
        self._window: Window | None = None
        self._stereo = DenseStereo(STEREO)
        self._over = True

    @abstractmethod
    def _assign(self, site: Site, options: Mapping[str, Any]) -> tuple[Site, Task]:
        """Choose the task in a layout, and the site to do it in."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a trial.

        Args:
            seed: Of layout, places and noise.
            options: `layout`, `localization`, in place of those of the environment for this trial;
                of RoverNav and RoverExplore `start` (x, y, yaw), and of RoverNav `goal` (x, y).

        Raises:
            TrialError: If start or goal have no room or no way, or the world has no free place.
            SettingsError: If an option is unknown, or the scene refuses its settings.
        """
        super().reset(seed=seed)
        options = dict(options or {})
        localization = options.pop("localization", None) or self.trial.localization
        site = self._layout(seed, options.pop("layout", None))
        for _ in range(TRIES):
            stage, self._task = self._assign(site, options)
            self._leave(stage)
            self._stage, self._site = stage, site
            if stage.simulation.reset(self._task.start):
                break
        else:
            x, y, _ = self._task.start
            raise TrialError(f"start ({x:g}, {y:g}) m: something that moves is there")
        simulation, trial, settings = stage.simulation, self.trial, stage.settings
        noise = self._noise = int(self.np_random.integers(MOST_LAYOUTS))
        if trial.record:
            simulation.reset(self._task.start, Diary())
        self._most_steps = math.ceil(trial.time_limit_s * trial.rate_hz - 1e-9)
        stage.eyes.reset(noise, self._most_steps + 1)
        ticks_per_turn = settings.encoders.ticks_per_turn
        self._localization = make_localization(localization, stage.eyes.rig, ticks_per_turn, noise)
        self._believes, self._sees = localization, trial.sees(localization)
        self._inertial = InertialUnit(settings.imu, np.random.default_rng([noise, 1]))
        self._watch, self._steps, self._over, self.outcome = Watch(simulation), 0, False, ""
        self._driven_m, self._at = 0.0, simulation.place
        observation = self._look()
        self.verdict = Verdict(0.0, False, "", self._task.way_m, 0.0)
        self._trace = [self._pair_of_places()]
        return observation, self._told()

    def step(self, action: Array) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for 1 / rate_hz seconds.

        Raises:
            TrialError: If the action is out of range, or the trial is over.
        """
        if self._stage is None or self._over:
            raise TrialError("the trial is over or has not begun: call reset")
        speeds = wheel_speeds(action, self.trial)
        simulation = self._stage.simulation
        simulation.advance(speeds)
        self._steps += 1
        x, y, _ = now = simulation.place
        self._driven_m += math.hypot(x - self._at[0], y - self._at[1])
        self._at = now
        observation = self._look()
        self._trace.append(self._pair_of_places())
        verdict = self._task.judge(np.array([x, y]))
        failure = self._watch.failure(float(np.abs(speeds).max()) * WHEEL_RADIUS_M)
        if self.trial.on_loss == "end" and self.belief.status is Status.LOST:
            failure = failure or "lost"
        failure = failure or verdict.failure
        success = verdict.success and not failure
        self.verdict = verdict
        truncated = not success and not failure and self._steps >= self._most_steps
        self._over = success or bool(failure) or truncated
        self.outcome = failure or ("success" if success else "timeout" if truncated else "")
        reward = verdict.reward + FAILURE * bool(failure)
        if self.render_mode == "human":
            self._show()
        return observation, reward, success or bool(failure), truncated, self._told()

    def render(self) -> Image | None:
        """From behind and from above, side by side: (H, W, 3) RGB; None in a window."""
        if self.render_mode is None:
            gymnasium.logger.warn("render: choose a render_mode when making the environment")
            return None
        if self.render_mode == "human":
            self._show()
            return None
        return self._picture()

    def close(self) -> None:
        """Free graphics and window; a reset makes them anew."""
        self._leave(None)
        if self._window:
            self._window.close()
            self._window = None
        self._site = self._stage = None
        self._over = True

    def save_dataset(self, out: Path) -> None:
        """Write the drive so far as a dataset folder, with exact labels; see `record`.

        Raises:
            TrialError: If `record` is off or nothing was driven.
            DatasetError: If `out` is in the way.
        """
        from trials.gym.media.trial_dataset import save_drive

        stage = self._stage
        if stage is None or stage.simulation.diary is None or not stage.eyes.delivered:
            raise TrialError("save_dataset: needs record=True, pictures, and a drive")
        failed = "" if self.outcome in ("", "success", "timeout") else self.outcome
        delivered = np.array(stage.eyes.delivered)
        save_drive(stage, stage.simulation.diary.trip(delivered, failed), self._noise, out)

    @property
    def site(self) -> Site:
        """Where the present trial is.

        Raises:
            TrialError: Before the first reset.
        """
        if self._stage is None:
            raise TrialError("call reset first")
        return self._stage

    @property
    def task(self) -> Task:
        """Of the present trial."""
        return self._task

    @property
    def trace(self) -> Array:
        """(steps + 1, 2, 2) x, y where the rover was and where it believed to be."""
        return np.array(self._trace)

    def _layout(self, seed: int | None, asked: int | None) -> Site:
        """The layout of this trial; the present one is not built again."""
        layout = asked if asked is not None else self.trial.layout
        if layout is None:
            layout = seed if seed is not None else self._site.layout if self._site else None
        if layout is None:
            layout = int(self.np_random.integers(MOST_LAYOUTS))
        if self._site is not None and self._site.layout == layout:
            return self._site
        self._leave(None)
        self._site = None  # first give it back: two worlds take twice the memory
        return open_site(self.trial, layout)

    def _leave(self, stage: Site | None) -> None:
        """Free what belongs to the present site, unless it stays."""
        if self._stage is not None and self._stage is not stage:
            self._stage.eyes.close()
            self._stage = None
            self._painter = None

    def _look(self) -> Observation:
        """Take a picture, localise, and gather the channels."""
        site, seen = self.site, self.trial.observe
        simulation = site.simulation
        pair = site.eyes.look(simulation) if self._sees else None
        kept = pair is not None and site.eyes.delivered[-1]
        moment = simulation.moment
        grey = (_grey(pair[0]), _grey(pair[1])) if pair else None
        sight = Sight(
            moment.time_ns, grey if kept else None, moment.wheel_ticks, moment.T_world_body
        )
        self.belief: Belief = self._localization.update(sight)
        here: Observation = {}
        if pair and grey:
            if "left" in seen:
                here["left"] = np.atleast_3d(pair[0])
            if "right" in seen:
                here["right"] = np.atleast_3d(pair[1])
            if "disparity" in seen:
                dense = np.nan_to_num(self._stereo(*grey)).astype(np.float32)
                here["disparity"] = dense[..., None]
        if "imu" in seen:
            rates = self._inertial.read(simulation.world, simulation.time_s)
            here["imu"] = rates.astype(np.float32)
        if "encoders" in seen:
            here["encoders"] = np.array(moment.wheel_ticks, np.int64)
        x, y, yaw = place_of(self.belief.T_world_body)
        if "pose" in seen:
            here["pose"] = np.array([x, y, yaw], np.float32)
        if "goal" in seen:
            ahead = self._task.goal(np.array([x, y])) - (x, y)
            c, s = math.cos(yaw), math.sin(yaw)
            here["goal"] = np.array([[c, s], [-s, c]], np.float32) @ ahead.astype(np.float32)
        return {name: here[name] for name in seen}

    def _told(self) -> dict[str, Any]:
        """Everything that the rover must not know."""
        simulation, T_true = self.site.simulation, self.site.simulation.moment.T_world_body
        T_off = se3.inverse(T_true) @ self.belief.T_world_body
        success = self.outcome == "success"
        longer_m = max(self._task.way_m, self._driven_m)
        return {
            "T_true": T_true,
            "T_estimated": self.belief.T_world_body,
            "error_m": float(np.linalg.norm(T_off[:3, 3])),
            "error_deg": math.degrees(float(se3.rotation_angle(T_off))),
            "status": str(self.belief.status),
            "reason": self.belief.reason,
            "contacts": self._watch.contacts,
            "time_s": simulation.time_s - START_S,
            "driven_m": self._driven_m,
            "way_m": self._task.way_m,
            "left_m": self.verdict.left_m,
            "share": self.verdict.share,
            "outcome": self.outcome,
            "success": success,
            "spl": self._task.way_m / longer_m if success and longer_m else 0.0,
        }

    def _pair_of_places(self) -> Array:
        """(2, 2) where the rover is, and where it believes to be."""
        T_true, T_believed = self.site.simulation.moment.T_world_body, self.belief.T_world_body
        return np.array([T_true[:2, 3], T_believed[:2, 3]])

    def _picture(self) -> Image:
        site = self.site
        self._painter = self._painter or Painter(site)
        caption = f"{site.scene.name} {site.layout}   {self._believes}   {self.outcome}"
        return self._painter.paint(self.trace, self._task, caption)

    def _show(self) -> None:
        self._window = self._window or Window()
        self._window.show(self._picture())


def place_of(T_world_body: Array) -> tuple[float, float, float]:
    """x, y in metres and yaw in radians of a pose."""
    yaw = math.atan2(T_world_body[1, 0], T_world_body[0, 0])
    return float(T_world_body[0, 3]), float(T_world_body[1, 3]), yaw


def _grey(image: Image) -> Image:
    """(H, W) of grey or RGB."""
    return (
        image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    )
