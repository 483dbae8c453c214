"""What a scene is assembled on: meshes gathered by material, boxes for the wheels, baked light."""

import mujoco
import numpy as np

from scenes.light import Light, shaded_normals
from scenes.mesh import Mesh, Vector, merged
from scenes.shadow import Blocker, occlusion, visibility
from vo.contract.arrays import Array, Image

HIDDEN_GROUP = 3  # the renderer draws groups 0 to 2: what collides and what is seen are apart


class Stage:
    """Collects a world, then writes it into an MjSpec: one drawn geom for each material."""

    def __init__(self, name: str) -> None:
        self.spec = mujoco.MjSpec()
        self.spec.modelname = name
        self.blockers: list[Blocker] = []
        self._images: dict[str, Image] = {}
        self._glow: dict[str, float] = {}
        self._raw: dict[str, list[Mesh]] = {}
        self._lit: dict[str, list[Mesh]] = {}

    def material(self, name: str, image: Image, glow: float = 0.0) -> None:
        """Define a matte material by its (H, W, 3) texture; `glow` is light of its own, 0 to 1.

        Materials are drawn in the order of their definition; what is hidden later costs nothing.
        """
        self._images[name] = image
        self._glow[name] = glow
        self._raw[name] = []
        self._lit[name] = []

    def draw(self, material: str, *meshes: Mesh) -> None:
        """Show meshes, each (V, 3) in world metres; their light is baked in `finish`."""
        self._raw[material].extend(meshes)

    def draw_lit(self, material: str, *meshes: Mesh) -> None:
        """Show meshes whose normals carry their light already."""
        self._lit[material].extend(meshes)

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
    ) -> None:
        """Add a box of (3,) full size that the rover collides with, and that casts shadow."""
        self.spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=centre,
            size=np.asarray(size, dtype=float) / 2,
            quat=(np.cos(yaw_rad / 2), 0, 0, np.sin(yaw_rad / 2)),
            group=HIDDEN_GROUP,
        )
        if shadow:
            self.blocker(centre, size, yaw_rad)

    def floor(self, height_m: float) -> None:
        """Add the collision plane `ground`."""
        self.spec.worldbody.add_geom(
            name="ground",
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            pos=(0, 0, height_m),
            size=(0, 0, 1),
            group=HIDDEN_GROUP,
        )

    def finish(self, light: Light, sky: Image) -> None:
        """Bake the light and write textures, materials, meshes, lamps and sky.

        Args:
            light: The scene's lamps.
            sky: (6 S, S, 3) faces of a cube: +x, -x, +y, -y, +z, -z as MuJoCo orders them.
        """
        for name, image in self._images.items():
            meshes = [self._bake(mesh, light) for mesh in self._raw[name]] + self._lit[name]
            if meshes:
                self._write(name, image, merged(meshes))
        light.install(self.spec)
        _add_texture(self.spec, "sky", sky, mujoco.mjtTexture.mjTEXTURE_SKYBOX)
        _tune_view(self.spec)

    def _bake(self, mesh: Mesh, light: Light) -> Mesh:
        clear = mesh.points + 2e-3 * mesh.normals
        key = visibility(clear, self.blockers, light)
        fill = occlusion(clear, self.blockers)
        normals = shaded_normals(mesh.normals, key, fill, light)
        return Mesh(mesh.points, normals, mesh.uv, mesh.faces)

    def _write(self, name: str, image: Image, mesh: Mesh) -> None:
        _add_texture(self.spec, name, image, mujoco.mjtTexture.mjTEXTURE_2D)
        material = self.spec.add_material(
            name=name, specular=0.0, shininess=0.0, emission=self._glow[name]
        )
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        _add_mesh(self.spec, name, mesh)
        self.spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            material=name,
            contype=0,
            conaffinity=0,
            group=0,
        )


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
