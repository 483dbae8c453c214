"""Filament draws what the labels say: corners in both eyes, light, and the same bytes again.

The proof is by geometry: plates at known places, whose outlines' centroids are known.
"""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import mujoco
import numpy as np
import pytest

from scenes.geometry.mesh import patch
from scenes.lighting.baked_light import Light, lamp, sun
from scenes.lighting.lamps import Lamplight
from scenes.lighting.shadow import Occluder
from scenes.scene import Scene
from scenes.stage import Stage
from sim.camera.filament.context import vulkan_devices
from sim.camera.filament.engine import FilamentImages, sample_grid
from sim.camera.filament.look import BRIGHTEST, lamps_of
from sim.camera.filament.sky import linear
from sim.camera.render import StereoRenderer
from sim.certificate.verify import verify
from sim.graphics import GraphicsError
from sim.imaging.linear_light import LINEAR, light_to_levels
from sim.record import record
from sim.settings import DriveSettings, RecordSettings, RenderSettings, RigSettings
from sim.world.world import World, build_world
from vo.contract import se3
from vo.contract.dataset import read_manifest
from vo.contract.errors import SettingsError

pytestmark = pytest.mark.gl
SETTINGS = RecordSettings.model_validate(
    {"rig": {"width_px": 320, "height_px": 240, "tilt_deg": 0}}
)
SHIFT_PX = 12.25, -17.5
CORNER_PX = 0.05
GREY_LEVEL = 150
PLATES = (
    # centre x, y, z (m) and turn (rad); red, green and blue in turn
    (1.0, 0.30, 0.70, 0.3), (1.0, -0.35, 0.30, 0.2), (1.5, 0.60, 0.20, 0.4),
    (1.5, -0.50, 0.80, 0.1), (2.0, 0.05, 0.50, 0.25), (2.5, 0.90, 0.55, 0.15),
)  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def _vulkan():
    pytest.importorskip("mujoco.mjrf")
    try:
        vulkan_devices()
    except GraphicsError as error:
        pytest.skip(str(error))


def plates() -> str:
    """A world whose coloured plates face the cameras' side; black elsewhere."""
    geoms = "".join(
        f'<geom type="plane" size="0.09 0.06 1" pos="{x} {y} {z}" rgba="{rgba}" contype="0" '
        f'conaffinity="0" xyaxes="0 {-np.cos(a)} {-np.sin(a)} 0 {-np.sin(a)} {np.cos(a)}"/>'
        for (x, y, z, a), rgba in zip(PLATES, ("1 0 0 1", "0 1 0 1", "0 0 1 1") * 2, strict=True)
    )
    lamp = 'type="directional" dir="1 0 0" castshadow="false" diffuse="1 1 1" specular="0 0 0"'
    return (
        '<mujoco><visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/></visual>'
        f"<worldbody><light {lamp}/>"
        f'<geom type="plane" size="0 0 1" group="3"/>{geoms}</worldbody></mujoco>'
    )


def corners(k: int) -> np.ndarray:
    x, y, z, a = PLATES[k]
    across, up = np.array([0, -np.cos(a), -np.sin(a)]), np.array([0, -np.sin(a), np.cos(a)])
    signs = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    return np.array([x, y, z]) + signs[:, :1] * 0.09 * across + signs[:, 1:] * 0.06 * up


def centroid(polygon: np.ndarray) -> np.ndarray:
    """Of the area inside (N, 2) corners."""
    following = np.roll(polygon, -1, axis=0)
    twice = polygon[:, 0] * following[:, 1] - following[:, 0] * polygon[:, 1]
    return ((polygon + following) * twice[:, None]).sum(axis=0) / (3 * twice.sum())


def errors_px(world: World, images, eye: int, shift=(0.0, 0.0)) -> list[float]:
    """Distances of the plates' centroids in the image of an eye from those of the rig."""
    rig = world.render_rig
    v, u = np.mgrid[: rig.height_px, : rig.width_px]
    found = []
    for k in range(len(PLATES)):
        points = se3.transform(se3.inverse(world.T_world_cam), corners(k))
        points[:, 0] -= eye * rig.baseline_m
        outline = rig.project(points)[:, :2] + shift
        light = images[eye].astype(float)
        low, high = np.floor(outline.min(axis=0)) - 3, np.ceil(outline.max(axis=0)) + 3
        near = (u >= low[0]) & (u <= high[0]) & (v >= low[1]) & (v <= high[1])
        assert low.min() > 0
        assert high[0] < rig.width_px
        assert high[1] < rig.height_px
        weight = light * near
        seen = np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum()
        found.append(float(np.linalg.norm(seen - centroid(outline))))
    return found


@pytest.fixture(scope="module")
def plate_world() -> World:
    return world_of_plates(SETTINGS)


def world_of_plates(settings: RecordSettings) -> World:
    spec = mujoco.MjSpec.from_string(plates())
    routes = {"default": np.array([(0.0, 0.0), (1.0, 0.0)])}
    world = build_world(Scene("plates", "", spec, routes, (-1, -1, 3, 1)), settings)
    world.place_bodies()
    return world


def filament_images(world: World, samples: int = 4):
    """Images of an instant, which are the same to the bit when they are rendered again."""
    settings = RenderSettings(engine="filament", samples=samples)
    with StereoRenderer(world, settings) as renderer:
        images = renderer.render_images()
        for first, second in zip(images, renderer.render_images(), strict=True):
            np.testing.assert_array_equal(first, second)
    return images


@pytest.fixture(scope="module")
def classic_images(plate_world):
    with StereoRenderer(plate_world, RenderSettings()) as renderer:
        return renderer.render_images()


@pytest.mark.parametrize("eye", [0, 1])
def test_classic_engine_shows_plates_where_the_rig_has_them(plate_world, classic_images, eye):
    assert max(errors_px(plate_world, classic_images, eye)) < CORNER_PX


def test_filament_shows_plates_where_the_rig_has_them(plate_world):
    images = filament_images(plate_world)
    for eye in (0, 1):
        assert max(errors_px(plate_world, images, eye)) < CORNER_PX


def test_principal_point_off_the_centre_shifts_the_image(plate_world):
    rig = plate_world.render_rig
    cx, cy = rig.cx_px + SHIFT_PX[0], rig.cy_px + SHIFT_PX[1]
    moved = replace(plate_world, render_rig=replace(rig, cx_px=cx, cy_px=cy))
    images = filament_images(moved)
    for eye in (0, 1):
        assert max(errors_px(moved, images, eye)) < CORNER_PX


def test_channels_are_red_green_blue():
    small = SETTINGS.model_copy(update={"rig": RigSettings(width_px=64, height_px=48, tilt_deg=0)})
    world = world_of_plates(small)
    with StereoRenderer(world, RenderSettings(engine="filament", samples=1), True) as renderer:
        left, _ = renderer.render_images()
    for k in range(3):
        outline = se3.transform(se3.inverse(world.T_world_cam), corners(k))
        u, v = np.rint(world.render_rig.project(outline)[:, :2].mean(axis=0)).astype(int)
        assert left[v, u].argmax() == k


FLAT = SETTINGS.model_copy(
    update={"rig": RigSettings(width_px=64, height_px=48, tilt_deg=40, rate_hz=4)}
)


def flat_scene(texture: np.ndarray, light: Light, lamps: Lamplight | None = None) -> Scene:
    """Level ground that fills the image."""
    stage = Stage("flat")
    stage.material("grey", texture)
    stage.draw("grey", patch((-4, -4, 0), (8, 0, 0), (0, 8, 0), (8, 8), (1, 1), (0, 0)))
    route = np.array([(0.0, 0.0), (1.0, 0.0)])
    return stage.scene("", "", light, lamps=lamps, route=route, reach_m=(4, 4))


def flat_world(light: Light, lamps: Lamplight | None = None) -> World:
    grey = np.full((64, 64, 3), GREY_LEVEL, np.uint8)
    world = build_world(flat_scene(grey, light, lamps), FLAT)
    world.place_bodies()
    return world


def test_level_ground_has_the_grey_level_of_the_classic_engine():
    world = flat_world(sun(np.random.default_rng(0)))
    with StereoRenderer(world, RenderSettings()) as renderer:
        classic = renderer.render_images()[0]
    levels = light_to_levels("srgb", filament_images(world, samples=1)[0])
    assert abs(np.median(levels) - np.median(classic)) < 6  # sheen of the surface


def test_lamp_lights_the_ground_by_the_square_of_its_distance():
    height_m, away = 2.0, Occluder(np.full(3, 50.0), np.full(3, 0.1))
    light = lamp((0.0, 60.0), (0.5, 0.5, 0.5), (0.1, 0.1, 0.1), (0.05, 0.05, 0.05))
    lamps = Lamplight(np.array([(0.9, 0.0, height_m)]), np.array([2.0]), [away], light)
    world = flat_world(light, lamps)
    below = se3.transform(se3.inverse(world.T_world_cam), np.array([(0.9, 0.0, 0.0)]))
    u, v = np.rint(world.render_rig.project(below)[0, :2]).astype(int)
    share = filament_images(world, samples=1)[0][v, u] / LINEAR[GREY_LEVEL]
    (_, candela), *_ = lamps_of(world, np.full(3, 1 / 3))
    expected = candela / height_m**2 / (np.pi * BRIGHTEST) + linear(np.array(0.15))
    assert share == pytest.approx(expected, rel=0.1)


def test_recording_passes_and_states_its_highlights(tmp_path):
    rng = np.random.default_rng(0)
    coarse = cv2.resize(rng.integers(60, 200, (48, 48, 3), np.uint8), (512, 512))
    changes = {"render": RenderSettings(engine="filament"), "drive": DriveSettings(distance_m=0.03)}
    scene = flat_scene(coarse, sun(rng))
    recording = record(scene, FLAT.model_copy(update=changes), tmp_path / "flat")
    assert recording.certificate["stereo"]["passed"]
    assert 0 <= recording.certificate["stereo"]["beyond_noise_fraction"] < 0.5
    assert "filament" in read_manifest(tmp_path / "flat")["software"]["gl"]
    assert verify(tmp_path / "flat") == []


def test_wide_lens_is_refused(plate_world):
    wide = replace(plate_world, lens=SimpleNamespace(views=object()))
    shown = mujoco.MjvOption()
    with pytest.raises(SettingsError, match=r"render\.engine: filament has no lens"):
        FilamentImages(wide, RenderSettings(), color=False, shown=shown)


@pytest.mark.parametrize(
    ("samples", "grid"), [(0, (1, 1)), (1, (1, 1)), (2, (1, 2)), (4, (2, 2)), (8, (2, 4))]
)
def test_samples_of_a_pixel_form_a_grid(samples, grid):
    assert sample_grid(samples) == grid


def test_without_vulkan_the_line_names_the_package(monkeypatch):
    monkeypatch.setattr("sim.camera.filament.context.VULKAN", "libabsent.so.1")
    with pytest.raises(GraphicsError, match=r"libabsent.so.1 is missing; .*mesa-vulkan-drivers"):
        vulkan_devices()
