"""What a scene is assembled on: meshes gathered by material, boxes for the wheels, baked light."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import wraps
from typing import Concatenate, ParamSpec

import mujoco
import numpy as np

from scenes.geometry.mesh import Mesh, Vector, cut_into_cells, merged
from scenes.lighting.baked_light import Light, shaded_normals
from scenes.lighting.shadow import Blocker, occlusion, visibility
from scenes.scene import COLLISION_GROUP, IMAGE_GROUP, LABEL_GROUP, Kind, Motion, Thing
from vo.contract.arrays import Array, Image

P = ParamSpec("P")
WORLD = "world"
CELL_FACES = 2000
"""Larger meshes are cut: the renderer leaves out the pieces that are out of view."""


@dataclass(frozen=True)
class _Part:
    """A mesh on the stage: where it belongs and whether its normals carry their light already."""

    material: str
    thing: Thing
    body: str
    mesh: Mesh
    lit: bool


class Stage:
    """Collects a world, then writes it into an MjSpec.

    What is drawn is written twice: merged by material and part of the world for pictures, so that
    the renderer has few surfaces and can leave out those behind it; and merged by object for
    labels. Both have the same triangles.
    """

    def __init__(self, name: str) -> None:
        self.spec = mujoco.MjSpec()
        self.spec.modelname = name
        self.blockers: list[Blocker] = []
        self.things: dict[str, Thing] = {}
        self.movers: dict[str, Motion] = {}
        self._images: dict[str, Image] = {}
        self._glow: dict[str, float] = {}
        self._parts: list[_Part] = []
        self._thing = Thing("surroundings", Kind.STATIC)
        self._body = WORLD

    def material(self, name: str, image: Image, glow: float = 0.0) -> None:
        """Define a matte material by its (H, W, 3) texture; `glow` is light of its own, 0 to 1.

        Materials are drawn in the order of their definition; what is hidden later costs nothing.
        """
        self._images[name] = image
        self._glow[name] = glow

    @contextmanager
    def object(self, name: str, kind: Kind = Kind.STATIC) -> Generator[None]:
        """Make everything drawn inside the block one object; the innermost block counts."""
        outer, self._thing = self._thing, Thing(name, kind)
        try:
            yield
        finally:
            self._thing = outer

    @contextmanager
    def mover(self, name: str, motion: Motion) -> Generator[None]:
        """Make everything inside the block one object that moves by itself.

        Meshes and obstacles in the block are in the object's own frame, which `motion` places in
        the world; the light on it does not change while it moves.
        """
        outer = self._thing, self._body
        self.spec.worldbody.add_body(name=name, mocap=True)
        self.movers[name] = motion
        self._thing, self._body = Thing(name, Kind.MOVING), name
        try:
            yield
        finally:
            self._thing, self._body = outer

    @contextmanager
    def free_body(self, name: str, position: Vector, yaw_rad: float) -> Generator[None]:
        """Make everything inside the block one object that can be pushed and fall over.

        Meshes and obstacles in the block are in the object's own frame, which starts at (3,)
        metres; give the obstacles a mass.
        """
        outer = self._thing, self._body
        turn = (np.cos(yaw_rad / 2), 0, 0, np.sin(yaw_rad / 2))
        self.spec.worldbody.add_body(name=name, pos=position, quat=turn).add_freejoint()
        self._thing, self._body = Thing(name, Kind.MOVING), name
        try:
            yield
        finally:
            self._thing, self._body = outer

    def draw(self, material: str, *meshes: Mesh) -> None:
        """Show meshes, each (V, 3) in world metres; their light is baked in `finish`."""
        self._keep(material, meshes, lit=False)

    def draw_lit(self, material: str, *meshes: Mesh) -> None:
        """Show meshes whose normals carry their light already."""
        self._keep(material, meshes, lit=True)

    def _keep(self, material: str, meshes: tuple[Mesh, ...], lit: bool) -> None:
        if material not in self._images:
            raise KeyError(f"no material {material}; defined: {', '.join(self._images)}")
        self._parts.extend(_Part(material, self._thing, self._body, m, lit) for m in meshes)

    def blocker(
        self,
        centre: Vector,
        size: Vector,
        yaw_rad: float = 0.0,
        opacity: float = 1.0,
    ) -> None:
        """Let a box of (3,) full size cast shadow."""
        half = np.asarray(size, dtype=float) / 2
        self.blockers.append(Blocker(np.asarray(centre, dtype=float), half, yaw_rad, opacity))

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

        What moves casts none; its mass counts where it can be pushed.
        """
        self._body_spec(self._body).add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=centre,
            size=np.asarray(size, dtype=float) / 2,
            quat=(np.cos(yaw_rad / 2), 0, 0, np.sin(yaw_rad / 2)),
            group=COLLISION_GROUP,
            mass=mass_kg,
        )
        if shadow and self._body == WORLD:
            self.blocker(centre, size, yaw_rad)

    def floor(self, height_m: float) -> None:
        """Add the collision plane `ground`."""
        self.spec.worldbody.add_geom(
            name="ground",
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            pos=(0, 0, height_m),
            size=(0, 0, 1),
            group=COLLISION_GROUP,
        )

    def finish(
        self,
        light: Light | None,
        sky: Image | None,
        shine: Callable[[Mesh], Mesh] | None = None,
    ) -> None:
        """Bake the light and write textures, materials, meshes, lamps and sky.

        Args:
            light: The scene's lamps; None for an addition to a scene that has its own.
            sky: (6 S, S, 3) faces of a cube: +x, -x, +y, -y, +z, -z as MuJoCo orders them; None
                where no sky can be seen.
            shine: Bakes light of its own, instead of the key's and the fill's, into the meshes of
                the world that carry none yet.
        """
        baked = self._gathered()
        if light is not None:
            baked = [replace(p, mesh=self._bake(p, light, shine)) for p in baked]
        for name, image in self._images.items():
            mine = [part for part in baked if part.material == name]
            if mine:
                self._add_material(name, image)
                self._paint(name, mine)
        self._add_twins(baked)
        if light is not None:
            light.install(self.spec)
            _tune_view(self.spec)
        if sky is not None:
            _add_texture(self.spec, "sky", sky, mujoco.mjtTexture.mjTEXTURE_SKYBOX)

    def _gathered(self) -> list[_Part]:
        """Join what has the same material, object, body and state of light."""
        alike: dict[tuple[str, Thing, str, bool], list[Mesh]] = {}
        for p in self._parts:
            alike.setdefault((p.material, p.thing, p.body, p.lit), []).append(p.mesh)
        return [
            _Part(material, thing, body, merged(meshes), lit)
            for (material, thing, body, lit), meshes in alike.items()
        ]

    def _bake(self, part: _Part, light: Light, shine: Callable[[Mesh], Mesh] | None) -> Mesh:
        mesh = part.mesh
        if part.lit:
            return mesh
        if shine is not None and part.body == WORLD:
            return shine(mesh)
        blockers = self.blockers if part.body == WORLD else []
        clear = mesh.points + 2e-3 * mesh.normals
        key = visibility(clear, blockers, light)
        fill = occlusion(clear, blockers)
        normals = shaded_normals(mesh.normals, key, fill, light)
        return Mesh(mesh.points, normals, mesh.uv, mesh.faces)

    def _paint(self, material: str, parts: list[_Part]) -> None:
        """Write a material's meshes, those of the world cut into cells."""
        for body in dict.fromkeys(part.body for part in parts):
            mesh = merged([part.mesh for part in parts if part.body == body])
            for k, cell in enumerate(cut_into_cells(mesh, CELL_FACES)):
                name = "/".join(["paint", material, *([body] if body != WORLD else []), str(k)])
                self._add_geom(name, body, cell, IMAGE_GROUP, material)

    def _add_twins(self, parts: list[_Part]) -> None:
        """Write what each object looks like to the labels."""
        by_thing: dict[tuple[Thing, str], list[Mesh]] = {}
        for part in parts:
            by_thing.setdefault((part.thing, part.body), []).append(part.mesh)
        for (thing, body), meshes in by_thing.items():
            for k, cell in enumerate(cut_into_cells(merged(meshes), CELL_FACES)):
                limb = [body] if body not in (WORLD, thing.name) else []
                name = "/".join(["thing", thing.name, *limb, str(k)])
                self._add_geom(name, body, cell, LABEL_GROUP, None)
                self.things[name] = thing

    def _add_material(self, name: str, image: Image) -> None:
        _add_texture(self.spec, name, image, mujoco.mjtTexture.mjTEXTURE_2D)
        material = self.spec.add_material(
            name=name, specular=0.0, shininess=0.0, emission=self._glow[name]
        )
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name

    def _add_geom(self, name: str, body: str, mesh: Mesh, group: int, material: str | None) -> None:
        _add_mesh(self.spec, name, mesh)
        geom = self._body_spec(body).add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            contype=0,
            conaffinity=0,
            mass=0,
            group=group,
        )
        if material is not None:
            geom.material = material

    def _body_spec(self, body: str) -> mujoco.MjsBody:
        return self.spec.worldbody if body == WORLD else self.spec.body(body)


def one_object(
    build: Callable[Concatenate[Stage, str, P], None],
) -> Callable[Concatenate[Stage, str, P], None]:
    """Make what a function `build(stage, name, ...)` draws the object `name` of segmentation."""

    @wraps(build)
    def inside(stage: Stage, name: str, *args: P.args, **kwargs: P.kwargs) -> None:
        with stage.object(name):
            build(stage, name, *args, **kwargs)

    return inside


def _add_texture(spec: mujoco.MjSpec, name: str, image: Image, kind: mujoco.mjtTexture) -> None:
    height, width, channels = image.shape
    texture = spec.add_texture(name=name, type=kind, height=height, width=width)
    texture.nchannel = channels
    texture.data = np.ascontiguousarray(image).tobytes()


def _add_mesh(spec: mujoco.MjSpec, name: str, mesh: Mesh) -> None:
    added = spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    added.uservert = _flat(mesh.points)
    added.usernormal = _flat(mesh.normals)
    added.usertexcoord = _flat(mesh.uv)
    corners = mesh.faces.astype(np.int32).ravel()
    added.userface = added.userfacenormal = added.userfacetexcoord = corners


def _flat(values: Array) -> Array:
    return np.ascontiguousarray(values, dtype=np.float32).ravel()


def _tune_view(spec: mujoco.MjSpec) -> None:
    spec.stat.extent = 1.0  # clip distances below are then metres
    spec.visual.map.znear = 0.03
    spec.visual.map.zfar = 80.0
    spec.visual.quality.offsamples = 4
