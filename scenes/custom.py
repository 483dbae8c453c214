"""Custom scenes: an MJCF file, or a function that builds an MjSpec or a Scene."""

import importlib
import inspect
import os
import sys
import traceback
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from scenes.assets import mjcf_assets, module_assets
from scenes.geometry.routes import rounded_loop
from scenes.scene import COLLISION_GROUP, HOME, Scene
from vo.contract.errors import SettingsError
from vo.contract.packages import PACKAGES

TESTS = "A custom scene."
LOOP_M = 2.0
"""Side of the default route, a rounded square around the origin."""
MARGIN_M = 0.5
OTHERS = (
    *(f"{Path(inspect.getfile(module)).parent}/" for module in (inspect, np, mujoco)),
    *(f"{Path(__file__).parents[1]}/{package}/" for package in PACKAGES),
    *("<frozen", "site-packages"),
)
"""Parts of the paths of Python, of libraries and of driftyard, which are not the user's."""


def is_custom(name: str) -> bool:
    """Return whether a scene's name is an MJCF file or a `module:function`."""
    return is_file(name) or ":" in name


def is_file(name: str) -> bool:
    """Return whether a scene's name is that of an MJCF file, which may have colons in it."""
    return name.lower().endswith((".xml", ".mjcf"))


def load_scene(name: str) -> Scene:
    """Build the scene of an MJCF file, or of a `module:function`.

    The function takes no arguments and returns an MjSpec or a Scene; its module is searched for in
    the working directory too.

    Raises:
        SettingsError: If it cannot be read, imported or compiled; one line.
    """
    if is_file(name):
        made, assets = _from_file(Path(name)), mjcf_assets(Path(name))
    else:
        made, assets = _from_function(name)
    if isinstance(made, Scene):
        return replace(made, source=name, assets=assets)
    for geom in made.geoms:  # MuJoCo draws groups 0 to 2; those above are of scenes of ours
        geom.group = min(geom.group, COLLISION_GROUP)
    given = next((len(key.qpos) for key in made.keys if key.name == HOME), 0)
    try:
        model = made.compile()
    except ValueError as error:
        raise SettingsError(
            f"{name}: does not compile ({_one_line(error)}); correct the model"
        ) from None
    if given not in (0, model.nq):  # MuJoCo fills it up
        raise SettingsError(f"{name}: qpos of key {HOME} has {given} numbers, expected {model.nq}")
    half = LOOP_M / 2
    square = np.array([(half, -half), (half, half), (-half, half), (-half, -half)])
    stem = Path(name).stem if is_file(name) else name.split(":")[-1]
    routes = {"default": rounded_loop(square, radius_m=0.5)}
    found = stem, TESTS, made, routes, _extent(model), frozenset({"custom"})
    return Scene(*found, source=name, assets=assets)


def _from_file(path: Path) -> mujoco.MjSpec:
    if not path.is_file():
        found = "is a folder" if path.is_dir() else "no such file"
        raise SettingsError(f"{path}: {found}; give the path of an MJCF file")
    name, given = str(path), dict[str, bytes]()
    if path.suffix != ".xml":  # the only suffix that MuJoCo takes for MJCF
        name, given = f"{path}.xml", {f"{path}.xml": path.read_bytes()}
    try:
        return mujoco.MjSpec.from_file(name, include=given)
    except ValueError as error:
        reason = _one_line(error)
        raise SettingsError(f"{path}: not valid MJCF ({reason}); correct the file") from None


def _from_function(name: str) -> tuple[mujoco.MjSpec | Scene, dict[str, str]]:
    """Call a user's function; returns what it made and the hashes of its files."""
    module_name, _, function_name = name.partition(":")
    if not module_name or not function_name:
        raise SettingsError(f"{name}: expected module:function, for example worlds:yard")
    if "" not in sys.path:
        sys.path.insert(0, "")
    with _named(name, f"cannot import {module_name}"):
        module = importlib.import_module(module_name)
    build = getattr(module, function_name, None)
    if not callable(build):
        found = ", ".join(n for n, f in vars(module).items() if inspect.isfunction(f)) or "none"
        raise SettingsError(
            f"{name}: {module_name} has no function {function_name}; its functions: {found}"
        )
    with _named(name, f"{function_name} takes arguments, expected none"):
        inspect.signature(build).bind()
    with _named(name, f"{function_name} failed"):
        made = build()
    if isinstance(made, Scene):
        made = _checked(name, made)
    elif not isinstance(made, mujoco.MjSpec):
        kind = type(made).__name__
        raise SettingsError(
            f"{name}: returned a {kind}; return a mujoco.MjSpec or a scenes.scene.Scene"
        )
    return made, module_assets(module)


def _checked(name: str, scene: Scene) -> Scene:
    """Check the values and the functions of a user's Scene; what these raise becomes one line."""

    def expect(holds: object, field: str, what: str) -> None:
        if not holds:
            raise SettingsError(f"{name}: {field} of the Scene: expected {what}")

    def guarded(field: str, function: Callable[[Any], Any]) -> Callable[[Any], Any]:
        def call(value: Any) -> Any:
            with _named(name, f"{field} failed"):
                return function(value)

        return call

    expect(isinstance(scene.spec, mujoco.MjSpec), "spec", "a mujoco.MjSpec")
    expect("default" in scene.routes, "routes", "one named default")
    for key, route in scene.routes.items():
        points = np.asarray(route)
        right = points.ndim == 2 and points.shape[1] == 2 and len(points) >= 2
        expect(right and np.isfinite(points).all(), f"route {key}", "(N, 2) x, y in m, N >= 2")
    extent = np.asarray(scene.extent_m)
    expect(extent.shape == (4,) and (extent[:2] < extent[2:]).all(), "extent_m", "x, y, x, y in m")
    movers = {key: guarded(f"mover {key}", motion) for key, motion in scene.movers.items()}
    for key, motion in movers.items():
        body = scene.spec.body(key)
        expect(body is not None and body.mocap, f"mover {key}", "the name of a mocap body")
        expect(np.shape(motion(0.0)) == (4, 4), f"mover {key}", "a function to (4, 4) poses")
    elevation, light = (
        guarded(field, function)
        for field, function in (("elevation", scene.elevation), ("brightness", scene.brightness))
    )
    expect(np.shape(elevation(np.zeros((3, 2)))) in ((), (3,)), "elevation", "(N, 2) to (N,) m")
    expect(np.shape(light(np.zeros(3))) in ((), (3,)), "brightness", "(N,) s to (N,)")
    return replace(scene, movers=movers, elevation=elevation, brightness=light)


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


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())


@contextmanager
def _named(name: str, what: str) -> Generator[None]:
    """Turn whatever a user's module raises into a SettingsError with its file and line."""
    try:
        yield
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit, and what a user derives
        raise SettingsError(f"{name}: {what} ({_cause(error)})") from error


def _cause(error: BaseException) -> str:
    """Name an error of a user's code, with the file and line of that code."""
    said = f"{type(error).__name__}: {_one_line(error)}".removesuffix(": ")
    frames = traceback.extract_tb(error.__traceback__)
    theirs = [x for x in frames if not any(part in x.filename for part in OTHERS)]
    places = [(x.filename, x.lineno) for x in theirs]
    if isinstance(error, SyntaxError) and error.filename:
        places, said = [(error.filename, error.lineno)], f"SyntaxError: {error.msg}"
    return f"{os.path.relpath(places[-1][0])}:{places[-1][1]}: {said}" if places else said
