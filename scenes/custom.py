"""A user's own world: an MJCF file, or a function that builds an MjSpec or a whole Scene."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from scenes.geometry.routes import rounded_loop
from scenes.scene import COLLISION_GROUP, Scene
from vo.contract.errors import SettingsError

TESTS = "A world of your own."
LOOP_M = 2.0
"""Side of the default route, a rounded square around the origin."""
MARGIN_M = 0.5


def is_custom(name: str) -> bool:
    """Whether a scene's name is a file or a `module:function` rather than a registered name."""
    return name.endswith((".xml", ".mjcf")) or ":" in name


def load_scene(name: str) -> Scene:
    """Build the scene that a file or a function describes.

    Args:
        name: Path of an MJCF file, or `module:function`; the function takes nothing and returns
            an MjSpec or a Scene. Modules are looked for in the working directory too.

    Raises:
        SettingsError: If it cannot be read, imported or compiled; one line.
    """
    made = _from_function(name) if ":" in name else _from_file(Path(name))
    if isinstance(made, Scene):
        return replace(made, source=name)
    try:
        model = made.compile()
    except ValueError as error:
        raise SettingsError(f"{name}: does not compile ({_one_line(error)})") from None
    half = LOOP_M / 2
    square = np.array([(half, -half), (half, half), (-half, half), (-half, -half)])
    stem = name.split(":")[-1] if ":" in name else Path(name).stem
    return Scene(
        name=stem,
        tests=TESTS,
        spec=made,
        routes={"default": rounded_loop(square, radius_m=0.5)},
        extent_m=_extent(model),
        tags=frozenset({"custom"}),
        source=name,
    )


def _from_file(path: Path) -> mujoco.MjSpec:
    if not path.is_file():
        raise SettingsError(f"{path}: no such file")
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise SettingsError(f"{path}: not valid MJCF ({_one_line(error)})") from None


def _from_function(name: str) -> mujoco.MjSpec | Scene:
    module_name, _, function_name = name.partition(":")
    if not module_name or not function_name:
        raise SettingsError(f"{name}: expected module:function")
    if "" not in sys.path:
        sys.path.insert(0, "")
    try:
        module = importlib.import_module(module_name)
    except (ImportError, SyntaxError) as error:
        reason = _one_line(error)
        raise SettingsError(f"{name}: cannot import {module_name} ({reason})") from None
    build = getattr(module, function_name, None)
    if not callable(build):
        raise SettingsError(f"{name}: {module_name} has no function {function_name}")
    made = build()
    if not isinstance(made, mujoco.MjSpec | Scene):
        kind = type(made).__name__
        raise SettingsError(f"{name}: returned a {kind}, must be an MjSpec or a Scene")
    return made


def _extent(model: mujoco.MjModel) -> tuple[float, float, float, float]:
    """Bounding square of everything but planes, with the default route in it."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bounded = (model.geom_rbound > 0) & (model.geom_group < COLLISION_GROUP)
    centres, radii = data.geom_xpos[bounded, :2], model.geom_rbound[bounded, None]
    route = np.array([[-LOOP_M / 2, -LOOP_M / 2], [LOOP_M / 2, LOOP_M / 2]])
    low = np.vstack([centres - radii, route]).min(axis=0) - MARGIN_M
    high = np.vstack([centres + radii, route]).max(axis=0) + MARGIN_M
    return (float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
