"""What a world looks like to Filament: one channel of its colours, true normals, light in lux."""

from copy import copy

import mujoco
import numpy as np

from scenes.surfaces.finish import finish_of
from sim.camera.filament.sky import linear, sky_radiance, sun_irradiance
from sim.settings import RenderSettings
from sim.world.world import World
from vo.contract.arrays import Array, Image

BRIGHTEST = 38400.0
"""Luminance of the brightest grey level, cd/m²: Filament's camera is at f/16, 1/125 s, ISO 100."""
CREASE_DEG = 70.0
SAME_PLACE_M = 1e-5
HEADLIGHT_LUX = 40000.0
"""MuJoCo's default of `filament.fallback.head_light_intensity`."""
EMISSION = 0.3
"""Light of a white surface of MuJoCo's emission 1 in Filament."""
LAMP_SHARE = 0.6
"""Light of lamps over their baked one, whose pools are dimmed where they are brightest."""
KEY = "key"
"""The lamp of `scenes.lighting.baked_light.Light`."""
OPTIONS = """
<mujoco>
  <custom>
    <numeric name="filament.ao.enabled" data="0"/>
    <numeric name="filament.shadows.map_size" data="{shadow}"/>
  </custom>
</mujoco>
"""


def options(settings: RenderSettings) -> mujoco.MjModel:
    """Return an empty model that carries Filament's options."""
    return mujoco.MjModel.from_xml_string(OPTIONS.format(shadow=settings.shadow_size_px or 16))


def channel_model(world: World, settings: RenderSettings, weights: Array) -> mujoco.MjModel:
    """Copy a world's model with the (3,) weighted mean of red, green and blue in all three.

    In a built-in scene, baked light gives way to true normals and to lamps with intensities.
    """
    model = copy(world.model)
    model.vis.quality.shadowsize = settings.shadow_size_px
    for texture in range(model.ntex):
        texels = _texels(model, texture)
        if model.tex_nchannel[texture] >= 3:
            texels[..., :3] = np.rint(texels[..., :3] @ weights)[..., None]
    for kind in ("mat", "geom", "site", "skin", "tendon", "flex"):
        rgba = getattr(model, f"{kind}_rgba")
        rgba[..., :3] = (rgba[..., :3] @ weights)[..., None]
    light = world.scene.light
    if light is None:
        model.light_diffuse[:] = (model.light_diffuse @ weights)[:, None]
        return model
    model.tex_colorspace[:] = mujoco.mjtColorSpace.mjCOLORSPACE_SRGB
    model.mesh_normal[:] = true_normals(model)
    finishes = [finish_of(model.material(k).name) for k in range(model.nmat)]
    model.mat_roughness[:] = [x.roughness for x in finishes]
    model.mat_metallic[:] = [x.metallic for x in finishes]
    glow, colour = mujoco.mjtTextureRole.mjTEXROLE_EMISSIVE, mujoco.mjtTextureRole.mjTEXROLE_RGB
    model.mat_texid[:, glow] = np.where(model.mat_emission > 0, model.mat_texid[:, colour], -1)
    model.mat_emission[:] = linear(model.mat_emission) / EMISSION
    key = model.light(KEY).id
    model.light_diffuse[:] = 1
    sun = float(sun_irradiance(light) @ weights) if world.scene.lamps is None else 1e-6
    model.light_intensity[key] = np.pi * BRIGHTEST * sun
    model.light_castshadow[key] = world.scene.lamps is None
    return model


def lamps_of(world: World, weights: Array) -> list[tuple[Array, float]]:
    """Return place (3,) and one channel of the intensity, candela, of each lamp inside a scene."""
    lamps = world.scene.lamps
    if lamps is None:
        return []
    each = np.pi * BRIGHTEST * LAMP_SHARE * float(sun_irradiance(lamps.light) @ weights)
    return [(x, each * float(y)) for x, y in zip(lamps.places, lamps.powers, strict=True)]


def headlight_of(world: World, weights: Array) -> float:
    """Return one channel of the light from the camera of a user's world, lux.

    It shines, as in MuJoCo's viewer, unless the world has lamps with intensities.
    """
    model, head = world.model, world.model.vis.headlight
    if world.scene.light is not None or not head.active or (model.light_intensity > 0).any():
        return 0.0
    return HEADLIGHT_LUX * float(head.diffuse @ weights)


def sky_of(world: World, weights: Array) -> Array | None:
    """Return one channel of the sky light of a built-in scene, (6, S, S, 3); else None."""
    light, model = world.scene.light, world.model
    if light is None:
        return None
    skies = np.flatnonzero(model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    image: Image | None = _texels(model, int(skies[0]))[..., :3] if len(skies) else None
    cube = sky_radiance(light, image)
    return np.repeat((cube @ weights)[..., None], 3, axis=-1)


def true_normals(model: mujoco.MjModel) -> Array:
    """Compute the normals (N, 3) of a model's meshes from their faces.

    A normal is the mean by area over the faces at its place that do not turn away by more than
    CREASE_DEG from its own face: what was round is round, edges are edges.
    """
    vertex = model.mesh_face + np.repeat(model.mesh_vertadr, model.mesh_facenum)[:, None]
    normal = model.mesh_facenormal + np.repeat(model.mesh_normaladr, model.mesh_facenum)[:, None]
    a, b, c = np.moveaxis(model.mesh_vert[vertex].astype(float), 1, 0)
    across = np.cross(b - a, c - a)  # length twice the area
    unit = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    mesh = np.repeat(np.arange(model.nmesh), model.mesh_facenum).repeat(3)
    places = np.column_stack([mesh, np.rint(model.mesh_vert[vertex.ravel()] / SAME_PLACE_M)])
    order = np.lexsort(places.T)
    group = np.cumsum((np.diff(places[order], axis=0, prepend=places[order][:1]) != 0).any(axis=1))
    face, smooth = order // 3, across[order // 3].copy()
    shift = 1
    while True:
        pairs = np.flatnonzero(group[shift:] == group[:-shift])
        if not len(pairs):
            break
        first, second = face[pairs], face[pairs + shift]
        near = np.einsum("ni,ni->n", unit[first], unit[second]) > np.cos(np.radians(CREASE_DEG))
        smooth[pairs[near]] += across[second[near]]
        smooth[pairs[near] + shift] += across[first[near]]
        shift += 1
    normals = np.zeros(model.mesh_normal.shape)
    np.add.at(normals, normal.ravel()[order], smooth)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 0, normals / np.maximum(length, 1e-12), model.mesh_normal)


def _texels(model: mujoco.MjModel, texture: int) -> Image:
    """Return the (H, W, C) texels of a texture; writing changes the model."""
    height, width, channels = (
        int(x[texture]) for x in (model.tex_height, model.tex_width, model.tex_nchannel)
    )
    first = int(model.tex_adr[texture])
    size = height * width * channels
    return model.tex_data[first : first + size].reshape(height, width, channels)
