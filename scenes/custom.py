"""Custom scenes: an MJCF file, or a function that builds an MjSpec or a Scene."""

import importlib
import inspect
import sys
import traceback
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from scenes.geometry.routes import rounded_loop
from scenes.scene import COLLISION_GROUP, Scene
from vo.contract.errors import SettingsError

TESTS = "A custom scene."
LOOP_M = 2.0
"""Side of the default route, a rounded square around the origin."""
MARGIN_M = 0.5


def is_custom(name: str) -> bool:
    """Return whether a scene's name is an MJCF file or a `module:function`."""
    return name.endswith((".xml", ".mjcf")) or ":" in name


def load_scene(name: str) -> Scene:
    """Build the scene of an MJCF file, or of a `module:function`.

    The function takes no arguments and returns an MjSpec or a Scene; its module is searched for in
    the working directory too.

    Raises:
        SettingsError: If it cannot be read, imported or compiled; one line.
    """
    made = _from_function(name) if ":" in name else _from_file(Path(name))
    if isinstance(made, Scene):
        return replace(made, source=name)
    try:
        model = made.compile()
    except ValueError as error:
        raise SettingsError(
            f"{name}: does not compile ({_one_line(error)}); correct the model"
        ) from None
    half = LOOP_M / 2
    square = np.array([(half, -half), (half, half), (-half, half), (-half, -half)])
    stem = name.split(":")[-1] if ":" in name else Path(name).stem
    routes = {"default": rounded_loop(square, radius_m=0.5)}
    return Scene(stem, TESTS, made, routes, _extent(model), frozenset({"custom"}), source=name)


def _from_file(path: Path) -> mujoco.MjSpec:
    if not path.is_file():
        raise SettingsError(f"{path}: no such file; give the path of an MJCF file")
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        reason = _one_line(error)
        raise SettingsError(f"{path}: not valid MJCF ({reason}); correct the file") from None


def _from_function(name: str) -> mujoco.MjSpec | Scene:
    module_name, _, function_name = name.partition(":")
    if not module_name or not function_name:
        raise SettingsError(f"{name}: expected module:function, for example worlds:yard")
    if "" not in sys.path:
        sys.path.insert(0, "")
    try:
        module = importlib.import_module(module_name)
    except Exception as error:  # whatever the user's module raises
        raise SettingsError(f"{name}: cannot import {module_name} ({_cause(error)})") from error
    build = getattr(module, function_name, None)
    if not callable(build):
        found = ", ".join(n for n, f in vars(module).items() if inspect.isfunction(f)) or "none"
        raise SettingsError(
            f"{name}: {module_name} has no function {function_name}; its functions: {found}"
        )
    try:
        made = build()
    except Exception as error:  # whatever the user's function raises
        raise SettingsError(f"{name}: {function_name} failed ({_cause(error)})") from error
    if not isinstance(made, mujoco.MjSpec | Scene):
        kind = type(made).__name__
        raise SettingsError(
            f"{name}: returned a {kind}; return a mujoco.MjSpec or a scenes.scene.Scene"
        )
    return made


def _extent(model: mujoco.MjModel) -> tuple[float, float, float, float]:
    """Return the bounding rectangle of all geoms but planes and of the default route."""
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


def _cause(error: Exception) -> str:
    """Name an error of the user's code, with the file and line that raised it."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    inside = isinstance(error, ImportError | SyntaxError)
    where = "" if inside else f" at {Path(frame.filename).name}, line {frame.lineno}"
    return f"{type(error).__name__}{where}: {_one_line(error)}"
