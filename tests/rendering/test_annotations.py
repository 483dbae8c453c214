"""Labels through the real renderer: asked for and written, true of what moves, and consistent."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
import yaml

from scenes.scene import Kind
from sim.camera.camera import Capture, StereoCamera
from sim.camera.render import NO_GEOM, StereoRenderer
from sim.certificate.verify import verify
from sim.labels.annotate import FORWARD, Annotator
from sim.labels.formats import LABELS
from sim.labels.labels import HIDDEN, NOTHING, OUTSIDE, VISIBLE
from sim.record import record
from sim.settings import (
    DriveSettings,
    ExposureSettings,
    LabelSettings,
    RecordSettings,
    RenderSettings,
    RigSettings,
    RoverSettings,
    TerrainSettings,
)
from sim.world.trip import make_trip
from sim.world.world import World, build_world
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.dataset import read_manifest
from vo.recordings.images import read_codes, read_float

pytestmark = pytest.mark.gl

BESIDE = (lambda x: np.floor(x).astype(int), lambda x: np.ceil(x).astype(int))
NONE = LabelSettings(depth=False, disparity=False)
ALL = LabelSettings(**dict.fromkeys(LABELS, True))
SMALL = RecordSettings(
    rig=RigSettings(width_px=160, height_px=120, rate_hz=10),
    drive=DriveSettings(distance_m=0.15),
    render=RenderSettings(samples=0, shadow_size_px=256),
    labels=ALL,
)


def passing(time_s: float) -> Array:
    """Across the view, turning, at the height of a box that stands on the ground."""
    T = se3.exp(np.array([0, 0, 0, 0, 0, 0.8 * (time_s - 1)]))
    T[:3, 3] = [1.1, -0.25 + 0.3 * (time_s - 1), 0.11]
    return T


@pytest.fixture(scope="module")
def dataset(make_scene, tmp_path_factory):
    out = tmp_path_factory.mktemp("annotations") / "all"
    record(make_scene(boxes=True, mover=passing), SMALL, out)
    return out


@pytest.fixture(scope="module")
def scenery(make_scene) -> tuple[World, list[Capture], Annotator]:
    """The same drive, frame by frame."""
    return _captures(make_scene(boxes=True, mover=passing), SMALL)


def test_labels_requested_are_written_for_each_frame(dataset):
    frames = read_manifest(dataset)["frames"]
    images = sorted(path.stem for path in (dataset / "mav0/cam0/data").iterdir())
    for name, form in LABELS.items():
        folder = dataset / "mav0" / form.folder
        expected = images[:-1] if name in FORWARD else images
        assert sorted(path.stem for path in (folder / "data").iterdir()) == expected
        rows = (folder / "data.csv").read_text().splitlines()[1:]
        assert rows == [f"{stem},{stem}{form.suffix}" for stem in expected]
        sheet = yaml.safe_load((folder / "sensor.yaml").read_text().removeprefix("%YAML:1.0\n"))
        assert sheet["unit"] == form.unit
    assert len(images) == frames > 5
    assert {"flow", "covisibility", "raw_flow"} == FORWARD


@pytest.mark.parametrize("name", [None, *LABELS])
def test_labels_not_requested_are_not_written(make_scene, tmp_path, name):
    labels = NONE.model_copy(update={name: True} if name else {})
    tiny = SMALL.rig.model_copy(update={"width_px": 48, "height_px": 32})
    settings = SMALL.model_copy(update={"labels": labels, "rig": tiny})
    record(make_scene(), settings, tmp_path / "d")
    written = {path.name for path in (tmp_path / "d/mav0").iterdir()}
    assert {"cam0", "cam1", "imu0", "wheels0", "state_groundtruth_estimate0"} < written
    labelled = written & {form.folder for form in LABELS.values()}
    assert labelled == ({LABELS[name].folder} if name else set())


def test_it_certifies_and_verifies_itself(dataset):
    certificate = read_manifest(dataset)["certificate"]
    assert certificate["passed"]
    for part in ("stereo", "flow"):
        assert 0 < certificate[part]["median_grey"] < 1
        assert certificate[part]["shifted_median_grey"] > 2 * certificate[part]["median_grey"]
    assert certificate["geometry"]["flow_px"] < 1e-3
    assert verify(dataset) == []


def test_segmentation_shows_only_things_of_the_manifest(dataset):
    things = {thing["id"]: thing for thing in read_manifest(dataset)["things"]}
    assert sorted(things) == list(range(1, len(things) + 1))
    assert len({thing["name"] for thing in things.values()}) == len(things)
    codes = {"ground": 1, "static": 2, "moving": 3}
    seen = set()
    for path in sorted((dataset / "mav0/segmentation0/data").iterdir()):
        objects = read_codes(path)
        assert objects.dtype == np.uint16
        classes = read_codes(dataset / "mav0/classes0/data" / path.name)
        for number in np.unique(objects):
            of_object = np.unique(classes[objects == number])
            expected = codes[things[int(number)]["class"]] if number else 0
            assert of_object.tolist() == [expected]
        seen |= {things[int(k)]["name"] for k in np.unique(objects) if k}
        depth = read_float(dataset / "mav0/depth0/data" / path.with_suffix(".tiff").name)
        np.testing.assert_array_equal(objects == 0, np.isnan(depth))
    assert {"ground", "mover", "box_0", "box_1"} <= seen
    assert "rover" not in seen


def test_classes_of_ground_boxes_and_mover(dataset):
    things = {thing["name"]: thing["class"] for thing in read_manifest(dataset)["things"]}
    assert things["ground"] == "ground"
    assert things["mover"] == "moving"
    assert {things[f"box_{k}"] for k in range(5)} == {"static"}


def test_flow_on_a_mover_follows_its_motion(scenery):
    """Against the mover's motion in closed form, its points found by back-projection."""
    world, captures, annotator = scenery
    rig = world.rig
    mover = world.model.geom("mover").id
    compared = 0
    for now, then in pairwise(captures):
        v, u = np.nonzero(now.geometry.geoms_left == mover)
        depth = now.geometry.depth_left_m[v, u].astype(float)
        rays = np.column_stack([rig.normalized(np.column_stack([u, v])), np.ones(len(u))])
        points_world = se3.transform(now.T_world_cam, depth[:, None] * rays)
        T_then_now = passing(then.exposure.timestamp_ns * 1e-9) @ se3.inverse(
            passing(now.exposure.timestamp_ns * 1e-9)
        )
        points_then = se3.transform(se3.inverse(then.T_world_cam) @ T_then_now, points_world)
        flow = annotator.annotate(now, then).flow[v, u]
        expected = rig.project(points_then)[:, :2] - np.column_stack([u, v])
        np.testing.assert_allclose(flow[:, :2], expected, atol=2e-3)
        np.testing.assert_allclose(flow[:, 2], points_then[:, 2], rtol=1e-5)
        compared += len(u)
        still = se3.transform(se3.inverse(then.T_world_cam), points_world)
        if len(u):
            gap = np.abs(flow[:, :2] - rig.project(still)[:, :2] + np.column_stack([u, v]))
            assert gap.max() > 1.0
    assert compared > 500


def test_covisibility_behind_a_mover_is_hidden(scenery):
    """Static points that are hidden in the next frame, by a second geometry of the world."""
    world, captures, annotator = scenery
    rig, hidden = world.rig, 0
    for now, then in pairwise(captures):
        annotation = annotator.annotate(now, then)
        flow, seen = annotation.flow, annotation.covisibility
        v, u = np.nonzero(np.isfinite(flow[..., 2]))
        to = np.column_stack([u, v]) + flow[v, u, :2]
        inside = ((to >= 0) & (to <= [rig.width_px - 1, rig.height_px - 1])).all(axis=1)
        np.testing.assert_array_equal(seen[v, u] == OUTSIDE, ~inside)
        v, u, to = v[inside], u[inside], to[inside]
        # The pixels around a point: at least one shows it, or one shows something nearer.
        corners = [(f(to[:, 1]), g(to[:, 0])) for f in BESIDE for g in BESIDE]
        met = np.array([then.geometry.depth_left_m[y, x] for y, x in corners]) / flow[v, u, 2]
        clear, covered = seen[v, u] == VISIBLE, seen[v, u] == HIDDEN
        clear &= flow[v, u, 2] < 15  # beyond, the ground's depth changes by 2 % in a tenth of a row
        assert np.mean(np.nanmin(np.abs(met - 1), axis=0)[clear] < 0.02) > 0.999
        assert np.mean(np.nanmin(met, axis=0)[covered] < 0.99) > 0.99
        hidden += int((seen == HIDDEN).sum())
    assert hidden > 20


def test_occlusion_agrees_with_right_disparity(scenery):
    _, captures, annotator = scenery
    annotation = annotator.annotate(captures[0], None)
    disparity, right, seen = annotation.disparity, annotation.disparity_right, annotation.occlusion
    np.testing.assert_array_equal(seen == NOTHING, np.isnan(disparity))

    def around(v: Array, u: Array) -> Array:
        at = u - disparity[v, u]
        return np.array([right[v, f(at)] for f in BESIDE]) - disparity[v, u]

    visible = around(*np.nonzero(seen == VISIBLE))
    assert np.mean(np.nanmin(np.abs(visible), axis=0) < 0.5) > 0.999
    v, u = np.nonzero(seen == HIDDEN)
    assert np.mean(np.nanmax(around(v, u), axis=0) > 0.4) > 0.95
    assert len(u) > 20
    v, u = np.nonzero(seen == OUTSIDE)
    assert (u - disparity[v, u] < 0).all()
    assert 0.02 < len(u) / seen.size < 0.3


def test_normals_of_level_ground_point_up(scenery):
    world, captures, annotator = scenery
    capture = captures[0]
    ground = capture.geometry.geoms_left == world.model.geom("ground").id
    up_cam = capture.T_world_cam[:3, :3].T @ [0, 0, 1]
    normals = annotator.annotate(capture, None).normals[ground]
    finite = np.isfinite(normals).all(axis=1)
    assert finite.mean() > 0.9
    assert np.median(normals[finite] @ up_cam) > 0.9999
    assert np.quantile(normals[finite] @ up_cam, 0.01) > 0.99


@pytest.mark.parametrize("flex_deg", [0.0, 4.0])
def test_labels_with_bending_mast_explain_images(make_scene, flex_deg):
    """Nothing else about the camera is known than the trip's poses of the body."""
    settings = SMALL.model_copy(
        update={
            "rover": RoverSettings(flex_deg=flex_deg),
            "drive": DriveSettings(distance_m=0.5),
        }
    )
    scene = make_scene(boxes=True, bumps=True)
    world, captures, annotator = _captures(scene, settings)
    trip = make_trip(build_world(scene, settings), settings)
    camera = StereoCamera(world, settings)
    moved_px, errors = [], []
    for now, then in pairwise(captures):
        T_world_cam = trip.T_world_body[now.index] @ world.rig.T_body_cam
        np.testing.assert_allclose(now.T_world_cam, T_world_cam, atol=1e-9)
        annotation = annotator.annotate(now, then)
        images = [camera.form_images(c).rectified[0].astype(np.float32) for c in (now, then)]
        v, u = np.nonzero(annotation.covisibility == VISIBLE)
        places = [
            (grid[v, u] + annotation.flow[v, u, k])[None].astype(np.float32)
            for k, grid in enumerate(np.meshgrid(np.arange(160.0), np.arange(120.0)))
        ]
        warped = cv2.remap(images[1], places[0], places[1], cv2.INTER_CUBIC)[0]
        errors.append(np.median(np.abs(warped - images[0][v, u])))
        moved_px.append(np.median(np.abs(annotation.flow[v, u, :2])))
    assert np.median(errors) < 1.0
    assert np.median(moved_px) > 0.5


def test_classes_of_sky_ground_and_cartons(make_scene, settled):
    settings = SMALL.model_copy(
        update={
            "terrain": TerrainSettings(boxes_per_m=1.0),
            "rig": SMALL.rig.model_copy(update={"tilt_deg": 5.0}),
            "drive": DriveSettings(),
        }
    )
    world = settled(make_scene(), settings)
    with StereoRenderer(world, settings.render) as renderer:
        geoms = renderer.render_geometry().geoms_left
    annotator = Annotator(world)
    classes, objects = annotator.kind_of[geoms], annotator.object_of[geoms]
    assert (classes.dtype, objects.dtype) == (np.uint8, np.uint16)
    assert not objects[geoms == NO_GEOM].any()
    assert set(np.unique(classes)) == {Kind.SKY, Kind.GROUND, Kind.MOVING}
    (box,) = (k for k, x in enumerate(annotator.things, start=1) if x.name == "box_0")
    assert (objects == box).sum() > 100
    assert (classes[objects == box] == Kind.MOVING).all()


def test_labels_with_any_shutter_hold_at_mid_exposure(make_scene):
    """Depth of a long, rolling, unsynchronised exposure is that of an instant."""
    scene = make_scene(boxes=True, mover=passing)
    exposure = ExposureSettings(time_ms=40, line_time_us=50, right_offset_ms=5, subframes_max=2)
    _, instants, _ = _captures(scene, SMALL)
    _, long, _ = _captures(scene, SMALL.model_copy(update={"exposure": exposure}))
    for a, b in zip(instants, long, strict=True):
        np.testing.assert_array_equal(a.geometry.geoms_left, b.geometry.geoms_left)
        np.testing.assert_allclose(a.geometry.depth_left_m, b.geometry.depth_left_m, rtol=1e-6)
        np.testing.assert_allclose(a.T_world_cam, b.T_world_cam, atol=1e-9)


def _captures(scene, settings) -> tuple[World, list[Capture], Annotator]:
    world = build_world(scene, settings)
    trip = make_trip(world, settings)
    with StereoRenderer(world, settings.render) as renderer:
        captures = list(StereoCamera(world, settings).captures(trip, renderer))
    return world, captures, Annotator(world)
