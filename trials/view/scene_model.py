"""The world of a dataset, rebuilt from its manifest, as triangles."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.scene import Motion
from sim.batch import build
from sim.settings import recorded_settings
from sim.world.fingerprint import changes_since
from sim.world.rover import BODY
from sim.world.world import World, build_world
from trials.view.meshes import Mesh, drawn_geoms, geom_meshes
from vo.contract import se3
from vo.contract.dataset import MANIFEST, read_manifest
from vo.contract.errors import DriftyardError
from vo.contract.remarks import remark


@dataclass(frozen=True)
class SceneModel:
    """Triangles of a scene.

    Attributes:
        static: What does not move by itself, in the world.
        carrier: The rover, in its body frame; empty if the carrier is a hand.
        movers: Name of what moves by itself to its triangles, in its own frame, and its motion.
    """

    static: Sequence[Mesh]
    carrier: Sequence[Mesh]
    movers: Mapping[str, tuple[Sequence[Mesh], Motion]]


def read_scene_model(dataset: Path) -> SceneModel | None:
    """Rebuild the scene of a dataset folder; None of a recording of other origin.

    A scene that has changed since is shown with a remark, one that cannot be built is left out
    with a remark.
    """
    if not (dataset / MANIFEST).is_file():
        return None
    try:
        manifest = read_manifest(dataset)
        settings = recorded_settings(manifest["settings"])
        world = build_world(build(manifest["scene"]["source"], settings), settings)
        problem = changes_since(manifest["world"], world) if "world" in manifest else ""
    except (DriftyardError, KeyError, TypeError, AttributeError) as error:
        reason = " ".join(str(error).split())
        remark(f"{dataset}: shown without its scene, which cannot be built ({reason})")
        return None
    if problem:
        remark(f"{dataset}: the scene that is shown may differ from the recorded one: {problem}")
    return scene_model(world)


def scene_model(world: World) -> SceneModel:
    """Return the triangles of a world."""
    model, data = world.model, world.data
    geoms = drawn_geoms(model)
    bodies = model.geom_bodyid[geoms]
    is_carrier = model.body_rootid[bodies] == model.body(BODY).rootid[0]
    is_static = ~is_carrier
    movers: dict[str, tuple[Sequence[Mesh], Motion]] = {}
    for name in world.movers.keys() - {BODY}:
        row = world.body_row(name)
        own = (model.body_rootid[bodies] == row) & ~is_carrier
        T_mover_world = se3.inverse(world.T_world_bodies[row])
        movers[name] = geom_meshes(model, data, geoms[own], T_mover_world), world.movers[name]
        is_static &= ~own
    carrier = geom_meshes(model, data, geoms[is_carrier], se3.inverse(world.T_world_body))
    return SceneModel(geom_meshes(model, data, geoms[is_static], np.eye(4)), carrier, movers)
