"""The physics of a world: what of a user's options is replaced, and whether it stays stable."""

from typing import Any

import mujoco

from scenes.scene import HOME
from sim.world.drive import DriveError
from sim.world.world import World
from vo.contract.remarks import remark

UNSTABLE = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
    mujoco.mjtWarning.mjWARN_BADCTRL,
)
"""Warnings after which MuJoCo resets the world, or leaves values that are no numbers."""


def physics_entry(world: World) -> dict[str, Any]:
    """Return gravity, keyframes and options of a world for the manifest, JSON-ready.

    `replaced` has the value in the scene and the one used instead, where these differ.
    """
    given, used = _options(world.scene.spec.option), _options(world.model.opt)
    replaced = {
        name: {"scene": value, "used": used[name]}
        for name, value in given.items()
        if value != used[name]
    }
    names = [key.name for key in world.scene.spec.keys]
    return {
        "gravity_mps2": world.gravity_mps2.tolist(),
        **used,
        "replaced": replaced,
        "keyframe": HOME if HOME in names else "",
        "keyframes_ignored": [name for name in names if name != HOME],
    }


def remark_replaced(world: World) -> None:
    """Issue a remark on what a custom scene sets, other than MuJoCo does, and is replaced."""
    replaced, default = physics_entry(world)["replaced"], _options(mujoco.MjSpec().option)
    chosen = {name: x for name, x in replaced.items() if x["scene"] != default[name]}
    if chosen:
        said = ", ".join(f"{name} {x['scene']} by {x['used']}" for name, x in chosen.items())
        remark(f"{world.scene.source or world.scene.name}: replaced are {said}")


def expect_stable(world: World, time_s: float) -> None:
    """Raise a DriveError if MuJoCo found the physics unstable: it resets the world in silence."""
    for kind in UNSTABLE:
        if world.data.warning[kind].number:
            raise DriveError(
                f"the physics is unstable at {time_s:.2f} s: the world of the scene diverges at "
                f"its time step of {1e3 * world.model.opt.timestep:g} ms"
            )


def _options(option: Any) -> dict[str, Any]:
    return {
        "timestep_s": float(option.timestep),
        "integrator": mujoco.mjtIntegrator(option.integrator).name.removeprefix("mjINT_").lower(),
        "cone": mujoco.mjtCone(option.cone).name.removeprefix("mjCONE_").lower(),
        "impratio": float(option.impratio),
    }
