"""Raw images of wide and distorting lenses proved by geometry, with OpenCV's projections."""

import math

import cv2
import mujoco
import numpy as np
import pytest

from scenes.scene import Scene
from sim.camera.camera import StereoCamera
from sim.camera.render import StereoRenderer
from sim.camera_settings import SensorSettings
from sim.imaging.distortion import coefficients
from sim.imaging.lens import raw_focal_px, raw_pixels
from sim.imaging.linear_light import decode
from sim.labels.annotate import Annotator
from sim.record import record
from sim.settings import DriveSettings, LabelSettings, RecordSettings, RenderSettings, RigSettings
from sim.world.trip import make_trip
from sim.world.world import World, build_world
from vo.contract import se3
from vo.contract.arrays import Array
from vo.recordings.calibration import read_cameras
from vo.recordings.images import read_codes, read_float
from vo.recordings.rectify import rectify

pytestmark = pytest.mark.gl

LENSES = {
    "fisheye": SensorSettings(lens="equidistant", fov_deg=190, k1=0.03, k2=-0.01, k3=0.002),
    "rational": SensorSettings(k1=0.3, k2=0.1, k3=0.02, k4=0.6, k5=0.15, k6=0.03, p1=0.001),
    "five": SensorSettings(k1=-0.25, k2=0.08, k3=-0.01, p2=-0.001),
}
SIZE = RigSettings(width_px=400, height_px=300, rate_hz=10, tilt_deg=-25)
SMALL = RigSettings(width_px=160, height_px=120, rate_hz=10)
LABELS = LabelSettings(raw_depth=True, raw_flow=True, raw_segmentation=True)
RADIUS_M, DISTANCE_M = 0.12, 2.0


def settings_of(lens: SensorSettings, rig: RigSettings = SIZE) -> RecordSettings:
    return RecordSettings(
        rig=rig,
        sensor=lens,
        drive=DriveSettings(distance_m=0.15),
        render=RenderSettings(shadow_size_px=0),
        labels=LABELS,
    )


def opencv_pixels(lens: SensorSettings, world: World, points_cam: Array) -> Array:
    """Project (N, 3) points by OpenCV, which has no fisheye beyond 90 degrees."""
    K, D, zero = world.rig.K.copy(), np.array(coefficients(lens)), np.zeros(3)
    K[0, 0] = K[1, 1] = raw_focal_px(lens, world.rig)
    if lens.lens == "equidistant":
        return cv2.fisheye.projectPoints(points_cam[:, None], zero, zero, K, D)[0][:, 0]
    return cv2.projectPoints(points_cam, zero, zero, K, D)[0][:, 0]


def dotted(make_scene, lens: SensorSettings) -> tuple[World, RecordSettings, Array]:
    """Bright balls around the left camera, (N, 3) in its axes."""
    settings = settings_of(lens)
    T_world_cam = build_world(make_scene(), settings).T_world_cam
    widest = 92 if lens.lens == "equidistant" else 34
    angle, around = np.meshgrid(np.radians([widest / 3, widest / 1.6, widest]), np.arange(7))
    around = 2 * math.pi * around / 7 + angle
    rays = [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)]
    points = DISTANCE_M * np.stack(rays, axis=-1).reshape(-1, 3)
    places = se3.transform(T_world_cam, points)
    points, places = points[places[:, 2] > 0.15], places[places[:, 2] > 0.15]
    scene: Scene = make_scene()
    scene.spec.add_material(name="lamp", emission=2.0, specular=0.0, rgba=(1, 1, 1, 1))
    for k, place in enumerate(places):
        ball = mujoco.mjtGeom.mjGEOM_SPHERE
        size = (RADIUS_M, 0, 0)
        scene.spec.worldbody.add_geom(
            name=f"ball_{k}", type=ball, size=size, pos=place, material="lamp", contype=0,
            conaffinity=0,
        )  # fmt: skip
    world = build_world(scene, settings)
    np.testing.assert_allclose(world.T_world_cam, T_world_cam, atol=1e-9)
    return world, settings, points


@pytest.mark.parametrize("name", LENSES)
def test_raw_images_show_points_where_opencv_projects_them(make_scene, name):
    """In both images, at the centroid of the share of each pixel that a ball covers."""
    lens = LENSES[name]
    world, settings, points = dotted(make_scene, lens)
    camera = StereoCamera(world, settings)
    balls = [world.model.geom(f"ball_{k}").id for k in range(len(points))]
    with StereoRenderer(world, settings.render) as renderer:
        shown = renderer.render_images()
        world.model.geom_rgba[balls], world.model.geom_matid[balls] = 0, -1
        hidden = renderer.render_images()
    light = [[_raw_light(camera, k, x[k]) for k in (0, 1)] for x in (shown, hidden)]
    errors: list[Array] = []
    for side, (with_balls, without) in enumerate(zip(*light, strict=True)):
        covered = np.clip((with_balls - without) / (1 - without), 0, 1)
        for centre in points - [side * world.rig.baseline_m, 0, 0]:
            outline = _outline(centre)
            pixels = raw_pixels(lens, world.rig, outline)
            if (outline[:, 2] > 0.01).all():
                np.testing.assert_allclose(pixels, opencv_pixels(lens, world, outline), atol=1e-6)
            if (error := _centroid_error(covered, pixels)) is not None:
                errors.append(error)
    assert len(errors) > 15
    assert np.abs(np.mean(errors, axis=0)).max() < 0.02
    assert np.sqrt(np.mean(np.square(errors))) < 0.04  # four samples a pixel leave 0.03


def _raw_light(camera: StereoCamera, side: int, image: Array) -> Array:
    sensor = camera.sensors[side]
    light = decode(image) if image.dtype == np.uint8 else image
    raw, pad = sensor.expose(light, 1, 1, np.random.default_rng(0)), sensor.raw_margin_px
    return decode(raw[pad:-pad, pad:-pad] if pad else raw)


def _outline(centre: Array) -> Array:
    """Points (N, 3) at which rays of the camera touch a ball."""
    distance = np.linalg.norm(centre)
    axis = centre / distance
    side = np.cross(axis, [0.3, 0.5, 0.8])
    side /= np.linalg.norm(side)
    around = np.linspace(0, 2 * math.pi, 64, endpoint=False)[:, None]
    half = math.asin(RADIUS_M / distance)
    turned = np.cos(around) * side + np.sin(around) * np.cross(axis, side)
    return math.cos(half) * axis + math.sin(half) * turned


def _centroid_error(covered: Array, outline: Array) -> Array | None:
    """Offset (2,) of a spot's centroid from that of its outline; None if the image cuts it off."""
    if np.isnan(outline).any():
        return None
    moments = cv2.moments(outline.astype(np.float32)[:, None])
    pixel = np.array([moments["m10"], moments["m01"]]) / moments["m00"]
    height, width = covered.shape
    around = 1.2 * (outline - pixel) + pixel
    if (around < 0).any() or (around > (width - 1, height - 1)).any():
        return None
    near = np.zeros(covered.shape, np.uint8)
    cv2.fillConvexPoly(near, np.rint(around).astype(np.int32), 1)
    v, u = np.nonzero(near)
    share = covered[v, u]
    return share @ np.column_stack([u, v]) / share.sum() - pixel


@pytest.fixture(scope="module", params=["fisheye", "five"])
def labelled(request, make_scene):
    """Labels of each frame, and the world placed in each."""
    settings = settings_of(LENSES[request.param], SMALL)
    world = build_world(make_scene(boxes=True), settings)
    trip = make_trip(world, settings)
    with StereoRenderer(world, settings.render) as renderer:
        captures = list(StereoCamera(world, settings).captures(trip, renderer))
    return world, settings, trip, captures, Annotator(world)


def test_raw_depth_and_objects_agree_with_ray_casts(labelled):
    world, _, trip, captures, annotator = labelled
    capture = captures[1]
    time_ns = capture.exposure.timestamp_ns
    world.place(time_ns * 1e-9, trip.states.at(world.model, time_ns))
    mujoco.mj_forward(world.model, world.data)
    labels = annotator.annotate(capture, None)
    depth, numbers = labels.raw_depth, labels._raw_numbers
    rays, rng = world.lens.grid.rays, np.random.default_rng(0)
    lit = np.argwhere(np.isfinite(rays[..., 0]))
    T, hit, same, compared = capture.T_world_cam, np.zeros(1, np.int32), 0, 0
    for v, u in rng.choice(lit, 400, replace=False):
        direction = T[:3, :3] @ rays[v, u]
        groups = np.array([1, 1, 1, 0, 1, 0], np.uint8)
        cast = mujoco.mj_ray(world.model, world.data, T[:3, 3], direction, groups, 1, -1, hit, None)
        around = numbers[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2]
        if (around != around.flat[0]).any():
            continue  # within a pixel of an outline
        if cast < 0 or cast > 15:
            assert np.isnan(depth[v, u]) or depth[v, u] > 14
            continue
        compared += 1
        same += hit[0] == numbers[v, u]
        assert depth[v, u] == pytest.approx(cast, rel=1e-3)
    assert compared > 150
    assert same == compared


def test_raw_flow_agrees_with_opencv(labelled):
    """Of static points: back-projected by their depth, and projected from a later camera."""
    world, settings, _, captures, annotator = labelled
    now, then = captures[0], captures[-1]
    labels = annotator.annotate(now, then)
    depth, flow = labels.raw_depth, labels.raw_flow
    known = np.isfinite(depth) & np.isfinite(flow).all(axis=-1)
    v, u = np.nonzero(known)
    points = world.lens.grid.rays[known] * depth[known][:, None]
    moved = se3.transform(se3.inverse(then.T_world_cam) @ now.T_world_cam, points)
    ahead = moved[:, 2] > 0.02
    is_static = annotator.kind_of[labels._raw_numbers[known]] != 3
    ahead &= is_static
    theirs = opencv_pixels(settings.sensor, world, moved[ahead])
    ours = np.column_stack([u, v])[ahead] + flow[known][ahead, :2]
    assert ahead.sum() > 5000
    assert np.abs(ours - theirs).max() < 0.01
    assert np.abs(flow[known][ahead, :2]).max() > 1
    distances = np.linalg.norm(moved[ahead], axis=1)
    np.testing.assert_allclose(flow[known][ahead, 2], distances, rtol=1e-5)


def test_recorded_lens_is_what_the_readers_rectify(make_scene, tmp_path):
    settings = settings_of(LENSES["fisheye"], SMALL)
    recording = record(make_scene(boxes=True), settings, tmp_path / "d")
    assert recording.certificate["passed"]
    root = tmp_path / "d/mav0"
    cameras = read_cameras(root / "raw0/sensor.yaml", root / "raw1/sensor.yaml")
    rig, apply, _ = rectify(*cameras)
    world = build_world(make_scene(boxes=True), settings)
    name = sorted(x.stem for x in (root / "raw0/data").iterdir())[1]
    rectified = apply(read_codes(root / f"raw0/data/{name}.png")).astype(float)
    pinhole = read_codes(root / f"cam0/data/{name}.png").astype(float)
    u, v = np.meshgrid(np.arange(10, 150.0), np.arange(10, 110.0))
    rays = np.dstack([rig.normalized(np.dstack([u, v])), np.ones(u.shape)])
    there = world.rig.project(rays).astype(np.float32)
    inside = (there[..., 0] > 4) & (there[..., 0] < 155) & (there[..., 1] > 4)
    inside &= there[..., 1] < 115
    same = cv2.remap(pinhole, there[..., 0], there[..., 1], cv2.INTER_LINEAR)
    error = np.abs(same - rectified[10:110, 10:150])[inside]
    assert inside.sum() > 500
    assert np.median(error) < 2
    depth = read_float(root / f"raw_depth0/data/{name}.tiff")
    objects = read_codes(root / f"raw_segmentation0/data/{name}.png")
    np.testing.assert_array_equal(objects == 0, np.isnan(depth))
