"""Recording of datasets: a drive through a scene, with exact truth."""

import os
from collections.abc import Callable
from pathlib import Path

from driftyard.dataset import Dataset, PathLike
from driftyard.dataset import open as open_dataset
from driftyard.failures import in_one_family
from driftyard.given_settings import GivenSettings, sources_of
from scenes import SCENES
from sim.batch import DatasetTask, record_scene
from sim.camera_names import CAMERAS, DEFAULT_CAMERA
from trials.execution.recording_settings import recording_settings
from vo.contract.remarks import remark


def scenes() -> dict[str, str]:
    """Return the name of every registered scene, and what it tests.

    Example:
        >>> dy.scenes()["corridor"]
        'Blank walls and plain flooring: few features, ...'
    """
    return {name: builder.tests for name, builder in SCENES.items()}


def cameras() -> dict[str, str]:
    """Return the name of every camera, and what it is.

    Example:
        >>> dy.cameras()["zed"]
        'Stereolabs ZED: 12 cm, 720p, rolling shutter, colour'
    """
    return dict(CAMERAS)


@in_one_family
def record(
    scene: PathLike,
    out: PathLike,
    *,
    seed: int | None = None,
    camera: PathLike = DEFAULT_CAMERA,
    disturb: str = "",
    settings: GivenSettings = None,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Drive a rover through a scene, render it, write a dataset folder and open it.

    The same arguments, MuJoCo and OpenGL give the same bytes. The folder is complete or absent. A
    warning says so if the drive ended early, or the labels do not explain the images.

    Args:
        scene: Registered scene (`scenes`), MJCF file, or `module:function` that returns an
            `mujoco.MjSpec`.
        out: Folder to write.
        seed: Random seed of scene, route and noise; 0 by default.
        camera: One of `cameras`, or a TOML file of settings, which are used where `settings` has
            none. With `ideal`, a scene's own camera remains.
        disturb: Disturbances such as `blur,noise=0.5`, which `driftyard scenes` lists.
        settings: Values by name, nested or as `key.path`, or a TOML file; `driftyard settings
            recording` lists them with units.
        overwrite: Whether to replace an existing dataset.
        progress: Called with the number of frames done and that of all frames.

    Raises:
        SettingsError: If a scene, camera, disturbance, key or value is unknown or not accepted.
        DatasetError: If `out` exists, or the disk is full.
        DriftyardError: If the rover fails before the second frame, or there is no OpenGL.

    Example:
        >>> ds = dy.record("yard.xml", "drive", seed=3, disturb="noise", settings={
        ...     "drive.distance_m": 0.3, "rig": {"width_px": 64, "height_px": 48, "rate_hz": 5}})
        >>> ds.rig.width_px, ds.about["seed"], ds.labels
        (64, 3, ('depth', 'disparity'))
    """
    config, overrides = sources_of(settings)
    name, folder = os.fspath(scene), Path(out)
    resolved = recording_settings(name, seed, overrides, config, disturb, os.fspath(camera))
    recording = record_scene(DatasetTask(name, resolved, folder), overwrite, progress)
    for fault in recording.faults:
        remark(f"{folder}: {fault}")
    return open_dataset(folder)
