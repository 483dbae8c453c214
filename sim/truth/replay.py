"""A recorded drive once more: its world, and what the cameras see in each frame."""

from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from sim.batch import build
from sim.camera.camera import cropped_geometry, place_and_render
from sim.camera.render import StereoRenderer
from sim.labels.annotate import Annotator
from sim.labels.views import View
from sim.settings import RecordSettings, recorded_settings
from sim.world.fingerprint import expect_unchanged
from sim.world.trip import Trip, make_trip
from sim.world.world import World, build_world
from vo.contract.arrays import Array, Indices
from vo.contract.errors import DatasetError

SAME_POSE = 1e-6
"""Largest difference of the recorded and the simulated camera's pose, m and rad."""


@dataclass(frozen=True)
class Replay:
    """A simulated drive that agrees with a recorded one; `world.data` is moved along it."""

    settings: RecordSettings
    world: World
    trip: Trip

    @cached_property
    def annotator(self) -> Annotator:
        """Objects by number, as in the labels of the dataset."""
        return Annotator(self.world)

    @contextmanager
    def views(self) -> Generator[Callable[[int], View]]:
        """Open the renderer, and yield a function from a frame's time, ns, to its view.

        Raises:
            GraphicsError: If there is no OpenGL.
        """
        with StereoRenderer(self.world, self.settings.render) as renderer:

            def view(time_ns: int) -> View:
                geometry = place_and_render(self.world, self.trip, renderer, time_ns)
                cropped = cropped_geometry(self.world, geometry)
                poses = self.world.T_world_cam, self.world.T_world_bodies
                return self.annotator.view(cropped, *poses)

            yield view


def recorded_world(manifest: Mapping[str, Any]) -> tuple[World, RecordSettings]:
    """Build the world of a dataset again.

    Raises:
        DatasetError: If a custom scene changed since.
        SettingsError: If the scene is not found, or its settings are not accepted.
    """
    settings = recorded_settings(manifest["settings"])
    world = build_world(build(manifest["scene"]["source"], settings), settings)
    expect_unchanged(manifest, world)
    return world, settings


def replay(manifest: Mapping[str, Any], times_ns: Indices, T_world_cam: Array) -> Replay:
    """Simulate the drive of a dataset again, without images.

    Args:
        manifest: Of the dataset.
        times_ns: (N,) times of frames.
        T_world_cam: (N, 4, 4) recorded poses of the left camera at these times.

    Raises:
        DatasetError: If another version of MuJoCo, or a changed scene, gives another drive.
        SettingsError: As `recorded_world`.
    """
    world, settings = recorded_world(manifest)
    trip = make_trip(world, settings)
    rows = np.searchsorted(trip.timestamps_ns, times_ns).clip(0, len(trip) - 1)
    simulated = trip.T_world_body[rows] @ world.rig.T_body_cam
    same = (trip.timestamps_ns[rows] == times_ns).all()
    if not same or not np.allclose(simulated, T_world_cam, rtol=0, atol=SAME_POSE):
        version = manifest.get("software", {}).get("mujoco", "unknown")
        raise DatasetError(f"MuJoCo {version} simulated it, {mujoco.__version__} does otherwise")
    return Replay(settings, world, trip)
