"""Values of a compiled world that are no finite numbers: MuJoCo compiles them."""

import mujoco
import numpy as np

from scenes.scene import Scene
from vo.contract.errors import SettingsError

KINDS = ("body", "jnt", "geom", "site", "light", "cam", "key")
"""Prefixes of the fields whose rows belong to objects with names."""
DERIVED = ("aabb", "rbound", "invweight0", "pos0", "poscom0", "subtreemass")
"""Ends of the names of fields that the compiler computes from others."""


def expect_finite(scene: Scene, model: mujoco.MjModel) -> None:
    """Refuse a world with other than finite numbers.

    Raises:
        SettingsError: Names the first field and its object.
    """
    for field in (x for x in dir(model) if x.startswith(KINDS) and not x.endswith(DERIVED)):
        value, (kind, _, what) = getattr(model, field), field.partition("_")
        if not isinstance(value, np.ndarray):
            continue
        for row in np.argwhere(~np.isfinite(value))[:, 0].tolist():
            name = getattr(model, kind)(row).name or row
            said = " ".join(f"{x:g}" for x in np.ravel(value[row]))
            raise SettingsError(
                f"scene {scene.name}: {what} of {kind} {name} is {said}, expected finite numbers"
            )
    if not np.isfinite(model.opt.gravity).all():
        raise SettingsError(f"scene {scene.name}: gravity is {model.opt.gravity}, expected numbers")
