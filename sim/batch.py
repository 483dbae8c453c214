"""Datasets to record: scene, settings and folder, which is kept if it exists with the same ones."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scenes import build_scene, find_scene
from scenes.custom import is_custom
from scenes.scene import Scene
from sim.progress import Progress
from sim.record import Recording, record
from sim.settings import RecordSettings, recorded_settings
from sim.world.fingerprint import changes_since, fingerprint
from sim.world.random_streams import stream
from sim.world.world import build_world
from vo.contract.dataset import MANIFEST, DatasetWriter, read_manifest
from vo.contract.errors import DatasetError
from vo.contract.settings import with_defaults


@dataclass(frozen=True)
class DatasetTask:
    """A dataset to record: a scene (name, MJCF file or `module:function`), settings, folder."""

    scene: str
    settings: RecordSettings
    out: Path

    @property
    def is_done(self) -> bool:
        """Whether the folder is a dataset of this task already.

        Raises:
            DatasetError: If the folder holds something else.
        """
        if not self.out.exists():
            return False
        if not (self.out / MANIFEST).is_file():
            raise DatasetError(f"{self.out}: exists and is not a dataset; choose another folder")
        self.check_same(read_manifest(self.out), str(self.out))
        return True

    def check_same(self, made: Mapping[str, Any], place: str) -> None:
        """Compare with the manifest of a dataset at a place.

        Raises:
            DatasetError: If it is of another scene or of other settings.
        """
        wanted = with_defaults(self.settings, find_scene(self.scene).defaults)
        same = recorded_settings(made["settings"]) == wanted
        if not same or made["scene"]["source"] != self.scene:
            raise DatasetError(f"{place}: exists with other settings; choose another folder")
        if is_custom(self.scene) and "world" in made:
            world = build_world(build(self.scene, self.settings), self.settings)
            if problem := changes_since(made["world"], world):
                raise DatasetError(f"{place}: exists, and {problem} since; choose another folder")


def build(scene: str, settings: RecordSettings) -> Scene:
    """Build a scene from its own random stream.

    Raises:
        SettingsError: If there is no such scene or option.
    """
    return build_scene(scene, stream(settings.seed, "scene"), settings.scene)


def record_scene(
    task: DatasetTask,
    overwrite: bool = False,
    progress: Progress | None = None,
    recorded: Mapping[str, Any] | None = None,
) -> Recording:
    """Build the scene of a task and record it; arguments and errors are those of `record`.

    An existing folder is refused before the scene is built.
    """
    DatasetWriter(task.out, overwrite)
    scene = build(task.scene, task.settings)
    return record(scene, task.settings, task.out, overwrite, progress, recorded)


def custom_fingerprint(scene: str, settings: RecordSettings) -> str:
    """Return the `fingerprint` of a custom scene as JSON, "" of another, which its name tells.

    Raises:
        SettingsError: If the scene cannot be built.
    """
    if not is_custom(scene):
        return ""
    return json.dumps(fingerprint(build_world(build(scene, settings), settings)))


def obtain(task: DatasetTask, progress: Progress | None = None) -> Recording:
    """Record a dataset, or read what the recording of an existing one said."""
    if task.is_done:
        made = read_manifest(task.out)
        return Recording(made["certificate"], made["ended"])
    return record_scene(task, progress=progress)
