"""Writing textures, materials and meshes into an MjSpec."""

import mujoco
import numpy as np

from scenes.geometry.mesh import Mesh
from vo.contract.arrays import Image


def add_texture(spec: mujoco.MjSpec, name: str, image: Image, cube: bool = False) -> None:
    """Add an (H, W, 3) texture, or the (6 S, S, 3) faces of a sky cube."""
    kind = mujoco.mjtTexture.mjTEXTURE_SKYBOX if cube else mujoco.mjtTexture.mjTEXTURE_2D
    height, width, channels = image.shape
    texture = spec.add_texture(name=name, type=kind, height=height, width=width)
    texture.nchannel = channels
    texture.data = np.ascontiguousarray(image).tobytes()


def add_material(spec: mujoco.MjSpec, name: str, image: Image, emission: float) -> None:
    """Add a matte material of `name` and its texture of the same name."""
    add_texture(spec, name, image)
    material = spec.add_material(name=name, specular=0.0, shininess=0.0, emission=emission)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name


def add_mesh_geom(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, mesh: Mesh, group: int, material: str
) -> None:
    """Add a mesh and a geom of `name` that shows it and does not collide; "" is no material.

    MuJoCo copies lists faster than arrays.
    """
    added = spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    added.uservert, added.usernormal, added.usertexcoord = (
        values.astype(np.float32).ravel().tolist()
        for values in (mesh.points, mesh.normals, mesh.uv)
    )
    corners = mesh.faces.ravel().tolist()
    added.userface = added.userfacenormal = added.userfacetexcoord = corners
    geom = body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, group=group)
    geom.contype = geom.conaffinity = geom.mass = 0
    if material:
        geom.material = material


def set_view(spec: mujoco.MjSpec) -> None:
    """Set the clip distances, 3 cm and 80 m, and the samples of a pixel."""
    spec.stat.extent = 1.0  # clip distances below are then metres
    spec.visual.map.znear = 0.03
    spec.visual.map.zfar = 80.0
    spec.visual.quality.offsamples = 4
