"""The objects that images and labels show, by number: geoms, sites, tendons, flexes and skins."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from scenes.scene import COLLISION_GROUP, Kind, Thing
from sim.world.enclosure import opacity
from sim.world.world import World, thing_of
from vo.contract.arrays import Indices, Mask

OPAQUE = 0.995
"""Opacity below which MuJoCo draws what is behind a surface, too."""


@dataclass(frozen=True)
class DrawnObjects:
    """What may be drawn, by number: N objects, geoms first.

    Attributes:
        first: Number of the first object of each of MuJoCo's types.
        things: Thing that each object shows.
        deforms: (N,) whether it is no rigid body, so that no label tells where its points move.
        see_through: (N,) whether what is behind it is seen too, so that no label explains it.
    """

    first: dict[int, int]
    things: list[Thing]
    deforms: Mask
    see_through: Mask

    def numbers(self, scene: mujoco.MjvScene, nothing: int) -> Indices:
        """Return the object's number for each number (N,) of a segmented drawing of the scene."""
        numbers = np.full(scene.ngeom + 1, nothing, dtype=np.int32)
        for geom in scene.geoms[: scene.ngeom]:
            if geom.objtype in self.first:
                numbers[geom.segid + 1] = self.first[geom.objtype] + geom.objid
        return numbers


def bodies_of(model: mujoco.MjModel) -> Indices:
    """Return the body (N,) that each object moves with; that of the world where it deforms."""
    deforming = np.zeros(model.ntendon + model.nflex + model.nskin, model.geom_bodyid.dtype)
    return np.concatenate([model.geom_bodyid, model.site_bodyid, deforming])


def drawn_objects(world: World) -> DrawnObjects:
    """Number the objects of a world."""
    model, kinds = world.model, mujoco.mjtObj
    counts = {
        kinds.mjOBJ_GEOM: model.ngeom,
        kinds.mjOBJ_SITE: model.nsite,
        kinds.mjOBJ_TENDON: model.ntendon,
        kinds.mjOBJ_FLEX: model.nflex,
        kinds.mjOBJ_SKIN: model.nskin,
    }
    ends = np.cumsum([0, *counts.values()])
    things = [thing_of(world, geom) for geom in range(model.ngeom)]
    bodies = bodies_of(model)
    for kind, count in list(counts.items())[1:]:
        label = kind.name.removeprefix("mjOBJ_").lower()
        for index in range(count):
            name = mujoco.mj_id2name(model, kind, index) or str(index)
            moves = kind != kinds.mjOBJ_SITE or _moves(model, int(bodies[len(things)]))
            things.append(Thing(f"{label}/{name}", Kind.MOVING if moves else Kind.STATIC))
    alpha = np.concatenate(
        [
            opacity(model, model.geom_matid, model.geom_rgba),
            opacity(model, model.site_matid, model.site_rgba),
            opacity(model, model.tendon_matid, model.tendon_rgba),
            opacity(model, model.flex_matid, model.flex_rgba),
            opacity(model, model.skin_matid, model.skin_rgba),
        ]
    )
    first = {int(kind): int(start) for kind, start in zip(counts, ends, strict=False)}
    deforms = np.arange(len(things)) >= model.ngeom + model.nsite
    return DrawnObjects(first, things, deforms, (alpha > 0) & (alpha < OPAQUE))


def rendering_entry(world: World) -> dict[str, Any]:
    """Return what images and labels do not show alike, for the manifest, JSON-ready.

    `reflections_off` are materials that MuJoCo would draw as mirrors; `see_through` are objects
    where only `segmentation` and `classes` hold, `deforming` those without flow.
    """
    drawn = drawn_objects(world)
    visible = _visible(world.model, len(drawn.things))

    def names(mask: Mask) -> list[str]:
        return sorted({drawn.things[k].name for k in np.flatnonzero(mask & visible)})

    return {
        "reflections_off": reflecting_materials(world.model),
        "see_through": names(drawn.see_through),
        "deforming": names(drawn.deforms),
    }


def reflecting_materials(model: mujoco.MjModel) -> list[str]:
    """Return the names of the reflecting materials of geoms that are drawn."""
    drawn = model.geom_group < COLLISION_GROUP
    used = np.unique(model.geom_matid[drawn & (model.geom_matid >= 0)])
    return [model.material(int(k)).name or str(k) for k in used if model.mat_reflectance[k] > 0]


def max_drawn(model: mujoco.MjModel) -> int:
    """Return the largest number of shapes that MuJoCo draws for the objects of a model."""
    tendons = 2 * model.nwrap + 64 * model.ntendon  # one that hangs has 31 pieces
    return model.ngeom + model.nsite + tendons + model.nflex + model.nskin


def _visible(model: mujoco.MjModel, count: int) -> Mask:
    """Return which objects are in a group that is drawn."""
    names = "geom_group", "site_group", "tendon_group", "flex_group", "skin_group"
    groups = np.concatenate([getattr(model, name) for name in names])
    assert len(groups) == count
    return groups != COLLISION_GROUP


def _moves(model: mujoco.MjModel, body: int) -> bool:
    return bool(model.body_weldid[body] != 0 or model.body_mocapid[body] >= 0)
