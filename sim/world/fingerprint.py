"""The fingerprint of a world: hashes of the compiled model and of the files it was made from."""

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any

import mujoco
import numpy as np

from scenes.custom import is_file
from sim.world.world import World
from vo.contract.errors import DatasetError
from vo.contract.remarks import remark

BY_SETTINGS = frozenset(
    {
        *("opt.timestep", "vis.map.znear", "vis.map.zfar", "vis.global_.offwidth"),
        *("vis.global_.offheight", "vis.quality.offsamples", "vis.quality.shadowsize"),
    }
)
"""Values that physics and renderer set after the model is compiled, from the settings."""

DERIVED = ("signature", "nbuffer")
"""Values that depend on the names of files."""


def fingerprint(world: World) -> dict[str, Any]:
    """Return the hashes of a world for the manifest, JSON-ready.

    `sha256` is of the compiled model with carrier and terrain; the names of files do not count.
    `assets` has the files of a custom scene, by their paths from its folder.
    """
    found = hashlib.sha256()
    for name, value in _fields(world.model, ""):
        found.update(name.encode())
        found.update(value if isinstance(value, bytes) else np.ascontiguousarray(value).data)
    return {"sha256": found.hexdigest(), "assets": dict(sorted(world.scene.assets.items()))}


def changes_since(recorded: Mapping[str, Any], world: World) -> str:
    """Say what of a world changed since its fingerprint was recorded; empty if nothing did.

    Files of an MJCF scene that were edited without a change of the compiled world bring a remark; a
    module holds more than its world.
    """
    now = fingerprint(world)
    then_assets, now_assets = recorded.get("assets", {}), now["assets"]
    names = sorted({*then_assets, *now_assets})
    changed = [name for name in names if then_assets.get(name) != now_assets.get(name)]
    is_same = now["sha256"] == recorded.get("sha256")
    if changed and is_same and is_file(world.scene.source):
        remark(f"{world.scene.source}: {', '.join(changed)} changed, the compiled world did not")
    elif changed:
        return f"{', '.join(changed)} changed"
    if is_same:
        return ""
    return f"the compiled world changed (MuJoCo is {mujoco.__version__} here)"


def expect_unchanged(recorded: Mapping[str, Any], world: World) -> None:
    """Compare a world with the manifest of an earlier dataset of the same scene.

    Of a registered scene, another version or processor may be the cause of a change: a remark.

    Raises:
        DatasetError: If a custom scene changed.
    """
    name = world.scene.source or world.scene.name
    if "world" not in recorded:
        remark(f"{name}: whether it changed is unknown, the dataset has no hash of its world")
        return
    if problem := changes_since(recorded["world"], world):
        if world.scene.source:
            raise DatasetError(
                f"{name}: {problem} since it was recorded; restore it, or record it as it is by "
                f"`driftyard generate {name}`"
            )
        remark(f"scene {name}: {problem} since it was recorded; images and labels may differ")


def _fields(struct: Any, prefix: str) -> Iterator[tuple[str, Any]]:
    """Yield the values of one of MuJoCo's structures and those inside, but no paths of files."""
    for name in sorted(dir(struct)):
        value, full = getattr(struct, name), prefix + name
        if name.startswith("_") or callable(value) or "path" in name or name in DERIVED:
            continue
        if not isinstance(value, np.ndarray | int | float | bytes):
            yield from _fields(value, f"{full}.")
        elif full not in BY_SETTINGS:
            yield full, value
