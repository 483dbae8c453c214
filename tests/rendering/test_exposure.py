"""Exposure: as many sub-frames as motion needs, and rows and cameras at their times."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import mujoco
import numpy as np
import pytest

from scenes.scene import Motion, Scene
from sim.camera.camera import Capture, StereoCamera
from sim.camera.exposure import Shutter, expose, open_shutter, slot_edges, slot_weights
from sim.camera.frustum import nearest_depths_m
from sim.camera.render import StereoRenderer
from sim.imaging.linear_light import Encoding, decode
from sim.settings import (
    DriveSettings,
    ExposureSettings,
    HandheldSettings,
    RecordSettings,
    RenderSettings,
    RigSettings,
    SensorSettings,
)
from sim.world.drawn import bodies_of
from sim.world.rover import BODY
from sim.world.trip import Trip, make_trip
from sim.world.world import START_S, World, build_world
from vo.contract import se3
from vo.contract.arrays import Array, Image

gl = pytest.mark.gl

WALL_M = 2.0
"""Distance from the cameras, which face it."""
RIG = RigSettings(width_px=160, height_px=120, rate_hz=10, tilt_deg=0)
F_PX = 80 / np.tan(np.radians(35))
SIDEWAYS_MPS, TURN_RADPS = 6.0, 1.5
STEP_PX = 0.5


@dataclass(frozen=True)
class Stand:
    """A world, a trip through it, and both cameras at any instant of it."""

    world: World
    trip: Trip
    settings: RecordSettings

    def captures(self) -> list[Capture]:
        camera = StereoCamera(self.world, self.settings)
        with StereoRenderer(self.world, self.settings.render) as renderer:
            return list(camera.captures(self.trip, renderer))

    def instants(self, times_s: Array) -> list[tuple[Image, Image]]:
        with StereoRenderer(self.world, self.settings.render) as renderer:
            images = []
            for time_s in times_s:
                self.world.place(time_s, self.trip.states.at(self.world.model, time_s * 1e9))
                images.append(renderer.render_images())
            return images


@pytest.fixture(scope="module")
def carry(wall_scene) -> Callable[..., Stand]:
    """Carry the rig before the wall by a motion that is known in closed form."""

    def go(motion: Motion, exposure: ExposureSettings, duration_s: float = 0.15) -> Stand:
        settings = RecordSettings(
            rig=RIG,
            drive=DriveSettings(carrier="handheld"),
            exposure=exposure,
            render=RenderSettings(samples=0, shadow_size_px=0),
        )
        world = build_world(wall_scene, settings)
        world = replace(world, movers={BODY: motion}, arrival_s=START_S + duration_s)
        return Stand(world, make_trip(world, settings), settings)

    return go


@pytest.fixture(scope="module")
def wall_scene() -> Scene:
    """A large wall at WALL_M in front of the cameras, with texture on all resolved scales."""
    rng = np.random.default_rng(1)
    image = np.full((512, 512), 128.0)
    for size in (16, 64, 128):
        coarse = rng.uniform(-1, 1, (size, size)).astype(np.float32)
        image += 30 * cv2.resize(coarse, (512, 512), interpolation=cv2.INTER_CUBIC)
    spec = mujoco.MjSpec()
    spec.visual.headlight.active = 0
    texture = spec.add_texture(
        name="print", type=mujoco.mjtTexture.mjTEXTURE_2D, width=512, height=512, nchannel=3
    )
    grey = np.clip(image, 0, 255).astype(np.uint8)
    texture.data = np.repeat(grey[..., None], 3, axis=2).tobytes()
    material = spec.add_material(
        name="print", texuniform=True, texrepeat=(0.25, 0.25), specular=0, emission=1
    )
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "print"
    rig_x_m = 0.10
    spec.worldbody.add_geom(
        name="wall",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=(WALL_M + rig_x_m, 0, 0),
        quat=(2**-0.5, 0, -(2**-0.5), 0),
        size=(20, 20, 1),
        material="print",
    )
    route = np.array([[0.0, 0.0], [1.0, 0.0]])
    return Scene("wall", "The tests.", spec, {"default": route}, (-2.0, -3.0, 6.0, 3.0))


def sideways(time_s: float) -> Array:
    """To the right at a constant speed, through the middle at the first frame."""
    return se3.pose(np.eye(3), np.array([0.0, -SIDEWAYS_MPS * (time_s - START_S), 0.05]))


def turning(time_s: float) -> Array:
    T = se3.exp(np.array([0, 0, 0, 0, 0, TURN_RADPS * (time_s - START_S)]))
    T[2, 3] = 0.05
    return T


def standing(time_s: float) -> Array:
    return se3.pose(np.eye(3), np.array([0.0, 0.0, 0.05 + 0 * time_s]))


@gl
def test_exposure_at_rest_takes_one_render(carry):
    stand = carry(standing, ExposureSettings(time_ms=50, line_time_us=100, right_offset_ms=5))
    captures = stand.captures()
    assert [c.exposure.subframes for c in captures] == [1] * len(captures)
    ((left, right),) = stand.instants(np.array([START_S]))
    np.testing.assert_array_equal(captures[0].light[0], left)
    np.testing.assert_array_equal(captures[0].light[1], right)


@gl
@pytest.mark.parametrize(("motion", "times"), [(standing, 0), (turning, 1)], ids=["rest", "turn"])
def test_depth_is_rendered_only_where_motion_needs_it(carry, motion, times):
    stand = carry(motion, ExposureSettings(time_ms=20))
    world, trip, exposure = stand.world, stand.trip, stand.settings.exposure
    shutter = open_shutter(exposure, START_S, 0.02, RIG.height_px)
    rendered = []
    with StereoRenderer(world, stand.settings.render) as renderer:

        def geometry():
            rendered.append(renderer.render_geometry())
            return rendered[-1]

        light, _ = expose(world, trip, renderer, exposure, shutter, geometry)
    assert len(rendered) == times
    np.testing.assert_array_equal(light[0], stand.captures()[0].light[0])


@gl
def test_bodies_are_no_nearer_than_their_boxes(make_scene):
    settings = RecordSettings(rig=RIG.model_copy(update={"tilt_deg": 25.0}))
    world = build_world(make_scene(), settings)
    with StereoRenderer(world, settings.render) as renderer:
        geometry = renderer.render_geometry()
    nearest_m = nearest_depths_m(world.model, world.data, world.render_rig)
    bodies = np.where(geometry.geoms_left < 0, -1, bodies_of(world.model)[geometry.geoms_left])
    for body in set(bodies.ravel().tolist()) - {-1}:
        depth_m = geometry.depth_left_m[bodies == body].min()
        assert 0.5 * depth_m < nearest_m[body] <= depth_m * (1 + 1e-5)


@gl
def test_exposure_takes_more_renders_in_motion(make_scene):
    drive = DriveSettings(distance_m=0.4, stop_every_m=0.2, stop_s=1.0)
    settings = RecordSettings(
        rig=RigSettings(width_px=160, height_px=120, rate_hz=10),
        drive=drive,
        exposure=ExposureSettings(time_ms=30, step_px=0.25),
        render=RenderSettings(samples=0, shadow_size_px=0),
    )
    world = build_world(make_scene(), settings)
    trip = make_trip(world, settings)
    stand = Stand(world, trip, settings)
    speed = np.linalg.norm(trip.v_world_body, axis=1)
    counts = np.array([capture.exposure.subframes for capture in stand.captures()])
    assert (speed < 1e-3).sum() > 5
    assert (counts[speed < 1e-3] == 1).all()
    assert (counts[speed > 0.1] > 1).all()


@gl
@pytest.mark.parametrize("step_px", [0.25, 0.5, 1.0])
@pytest.mark.parametrize("motion", [sideways, turning], ids=["sideways", "turning"])
def test_subframe_motion_is_at_most_a_step(carry, motion, step_px):
    exposure = ExposureSettings(time_ms=20, step_px=step_px, subframes_max=512)
    stand = carry(motion, exposure)
    count = stand.captures()[0].exposure.subframes
    moved_px = {"sideways": F_PX * SIDEWAYS_MPS / WALL_M, "turning": F_PX * TURN_RADPS}
    slowest = moved_px[motion.__name__] * 0.020  # in the middle of the picture
    fastest = slowest * (1.0 if motion is sideways else 1 + np.tan(np.radians(35)) ** 2)
    assert fastest / count <= step_px * 1.03
    assert fastest / count > step_px * 0.8


@gl
def test_subframes_are_limited(carry):
    exposure = ExposureSettings(time_ms=20, subframes_max=3)
    assert carry(turning, exposure).captures()[0].exposure.subframes == 3


@gl
def test_instant_exposure_takes_one_render(carry):
    captures = carry(turning, ExposureSettings()).captures()
    assert [c.exposure.subframes for c in captures] == [1] * len(captures)


@gl
def test_adaptive_blur_agrees_with_many_subframes(carry):
    stand = carry(turning, ExposureSettings(time_ms=40, step_px=STEP_PX))
    capture = stand.captures()[0]
    assert 10 < capture.exposure.subframes < 40
    times = START_S + (np.arange(64) - 31.5) / 64 * 0.040
    many = stand.instants(times)
    for side in (0, 1):
        reference = np.mean([decode(images[side]) for images in many], axis=0)
        encode = Encoding("srgb")
        blurred, wanted = encode(capture.light[side]), encode(reference.astype(np.float32))
        assert _psnr(blurred, wanted) > 55  # half a slot late it would be 50
        ((*sharp,),) = stand.instants(np.array([START_S]))
        assert _psnr(sharp[side], wanted) < 35


@gl
def test_rolling_shutter_shears_sideways_motion(carry):
    line_us = 100.0
    exposure = ExposureSettings(line_time_us=line_us, step_px=0.1, subframes_max=512)
    stand = carry(sideways, exposure)
    capture = stand.captures()[0]
    ((instant, _),) = stand.instants(np.array([START_S]))
    late_s = (np.arange(120) - 59.5) * line_us * 1e-6
    shear_px = F_PX * SIDEWAYS_MPS * late_s / WALL_M
    assert np.ptp(shear_px) > 4
    rolled = Encoding("srgb")(capture.light[0])

    def residual(factor: float) -> float:
        u, v = np.meshgrid(np.arange(160.0), np.arange(120.0))
        places = (u + factor * shear_px[:, None]).astype(np.float32), v.astype(np.float32)
        predicted = cv2.remap(instant.astype(np.float32), *places, cv2.INTER_CUBIC)
        return float(np.abs(predicted - rolled)[:, 8:-8].mean())

    assert residual(1.0) < 1.0
    assert min(residual(0.9), residual(1.1)) > 1.3 * residual(1.0)
    assert residual(-1.0) > 5 * residual(1.0)


@gl
def test_right_offset_shows_the_later_right_image(carry):
    offset_s = 0.008
    exposure = ExposureSettings(right_offset_ms=offset_s * 1e3)
    stand = carry(sideways, exposure)
    capture = stand.captures()[0]
    (now, then) = stand.instants(np.array([START_S, START_S + offset_s]))
    left, right = capture.light
    np.testing.assert_array_equal(left, now[0])
    np.testing.assert_array_equal(right, then[1])
    assert _psnr(right, now[1]) < 30
    moved_px = F_PX * SIDEWAYS_MPS * offset_s / WALL_M
    u, v = np.meshgrid(np.arange(160.0), np.arange(120.0))
    places = (u + moved_px).astype(np.float32), v.astype(np.float32)
    predicted = cv2.remap(now[1].astype(np.float32), *places, cv2.INTER_CUBIC)
    assert np.abs(predicted - right)[:, 8:-8].mean() < 1.0


def test_slot_weights_of_each_row_sum_to_one():
    rng = np.random.default_rng(0)
    for time_ms, line_us, offset_ms in [(0, 50, 3), (10, 0, 0), (10, 50, -4), (0, 0, 5), (3, 1, 0)]:
        settings = ExposureSettings(
            time_ms=time_ms, line_time_us=line_us, right_offset_ms=offset_ms
        )
        shutter = open_shutter(settings, 1.0, time_ms * 1e-3, 97)
        for slots in rng.integers(2, 40, 3):
            portions = slot_weights(
                shutter, np.linspace(shutter.start_s.min(), shutter.end_s.max(), slots + 1)
            )
            assert portions.shape == (2, 97, slots)
            assert portions.min() >= 0
            np.testing.assert_allclose(portions.sum(axis=-1), 1, atol=1e-6)


def test_slot_weights_follow_the_open_rows():
    """Two rows, the second 2 ms later; the right camera 4 ms later; each open for 2 ms."""
    start_s = np.array([[0.0, 2.0], [4.0, 6.0]])
    portions = slot_weights(Shutter(start_s, start_s + 2.0), np.linspace(0, 8, 9))
    np.testing.assert_allclose(portions[0, 0], [0.5, 0.5, 0, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(portions[0, 1], [0, 0, 0.5, 0.5, 0, 0, 0, 0])
    np.testing.assert_allclose(portions[1, 0], [0, 0, 0, 0, 0.5, 0.5, 0, 0])
    np.testing.assert_allclose(portions[1, 1], [0, 0, 0, 0, 0, 0, 0.5, 0.5])
    halves = slot_weights(Shutter(start_s, start_s + 2.0), np.linspace(-1, 9, 6))
    np.testing.assert_allclose(halves[0, 0], [0.5, 0.5, 0, 0, 0])


def test_middle_row_of_left_camera_is_at_the_timestamp():
    settings = ExposureSettings(line_time_us=100, right_offset_ms=3)
    shutter = open_shutter(settings, 2.0, 0.010, 101)
    middle = (shutter.start_s + shutter.end_s) / 2
    assert middle[0, 50] == pytest.approx(2.0)
    assert middle[1, 50] == pytest.approx(2.003)
    np.testing.assert_allclose(np.diff(middle), 1e-4)
    np.testing.assert_allclose(shutter.end_s - shutter.start_s, 0.010)


@gl
def test_flicker_gives_bands_with_rolling_shutter(wall_scene):
    """Mains light at 100 Hz, exposures of 2 ms."""

    def mains(time_s: Array) -> Array:
        return 1 + 0.5 * np.sin(2 * np.pi * 100 * np.asarray(time_s))

    settings = RecordSettings(
        rig=RIG.model_copy(update={"rate_hz": 30}),
        drive=DriveSettings(carrier="handheld", distance_m=0.4),
        handheld=HandheldSettings(sway_m=0, sway_deg=0, tremor_m=0, tremor_deg=0),
        render=RenderSettings(samples=0, shadow_size_px=0),
    )
    spread = {}
    for name, line_us in (("rolling", 166.7), ("global", 0.0)):
        exposure = ExposureSettings(time_ms=2, line_time_us=line_us)
        chosen = settings.model_copy(update={"exposure": exposure})
        world = build_world(replace(wall_scene, brightness=mains), chosen)
        captures = Stand(world, make_trip(world, chosen), chosen).captures()
        rows = np.array([capture.brightness for capture in captures])
        spread[name] = np.ptp(rows, axis=1).max(), np.ptp(rows.mean(axis=1))
        assert rows.mean() == pytest.approx(1, abs=0.15)
    attenuated = 2 * 0.5 * np.sin(np.pi * 0.2) / (np.pi * 0.2)
    assert spread["rolling"][0] == pytest.approx(attenuated, rel=0.02)
    assert spread["global"][0] == 0
    assert 0.3 < spread["global"][1] <= attenuated + 1e-6


@gl
def test_auto_exposure_darkens_bright_images(wall_scene):
    sensor = SensorSettings(auto_exposure=True, target_grey=60, delay_frames=1)
    settings = RecordSettings(
        rig=RIG,
        drive=DriveSettings(carrier="handheld", distance_m=0.3),
        sensor=sensor,
        render=RenderSettings(samples=0, shadow_size_px=0),
    )
    world = build_world(wall_scene, settings)
    trip = make_trip(world, settings)
    captures = Stand(world, trip, settings).captures()
    camera = StereoCamera(world, settings)
    means = [camera.form_images(capture).rectified[0].mean() for capture in captures]
    assert means[0] > 90
    assert means[-1] == pytest.approx(60, abs=4)
    assert captures[0].exposure.exposure_ms == pytest.approx(10)
    assert captures[-1].exposure.exposure_ms < 6
    assert captures[-1].exposure.gain == 1


def _psnr(image: Image, reference: Image) -> float:
    error = image.astype(float) - reference
    return float(10 * np.log10(255**2 / np.maximum((error**2).mean(), 1e-12)))


@pytest.mark.parametrize(("time_ms", "steps"), [(0, 0.4), (0, 3.2), (2, 1.5), (30, 40)])
def test_slots_hold_the_time_of_each_row(time_ms, steps):
    """The mean time of a row's sub-frames is the middle of its exposure, also where few are."""
    settings = ExposureSettings(time_ms=time_ms, line_time_us=100)
    shutter = open_shutter(settings, 1.0, time_ms * 1e-3, 97)
    edges = slot_edges(shutter, steps, 96)
    middle_s = slot_weights(shutter, edges)[0] @ (edges[1:] + edges[:-1]) / 2
    of_rows_s = (shutter.start_s + shutter.end_s)[0] / 2
    np.testing.assert_allclose(middle_s, of_rows_s, atol=0.02 * np.ptp(of_rows_s) + 1e-5)
