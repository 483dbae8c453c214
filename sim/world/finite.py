"""Values of a compiled world that are no finite numbers: MuJoCo compiles them."""

import mujoco
import numpy as np

from scenes.scene import Scene
from vo.contract.errors import SettingsError

KINDS = {
    "body": mujoco.mjtObj.mjOBJ_BODY,
    "jnt": mujoco.mjtObj.mjOBJ_JOINT,
    "geom": mujoco.mjtObj.mjOBJ_GEOM,
    "site": mujoco.mjtObj.mjOBJ_SITE,
    "light": mujoco.mjtObj.mjOBJ_LIGHT,
    "cam": mujoco.mjtObj.mjOBJ_CAMERA,
    "key": mujoco.mjtObj.mjOBJ_KEY,
}
"""Prefixes of the fields whose rows belong to objects with names."""
DERIVED = ("aabb", "rbound", "invweight0", "pos0", "poscom0", "subtreemass")
"""Ends of the names of fields that the compiler computes from others."""


def expect_finite(scene: Scene, model: mujoco.MjModel) -> None:
    """Check that a user's world has finite numbers only.

    Raises:
        SettingsError: If it does not; names the first field and its object.
    """
    for field in dir(model):
        kind, _, what = field.partition("_")
        value = getattr(model, field)
        if kind not in KINDS or not isinstance(value, np.ndarray) or field.endswith(DERIVED):
            continue
        for row in np.argwhere(~np.isfinite(value))[:, 0].tolist():
            name = mujoco.mj_id2name(model, KINDS[kind], row) or str(row)
            said = " ".join(f"{x:g}" for x in np.ravel(value[row]))
            raise SettingsError(
                f"scene {scene.name}: {what} of {kind} {name} is {said}, expected finite numbers"
            )
    if not np.isfinite(model.opt.gravity).all():
        raise SettingsError(f"scene {scene.name}: gravity is {model.opt.gravity}, expected numbers")
