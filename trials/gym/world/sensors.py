"""Sensors of a trial: the stereo camera, which owns the OpenGL context, and the inertial unit."""

from collections.abc import Iterator

import numpy as np

from sim.camera.camera import NO_GEOMETRY, Capture, FrameExposure, StereoCamera
from sim.camera.exposure import mean_brightness, open_shutter
from sim.camera.render import StereoRenderer
from sim.imaging.lens import delivered_rig
from sim.sensors.inertial import T_body_imu, ideal_readings
from sim.settings import ImuSettings, RecordSettings
from sim.world.random_streams import stream
from sim.world.trip import Motions, Trip
from sim.world.world import World
from trials.gym.world.simulation import Simulation
from vo.contract.arrays import Array, Image
from vo.contract.rig import StereoRig

GYRO_MAX_RADPS, ACCEL_MAX_MPS2 = 35.0, 160.0
"""Measurement range; values beyond are clipped."""


class RoverCamera:
    """Stereo camera of the rover in one world.

    Attributes:
        rig: Calibration as delivered.
        delivered: Whether each image pair so far was delivered; a lost one repeats the last.
    """

    def __init__(self, world: World, settings: RecordSettings) -> None:
        """Prepare; the context is made when the first image is taken.

        Raises a SettingsError if the lens folds inside the image.
        """
        self._world, self._settings = world, settings
        self._renderer: StereoRenderer | None = None
        self.rig: StereoRig = delivered_rig(world.rig, settings.calibration)
        self._camera = StereoCamera(world, settings)
        self.reset(0, 1)

    @property
    def renderer(self) -> StereoRenderer:
        """Renderer of the world, made in the process of the first use."""
        if self._renderer is None:
            settings = self._settings
            renderer = StereoRenderer(self._world, settings.render, settings.rig.color)
            self._renderer = renderer.__enter__()
        return self._renderer

    def reset(self, seed: int, max_frames: int) -> None:
        """Begin a trial of at most `max_frames` image pairs; the seed is that of the noise."""
        self._camera = self._camera.with_seed(seed)
        self._drops = stream(seed, "drop")
        self._captures: Iterator[Capture] | None = None
        self._times_ns = np.zeros(max_frames, np.int64)
        self._is_kept = np.zeros(max_frames, bool)
        self.delivered: list[bool] = []
        self._last: tuple[Image, Image] | None = None

    def capture(self, simulation: Simulation) -> tuple[Image, Image]:
        """Take the images of the step that just ended: left and right, (H, W) or (H, W, 3)."""
        kept = self._drops.random() >= self._settings.sensor.drop_share or self._last is None
        index = len(self.delivered)
        self.delivered.append(bool(kept))
        self._is_kept[index] = kept
        self._times_ns[index] = simulation.snapshot.time_ns
        if kept or self._last is None:
            capture = self._expose(simulation, index)
            self._last = self._camera.form_images(capture).rectified
        return self._last

    def close(self) -> None:
        """Free the context; it is made anew when needed."""
        if self._renderer is not None:
            self._renderer.__exit__(None, None, None)
            self._renderer = None

    def _expose(self, simulation: Simulation, index: int) -> Capture:
        if len(simulation.window.times_ns) == 1:
            return self._instant_exposure(simulation.snapshot.time_ns, index)
        if self._captures is None:
            trip = self._live_trip(simulation)
            self._captures = self._camera.captures(trip, self.renderer, labelled=False)
        data = self._world.data
        qpos = data.qpos.copy()
        capture = next(self._captures)  # moves the world to and fro
        data.qpos[:] = qpos
        self._world.move_movers(simulation.time_s)
        self._world.place_bodies()
        return capture

    def _instant_exposure(self, time_ns: int, index: int) -> Capture:
        """Render the world as it is: nothing moves during an exposure of no duration."""
        world = self._world
        world.move_movers(time_ns * 1e-9)
        world.place_bodies()
        shutter = open_shutter(
            self._settings.exposure, time_ns * 1e-9, 0.0, world.render_rig.height_px
        )
        brightness = mean_brightness(world, shutter)
        exposure = FrameExposure(time_ns, 0.0, 1.0, 1, float(brightness.mean()))
        light = self.renderer.render_images()
        if not self._settings.weather.is_clear:
            geometry = self.renderer.render_whole_geometry(self.renderer.render_geometry())
            light = self._camera.through_air(light, geometry, world.T_world_cam, 0.0, index)
        return Capture(
            index, exposure, light, brightness, NO_GEOMETRY, world.T_world_cam,
            world.T_world_bodies,
        )  # fmt: skip

    def _live_trip(self, simulation: Simulation) -> Trip:
        """A trip whose frames and states appear as they are driven."""
        no_times, none = np.zeros(0, np.int64), np.zeros((0, 3))
        return Trip(
            self._times_ns,
            self._is_kept,
            simulation.window,
            np.zeros((0, 4, 4)),
            none,
            Motions(no_times, np.zeros((0, 4, 4)), none, none, none),
            no_times,
            np.zeros((0, 2), np.int64),
            "",
        )


class InertialUnit:
    """Measures the mean rates since the previous reading."""

    def __init__(self, settings: ImuSettings, rng: np.random.Generator) -> None:
        self._settings, self._rng = settings, rng
        self._T_body_imu = T_body_imu(settings)
        self._before: tuple[int, Array, Array, Array] | None = None
        self._bias = np.zeros(6)

    def read(self, simulation: Simulation) -> Array:
        """(6,) angular velocity, rad/s, and specific force, m/s^2, in the axes of the unit.

        The first reading is that of a unit at rest on level ground, without noise.
        """
        world = simulation.world
        now = (round(simulation.time_s * 1e9), *simulation.body_motion())
        before, self._before = self._before, now
        if before is None:
            R_world_imu = now[1][:3, :3] @ self._T_body_imu[:3, :3]
            return np.concatenate([np.zeros(3), -world.gravity_mps2 @ R_world_imu])
        times_ns, *states = (np.array(pair) for pair in zip(before, now, strict=True))
        T, v, w = states
        ideal = ideal_readings(times_ns, T, v, w, self._T_body_imu, world.gravity_mps2)
        s, dt = self._settings, float(times_ns[1] - times_ns[0]) * 1e-9
        densities = np.repeat([s.gyroscope_noise_density, s.accelerometer_noise_density], 3)
        walks = np.repeat([s.gyroscope_random_walk, s.accelerometer_random_walk], 3)
        white = densities / dt**0.5 * self._rng.standard_normal(6)
        reading = np.concatenate([ideal.gyro_radps[0], ideal.accel_mps2[0]])
        reading = reading + s.noise * white + self._bias
        self._bias = self._bias + s.noise * walks * dt**0.5 * self._rng.standard_normal(6)
        limits = np.repeat([GYRO_MAX_RADPS, ACCEL_MAX_MPS2], 3)
        return np.clip(reading, -limits, limits)
