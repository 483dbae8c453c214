"""The eyes: what the stereo pair delivers at the end of every step; the owner of a GL context."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sim.camera.camera import Capture, FrameExposure, StereoCamera
from sim.camera.exposure import mean_brightness, open_shutter
from sim.camera.render import GeometryBuffers, StereoRenderer
from sim.imaging.lens import delivered_rig
from sim.settings import RecordSettings
from sim.world.random_streams import stream
from sim.world.trip import Motions, Trip
from sim.world.world import World
from trials.gym.world.simulation import Simulation
from vo.contract.arrays import Array, Image
from vo.contract.rig import StereoRig

NONE: Array = np.zeros((0, 0))
UNSEEN = GeometryBuffers(NONE, NONE, NONE, NONE)
"""Depth and identity are not asked for unless the shutter stays open."""


class Eyes:
    """Both eyes of a rover in one world.

    Attributes:
        rig: Calibration as it is delivered.
        delivered: Whether each picture so far was kept; the last is shown in place of a lost one.
    """

    def __init__(self, world: World, settings: RecordSettings) -> None:
        """Prepare; the context is made when the first picture is taken.

        Raises:
            SettingsError: If the lens folds inside the picture.
        """
        self._world, self._settings = world, settings
        self._renderer: StereoRenderer | None = None
        self.rig: StereoRig = delivered_rig(world.rig, settings.calibration)
        self.reset(0, 1)

    @property
    def renderer(self) -> StereoRenderer:
        """Of the world; made in the process that asks first."""
        if self._renderer is None:
            settings = self._settings
            self._renderer = StereoRenderer(self._world, settings.render, settings.rig.color)
            self._renderer.__enter__()
        return self._renderer

    def reset(self, seed: int, most_pictures: int) -> None:
        """Begin a trial.

        Args:
            seed: Of noise and lost frames.
            most_pictures: That may be taken.
        """
        settings = self._settings.model_copy(update={"seed": seed})
        self._camera = StereoCamera(self._world, settings)
        self._drops = stream(seed, "drop")
        self._captures: Iterator[Capture] | None = None
        self._most = most_pictures
        self._times_ns = np.zeros(most_pictures, np.int64)
        self.delivered: list[bool] = []
        self._last: tuple[Image, Image] | None = None

    def look(self, simulation: Simulation) -> tuple[Image, Image]:
        """Take the picture of the step that just ended: left and right, (H, W) or (H, W, 3)."""
        kept = self._drops.random() >= self._settings.sensor.drop_share or self._last is None
        index = len(self.delivered)
        self.delivered.append(bool(kept))
        self._times_ns[index] = simulation.moment.time_ns
        capture = self._expose(simulation, index)
        if kept or self._last is None:
            self._last = self._camera.form_images(capture).rectified
            return self._last
        left, right = self._last
        return left.copy(), right.copy()

    def close(self) -> None:
        """Free the context; it is made anew when it is needed."""
        if self._renderer is not None:
            self._renderer.__exit__(None, None, None)
            self._renderer = None

    def _expose(self, simulation: Simulation, index: int) -> Capture:
        if len(simulation.window.times_ns) == 1:
            return self._snapshot(simulation.moment.time_ns, index)
        if self._captures is None:
            self._captures = self._camera.captures(self._live(simulation), self.renderer)
        data = self._world.data
        qpos = data.qpos.copy()
        capture = next(self._captures)  # moves the world to and fro
        data.qpos[:] = qpos
        self._world.move_movers(simulation.time_s)
        self._world.place_bodies()
        return replace(capture, index=index)

    def _snapshot(self, time_ns: int, index: int) -> Capture:
        """Of the world as it is; nothing moves while the shutter is open for an instant."""
        world = self._world
        world.move_movers(time_ns * 1e-9)
        world.place_bodies()
        shutter = open_shutter(
            self._settings.exposure, time_ns * 1e-9, 0.0, world.render_rig.height_px
        )
        brightness = mean_brightness(world, shutter)
        shot = FrameExposure(time_ns, 0.0, 1.0, 1, float(brightness.mean()))
        light = self.renderer.render_images()
        return Capture(
            index, shot, light, brightness, UNSEEN, world.T_world_cam, world.T_world_bodies
        )

    def _live(self, simulation: Simulation) -> Trip:
        """A trip whose frames and states appear as they are driven."""
        no_times, none = np.zeros(0, np.int64), np.zeros((0, 3))
        return Trip(
            self._times_ns,
            np.ones(self._most, bool),
            simulation.window,
            np.zeros((0, 4, 4)),
            none,
            Motions(no_times, np.zeros((0, 4, 4)), none, none, none),
            no_times,
            np.zeros((0, 2), np.int64),
            "",
        )
