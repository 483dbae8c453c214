"""Bodies of the dynamic agents: loads of cartons, lifting doors and carts."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from scenes.geometry.mesh import Mesh, box, merged
from scenes.scene import Scene
from scenes.stage import Stage
from scenes.surfaces import prints, signs, timber
from scenes.surfaces.atlas import pack
from trials.gym.world.dynamic_agents import Barrier, Cart, DynamicAgent, Load
from vo.contract.arrays import Array

PREFIX = "dynamics/"
LOAD_M, DOOR_M = (0.8, 0.9), (0.1, 1.0)
"""Depth along the passage and height of a load and of a door, metres."""
CART_M = (0.6, 0.5, 0.7)
"""Length, width and height, metres."""
FACES = 6
"""Number of different sides of cartons."""


def with_agents(scene: Scene, agents: Mapping[str, DynamicAgent], seed: int) -> Scene:
    """Add dynamic agents by name to a copy of a scene; the seed decides their textures."""
    if not agents:
        return scene
    stage, rng = Stage("dynamics"), np.random.default_rng(seed)
    faces = pack(prints.cartons(rng, FACES, 256))
    stage.material("hoisted_cartons", faces.image)
    stage.material("lifting_door", signs.shutter(rng, (512, 512), (150, 120, 70)))
    stage.material("cart_frame", timber.painted(rng, (128, 256), (54, 92, 140)))
    for name, agent in agents.items():
        with stage.mover(name, agent):
            if isinstance(agent, Cart):
                size = CART_M
                stage.draw("cart_frame", box((0, 0, 0.1), (*CART_M[:2], 0.2), (0.5, 0.5)))
                load = box((0, 0, 0.45), (0.54, 0.44, 0.5), bottom=True)
                stage.draw("hoisted_cartons", load.textured(faces.rects[rng.integers(FACES)]))
            else:
                assert isinstance(agent, Barrier)
                depth_m, width_m = 2 * agent.slot.half
                height_m = LOAD_M[1] if isinstance(agent, Load) else DOOR_M[1]
                size = (float(depth_m), float(width_m), height_m)
                if isinstance(agent, Load):
                    stage.draw("hoisted_cartons", _stack(size, faces.rects, rng))
                else:
                    leaf = box((0, 0, size[2] / 2), size, (1.0, 1.0), rng.random(2), bottom=True)
                    stage.draw("lifting_door", leaf)
            stage.obstacle(f"{name}/hull", (0, 0, size[2] / 2), size)
    stage.finish(None, None)
    spec = scene.spec.copy()
    spec.attach(stage.spec, prefix=PREFIX, frame=spec.worldbody.add_frame())
    things = {PREFIX + name: thing for name, thing in stage.things.items()}
    named = {PREFIX + name: agent for name, agent in agents.items()}
    return replace(
        scene, spec=spec, things={**scene.things, **things}, movers={**scene.movers, **named}
    )


def _stack(size: tuple[float, float, float], rects: Array, rng: np.random.Generator) -> Mesh:
    """Cartons side by side, two high, that fill a box of full size (3,) on z = 0."""
    depth_m, width_m, height_m = size
    count = max(1, round(width_m / 0.6))
    part = np.array([depth_m, width_m / count, height_m / 2])
    return merged(
        [
            box((0, (k + 0.5) * part[1] - width_m / 2, (z + 0.5) * part[2]), part, bottom=True)
            .textured(rects[rng.integers(len(rects))])
            for k in range(count)
            for z in (0, 1)
        ]
    )  # fmt: skip
