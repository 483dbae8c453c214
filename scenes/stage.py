"""The builder of a scene: meshes by material, collision geoms, occluders and baked light."""

from collections.abc import Callable, Generator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from scenes.geometry.mesh import Mesh, Vector, cut_into_cells, merged
from scenes.lighting.baked_light import Light, shaded_normals
from scenes.lighting.lamps import Lamplight
from scenes.lighting.shadow import Occluder, occlusion, visibility
from scenes.mjcf import add_material, add_mesh_geom, add_texture, set_view
from scenes.scene import COLLISION_GROUP, IMAGE_GROUP, LABEL_GROUP, Kind, Motion, Scene, Thing
from scenes.surfaces.atlas import Atlas, pack
from vo.contract.arrays import Array, Image

Block = AbstractContextManager[None]
Bake = Callable[[Mesh], Mesh]
"""Bakes light into the shading normals of a mesh."""
WORLD = "world"
CELL_FACES = 2000
"""Larger meshes are cut, so that the renderer culls the pieces outside the view."""


@dataclass(frozen=True)
class _Part:
    """A mesh on the stage: where it belongs and whether light is baked into its normals."""

    material: str
    thing: Thing
    body: str
    mesh: Mesh
    lit: bool


class Stage:
    """Collects a world, then writes it into an MjSpec.

    Each drawn triangle is written twice: merged by material and part of the world for images, so
    that the renderer has few surfaces and culls those behind it; and merged by object for labels.
    """

    def __init__(self, name: str) -> None:
        self.spec = mujoco.MjSpec()
        self.spec.modelname = name
        self.occluders: list[Occluder] = []
        self.things: dict[str, Thing] = {}
        self.movers: dict[str, Motion] = {}
        self.atlases: dict[str, Atlas] = {}
        self._images: dict[str, Image] = {}
        self._emission: dict[str, float] = {}
        self._parts: list[_Part] = []
        self._thing = Thing("surroundings", Kind.STATIC)
        self._body = WORLD

    def material(self, name: str, texture: Image | Atlas, emission: float = 0.0) -> None:
        """Define a matte material; emission is 0 to 1.

        The texture is (H, W, 3), an atlas, or (N, H, W, 3) variants to pack into one. Materials
        are drawn in the order of their definition; what is hidden later costs nothing.
        """
        if not isinstance(texture, Atlas) and texture.ndim == 4:
            texture = pack(texture)
        if isinstance(texture, Atlas):
            self.atlases[name] = texture
            texture = texture.image
        self._images[name] = texture
        self._emission[name] = emission

    def object(self, name: str, kind: Kind = Kind.STATIC) -> Block:
        """Make everything drawn inside the block one object; the innermost block counts."""
        return self._inside(Thing(name, kind), self._body)

    def mover(self, name: str, motion: Motion) -> Block:
        """Make everything inside the block one object that moves by itself.

        Meshes and obstacles in the block are in the object's own frame, which `motion` places in
        the world; the light on it does not change while it moves.
        """
        self.spec.worldbody.add_body(name=name, mocap=True)
        self.movers[name] = motion
        return self._inside(Thing(name, Kind.MOVING), name)

    def free_body(self, name: str, position: Vector, yaw_rad: float) -> Block:
        """Make everything inside the block one object that can be pushed and fall over.

        Meshes and obstacles in the block are in the object's own frame, which starts at (3,)
        metres; give the obstacles a mass.
        """
        self.spec.worldbody.add_body(name=name, pos=position, quat=_turn(yaw_rad)).add_freejoint()
        return self._inside(Thing(name, Kind.MOVING), name)

    @contextmanager
    def _inside(self, thing: Thing, body: str) -> Generator[None]:
        outer = self._thing, self._body
        self._thing, self._body = thing, body
        try:
            yield
        finally:
            self._thing, self._body = outer

    def draw(self, material: str, *meshes: Mesh, lit: bool = False) -> None:
        """Show meshes, each (V, 3) in metres; `finish` bakes light into those that are not lit.

        Raises:
            KeyError: If the material is not defined.
        """
        if material not in self._images:
            raise KeyError(f"no material {material}; defined: {', '.join(self._images)}")
        self._parts.extend(_Part(material, self._thing, self._body, m, lit) for m in meshes)

    def pick(self, material: str, rng: np.random.Generator) -> Array:
        """Choose a random cell of a material's atlas: (4,) u0, v0, u1, v1."""
        return self.atlases[material].pick(rng)

    def occluder(
        self, centre: Vector, size: Vector, yaw_rad: float = 0.0, opacity: float = 1.0
    ) -> None:
        """Let a box of (3,) full size cast shadow."""
        half = np.asarray(size, dtype=float) / 2
        self.occluders.append(Occluder(np.asarray(centre, dtype=float), half, yaw_rad, opacity))

    def obstacle(
        self,
        name: str,
        centre: Vector,
        size: Vector,
        yaw_rad: float = 0.0,
        shadow: bool = True,
        mass_kg: float = 0.0,
    ) -> None:
        """Add a box of (3,) full size that the rover collides with, and that casts shadow.

        Inside `mover` and `free_body` it casts none; its mass counts inside `free_body`.
        """
        half = np.asarray(size, dtype=float) / 2
        box = mujoco.mjtGeom.mjGEOM_BOX
        self.collision(name, box, pos=centre, size=half, quat=_turn(yaw_rad), mass=mass_kg)
        if shadow and self._body == WORLD:
            self.occluder(centre, size, yaw_rad)

    def collision(self, name: str, shape: mujoco.mjtGeom, **fields: Any) -> None:
        """Add a geom that only collides; `fields` are those of `MjsGeom`."""
        body = self._body_spec(self._body)
        body.add_geom(name=name, type=shape, group=COLLISION_GROUP, **fields)

    def floor(self, height_m: float) -> None:
        """Add the collision plane `ground`."""
        plane = mujoco.mjtGeom.mjGEOM_PLANE
        self.collision("ground", plane, pos=(0, 0, height_m), size=(0, 0, 1))

    def finish(
        self, light: Light | None = None, sky: Image | None = None, bake: Bake | None = None
    ) -> None:
        """Bake the light and write textures, materials, meshes, lamps and sky.

        Without light, it is an addition to a scene that has its own. The sky, where it can be seen,
        is (6 S, S, 3) faces of a cube: +x, -x, +y, -y, +z, -z as MuJoCo orders them. `bake`
        replaces the light of key and fill on the meshes of the world that carry none yet.
        """
        parts = self._gathered()
        if light is not None:
            parts = [replace(p, mesh=self._baked(p, light, bake)) for p in parts]
        for name, image in self._images.items():
            mine = [part for part in parts if part.material == name]
            if mine:
                add_material(self.spec, name, image, self._emission[name])
                self._write_images(name, mine)
        self._write_labels(parts)
        if light is not None:
            light.install(self.spec)
            set_view(self.spec)
        if sky is not None:
            add_texture(self.spec, "sky", sky, cube=True)

    def scene(
        self,
        tests: str,
        tags: str,
        light: Light,
        sky: Image | None = None,
        lamps: Lamplight | None = None,
        *,
        route: Array,
        reach_m: Vector,
        floor_m: float | None = 0.0,
    ) -> Scene:
        """Finish the stage, with a collision plane at a height, and return it as a scene.

        `tags` are separated by spaces; `route`, (N, 2) metres, is the default one; `reach_m` is
        `Scene.extent_m`, or (2,) half sizes about the origin. `lamps` replace the key lamp. The
        others are as for `finish`.
        """
        if floor_m is not None:
            self.floor(floor_m)
        self.finish(light, sky, lamps.bake if lamps else None)
        routes, tag_set = {"default": route}, frozenset(tags.split())
        world = (self.spec, routes, extent(reach_m), tag_set, self.things, self.movers)
        return Scene(self.spec.modelname, tests, *world, light=light, lamps=lamps)

    def _gathered(self) -> list[_Part]:
        """Join what has the same material, object, body and state of light."""
        alike: dict[tuple[str, Thing, str, bool], list[Mesh]] = {}
        for p in self._parts:
            alike.setdefault((p.material, p.thing, p.body, p.lit), []).append(p.mesh)
        return [
            _Part(material, thing, body, merged(meshes), lit)
            for (material, thing, body, lit), meshes in alike.items()
        ]

    def _baked(self, part: _Part, light: Light, bake: Bake | None) -> Mesh:
        mesh = part.mesh
        if part.lit:
            return mesh
        if bake is not None and part.body == WORLD:
            return bake(mesh)
        occluders = self.occluders if part.body == WORLD else []
        clear = mesh.points + 2e-3 * mesh.normals
        key = visibility(clear, occluders, light)
        fill = occlusion(clear, occluders)
        return replace(mesh, normals=shaded_normals(mesh.normals, key, fill, light))

    def _write_images(self, material: str, parts: list[_Part]) -> None:
        """Write a material's meshes for images, those of the world cut into cells."""
        for body in dict.fromkeys(part.body for part in parts):
            mesh = merged([part.mesh for part in parts if part.body == body])
            stem = "/".join(["paint", material, *([body] if body != WORLD else [])])
            self._write(stem, body, mesh, IMAGE_GROUP, material)

    def _write_labels(self, parts: list[_Part]) -> None:
        by_thing: dict[tuple[Thing, str], list[Mesh]] = {}
        for part in parts:
            by_thing.setdefault((part.thing, part.body), []).append(part.mesh)
        for (thing, body), meshes in by_thing.items():
            limb = [body] if body not in (WORLD, thing.name) else []
            stem = "/".join(["thing", thing.name, *limb])
            for name in self._write(stem, body, merged(meshes), LABEL_GROUP, ""):
                self.things[name] = thing

    def _write(self, stem: str, body: str, mesh: Mesh, group: int, material: str) -> list[str]:
        """Write a mesh in cells; returns the names of its geoms."""
        cells = {f"{stem}/{k}": c for k, c in enumerate(cut_into_cells(mesh, CELL_FACES))}
        for name, cell in cells.items():
            add_mesh_geom(self.spec, self._body_spec(body), name, cell, group, material)
        return list(cells)

    def _body_spec(self, body: str) -> mujoco.MjsBody:
        return self.spec.worldbody if body == WORLD else self.spec.body(body)


def extent(reach: Vector) -> tuple[float, float, float, float]:
    """Return x_min, y_min, x_max, y_max of `reach`: these, or (2,) half sizes about the origin."""
    x_min, y_min, x_max, y_max = reach if len(reach) == 4 else (*(-np.asarray(reach)), *reach)
    return float(x_min), float(y_min), float(x_max), float(y_max)


def _turn(yaw_rad: float) -> tuple[float, float, float, float]:
    """Return the rotation about z as quat_wxyz."""
    return (np.cos(yaw_rad / 2), 0, 0, np.sin(yaw_rad / 2))
