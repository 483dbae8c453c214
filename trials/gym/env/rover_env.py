"""Base of the environments: a rover that is given speeds, and observes through its sensors."""

from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import cv2
import gymnasium
import numpy as np

from sim.camera.camera import StereoCamera
from sim.record import record_trip
from sim.world.enclosure import enclosing_geom
from trials.gym.env.episode import Episode, Observation
from trials.gym.env.settings import TrialSettings
from trials.gym.env.spaces import ACTION, observation_space
from trials.gym.env.tasks import Task
from trials.gym.media import TrialView, missing_for_window
from trials.gym.world.scene_instance import SceneInstance
from trials.gym.world.simulation import TrialLog
from trials.gym.world.start_goal_sampling import TrialError
from vo.contract.arrays import Array, Image
from vo.contract.dataset import DatasetWriter
from vo.contract.errors import DatasetError, SettingsError
from vo.contract.settings import amended, validated

Assignment = tuple[SceneInstance, Task]
WINDOW = "driftyard"
MAX_SEED = 2**31 - 1
MAX_STARTS = 10
"""Attempts to place the rover where nothing moves; a given start is tried as often."""


class RoverEnv(gymnasium.Env[Any, Array]):
    """Common part of the three environments; see `docs/navigation.md`.

    A reset with a seed takes the layout of that seed, unless `layout` says otherwise; one without
    keeps the layout, and samples start and goal anew. Building a layout takes seconds, a reset in
    one of the last `layouts_kept` milliseconds. A trial is evaluated on the truth, whatever the
    localization estimates.

    An observation is a dictionary of arrays, or one array where `observe` is a single name.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012, as its base
        "render_modes": ["rgb_array"] if missing_for_window() else ["human", "rgb_array"],
        "render_fps": TrialSettings().rate_hz,
    }
    model: ClassVar[type[TrialSettings]]
    """Model of the options."""

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        """Check everything that can be checked without building a world.

        The options are fields of `model`.

        Raises:
            SettingsError: If an option is unknown or refused, or there is no such render mode.
        """
        self.trial = validated(self.model, options)
        settings = self.trial.recorded(0)
        if render_mode == "human" and (missing := missing_for_window()):
            raise SettingsError(f"render_mode human: {missing}; rgb_array needs neither")
        if render_mode not in (None, "rgb_array", "human"):
            raise SettingsError(f"render_mode {render_mode}: valid are rgb_array, human and none")
        self.render_mode = render_mode
        self.metadata = {**self.metadata, "render_fps": self.trial.rate_hz}
        self.observation_space = observation_space(self.trial, settings)
        self.action_space = ACTION
        self._layouts: dict[int, SceneInstance] = {}  # the present one is the last
        self._instance: SceneInstance | None = None
        self._episode: Episode | None = None
        self._view: TrialView | None = None
        self._has_window = False

    @abstractmethod
    def _assign(self, base: SceneInstance, options: Mapping[str, Any]) -> Assignment:
        """Choose the task in a layout, and the instance to do it in: the base or one like it."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin a trial; the seed is that of layout, start, goal and noise.

        Options: `layout` and `localization`, in place of those of the environment for this trial,
        of RoverNav and RoverExplore `start` (x, y, yaw), and of RoverNav `goal` (x, y).

        Raises:
            TrialError: If start or goal have no clearance or no path, or the world has no
                traversable place.
            SettingsError: If an option is unknown, or the scene refuses its settings.
        """
        super().reset(seed=seed)
        options = dict(options or {})
        localization = options.pop("localization", None) or self.trial.localization
        base = self._layout(seed, options.pop("layout", None))
        instance, task = self._place_rover(base, options)
        noise_seed = int(self.np_random.integers(MAX_SEED))
        if self.trial.record:
            instance.simulation.reset(task.start, TrialLog())
        episode = Episode(self.trial, instance, task, localization, noise_seed)
        self._episode = episode
        return self._observation(episode), episode.info()

    def step(self, action: Array) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Drive for 1 / rate_hz seconds.

        Raises:
            TrialError: If the action is out of range, or the trial is over.
        """
        episode = self._episode
        if episode is None or episode.outcome:
            raise TrialError("the trial is over or has not begun: call reset")
        reward, terminated, truncated = episode.step(action)
        if self.render_mode == "human":
            self._show()
        return self._observation(episode), reward, terminated, truncated, episode.info()

    def render(self) -> Image | None:
        """Draw the rover from behind and from above: (H, W, 3) RGB; None with a viewer."""
        if self.render_mode is None:
            gymnasium.logger.warn("render: choose a render_mode when making the environment")
            return None
        if self.render_mode == "human":
            self._show()
            return None
        return self._image()

    def close(self) -> None:
        """Free graphics and viewer; a reset makes them anew."""
        self._release(None)
        if self._has_window:
            cv2.destroyWindow(WINDOW)
            self._has_window = False
        for base in self._layouts.values():
            base.camera.close()
        self._layouts.clear()
        self._episode = None

    def save_dataset(self, out: str | Path) -> None:
        """Write the trial so far as a dataset folder with exact labels; see `record`.

        It is rendered again as the recorder does it; the images equal those of the trial byte by
        byte. The world is left as it was.

        Raises:
            TrialError: If `record` is off or nothing was driven.
            DatasetError: If `out` is in the way, or fewer than two image pairs were delivered.
        """
        episode, instance = self._episode, self._instance
        log = instance.simulation.log if instance else None
        if episode is None or instance is None or log is None or not instance.camera.delivered:
            raise TrialError("save_dataset: needs record=True, images, and a trial")
        if sum(instance.camera.delivered) < 2:
            raise DatasetError(f"{out}: a dataset needs at least two image pairs")
        failure = "" if episode.outcome in ("", "success", "timeout") else episode.outcome
        trip = log.trip(np.array(instance.camera.delivered), failure)
        simulation, world = instance.simulation, instance.simulation.world
        imu_hz = len(simulation.regular) * instance.settings.rig.rate_hz
        settings = amended(instance.settings, {"imu.rate_hz": imu_hz})
        camera = StereoCamera(world, settings.model_copy(update={"seed": episode.noise_seed}))
        before = world.data.qpos.copy()
        try:
            with DatasetWriter(Path(out)) as writer:
                record_trip(writer, world, trip, settings, camera, instance.camera.renderer)
        finally:
            world.data.qpos[:] = before
            world.move_movers(simulation.time_s)
            world.place_bodies()

    @property
    def instance(self) -> SceneInstance:
        """Scene instance of the present trial; raises a TrialError before the first reset."""
        if self._instance is None:
            raise TrialError("call reset first")
        return self._instance

    @property
    def episode(self) -> Episode:
        """The present trial; raises a TrialError before the first reset."""
        if self._episode is None:
            raise TrialError("call reset first")
        return self._episode

    def _observation(self, episode: Episode) -> Observation | Array:
        """Return the channels, or the one that was asked for by its name alone."""
        channels, wanted = episode.observation, self.trial.observe
        return channels[wanted] if isinstance(wanted, str) else channels

    def _layout(self, seed: int | None, wanted: int | None) -> SceneInstance:
        """Return the layout of this trial, built unless it is among those kept."""
        layout = wanted if wanted is not None else self.trial.layout
        if layout is None:
            layout = seed if seed is not None else next(reversed(self._layouts), None)
        if layout is None:
            layout = int(self.np_random.integers(MAX_SEED))
        if layout not in self._layouts:
            self._release(None)
            while len(self._layouts) >= self.trial.layouts_kept:  # first: a world takes memory
                self._layouts.pop(next(iter(self._layouts))).camera.close()
            self._layouts[layout] = self.trial.build(layout)
        self._layouts[layout] = base = self._layouts.pop(layout)
        return base

    def _place_rover(self, base: SceneInstance, options: Mapping[str, Any]) -> Assignment:
        """Assign a task whose start is free of moving things, and place the rover there."""
        start, why = np.zeros(3), ""
        for _ in range(MAX_STARTS):
            instance, task = self._assign(base, options)
            self._release(instance)
            self._instance = instance
            simulation, start = instance.simulation, task.start
            world, is_free = simulation.world, simulation.reset(start)
            inside = enclosing_geom(world.model, world.data, world.T_world_cam[:3, 3])
            if is_free and not inside:
                return instance, task
            fell = simulation.has_fallen
            why = "no ground carries the rover there" if fell else "a moving thing is there"
            why = f"the camera is inside {inside}" if is_free else why
        raise TrialError(f"start ({start[0]:g}, {start[1]:g}) m: {why}")

    def _release(self, instance: SceneInstance | None) -> None:
        """Free what belongs to the present instance alone, unless it remains the present one."""
        mine = self._instance
        if mine is not None and mine is not instance:
            if not any(mine is base for base in self._layouts.values()):
                mine.camera.close()
            self._instance = self._view = None

    def _image(self) -> Image:
        episode, instance = self.episode, self.instance
        self._view = self._view or TrialView(instance)
        caption = f"{instance.scene.name} {instance.layout}   {episode.localization}   "
        task = episode.task
        return self._view.draw(episode.trace, task.path, task.covered, caption + episode.outcome)

    def _show(self) -> None:
        cv2.imshow(WINDOW, np.ascontiguousarray(self._image()[..., ::-1]))
        cv2.waitKey(1)
        self._has_window = True
