"""Images and labels of users' worlds show the same things, or say where they do not."""

import os
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from scenes.custom import load_scene
from scenes.scene import IMAGE_GROUP, LABEL_GROUP, Scene
from sim.camera.camera import StereoCamera
from sim.camera.render import StereoRenderer
from sim.certificate.label_coverage import check_coverage, contradictions, unlabelled_pixels
from sim.labels.annotate import Annotator
from sim.labels.labels import NOTHING
from sim.record import record
from sim.settings import DriveSettings, RecordSettings, RenderSettings, RigSettings
from sim.world.drawn import rendering_entry
from sim.world.trip import make_trip
from sim.world.world import build_world
from vo.contract.remarks import Remark
from vo.contract.settings import amended

pytestmark = pytest.mark.gl

SETTINGS = RecordSettings(
    rig=RigSettings(width_px=160, height_px=120, rate_hz=5, tilt_deg=15),
    render=RenderSettings(samples=0, shadow_size_px=0),
    drive=DriveSettings(waypoints=((0.0, 0.0), (0.3, 0.0)), carrier="handheld"),
)
WORLD = """<mujoco><asset><material name="mirror" reflectance="0.8"/></asset>
<worldbody><light pos="0 0 4" dir="0.2 0 -1"/>
<geom name="floor" type="plane" size="5 5 1" rgba=".3 .4 .5 1"/>{}</worldbody>{}</mujoco>"""
BOX = '<geom name="thing" type="box" size=".2 .2 .2" pos="1.5 0 .3" {}/>'
SITES = """<site name="here" pos="1.5 -.4 .3" zaxis="0 1 0" size=".1"
 rgba="1 0 0 1"/>
<body pos="1.5 .5 .3"><joint type="slide" axis="0 1 0"/><geom size=".1" mass="1"/>
<site name="there" size=".02"/></body>"""
RAY = '<sensor><rangefinder site="here"/></sensor>'
CORD = f"""<tendon><spatial name="cord" width=".03">
<site site="here"/><site site="there"/></spatial></tendon>{RAY}"""
CLOTH = """<flexcomp name="cloth" type="grid" count="5 5 1" spacing=".1 .1 .1" pos="1.5 0 .4"
 euler="0 90 0" radius=".01" dim="2"><edge equality="true"/><pin id="0 4"/></flexcomp>"""


@pytest.fixture
def seen(tmp_path):
    """Function from MJCF to the first frame's annotation, left image and coverage."""

    def look(body: str = "", rest: str = "", scene: Scene | None = None):
        path = tmp_path / "world.xml"
        path.write_text(WORLD.format(body, rest))
        world = build_world(scene or load_scene(str(path)), SETTINGS)
        trip, camera = make_trip(world, SETTINGS), StereoCamera(world, SETTINGS)
        trip = replace(trip, delivered=np.arange(len(trip)) < 2)
        with StereoRenderer(world, SETTINGS.render, color=True) as renderer:
            coverage = check_coverage(world, trip, renderer)
            now, following = camera.captures(trip, renderer)
        annotator = Annotator(world)
        return annotator.annotate(now, following), now.light[0], coverage

    return look


def mask_of(annotation, name: str) -> np.ndarray:
    """Pixels of an object in the segmentation; empty if there is none."""
    numbers = [k for k, x in enumerate(annotation.annotator.things, start=1) if x.name == name]
    return np.isin(annotation.segmentation, numbers)


@pytest.mark.parametrize("group", [0, 2, 3, 4, 5])
def test_geoms_of_any_group_are_in_both_or_neither(seen, group):
    annotation, image, coverage = seen(BOX.format(f'group="{group}" rgba="1 0 0 1"'))
    red = image[..., 0] > image[..., 2].astype(int) + 60
    assert coverage["passed"]
    assert (mask_of(annotation, "thing") & red).sum() > 300 if group < 3 else not red.any()
    assert mask_of(annotation, "thing").any() == (group < 3)


def test_sites_and_tendons_are_labelled_and_rays_are_off(seen):
    annotation, image, coverage = seen(SITES, CORD)
    assert coverage["passed"]
    site, cord = mask_of(annotation, "site/here"), mask_of(annotation, "tendon/cord")
    assert site.sum() > 50
    assert (image[site][:, 0] > image[site][:, 2].astype(int) + 30).mean() > 0.9
    assert np.isfinite(annotation.flow[site]).all()
    assert cord.sum() > 30
    assert np.isfinite(annotation.depth[cord]).all()
    assert np.isnan(annotation.flow[cord]).all()
    assert (annotation.covisibility[cord] == NOTHING).all()
    assert {x.name for x in annotation.annotator.things} >= {"site/there", "floor"}
    yellow = (image[..., :2] > 200).all(axis=-1) & (image[..., 2] < 60)
    assert not yellow.any()  # the colour of a range finder's ray


def test_cloth_is_labelled_without_flow(seen):
    annotation, _, coverage = seen(CLOTH)
    cloth = mask_of(annotation, "flex/cloth")
    assert coverage["passed"]
    assert cloth.sum() > 300
    np.testing.assert_allclose(annotation.depth[cloth], 1.4, atol=0.15)
    assert np.isnan(annotation.flow[cloth]).all()


def test_glass_is_marked_where_no_label_explains_it(seen):
    annotation, image, coverage = seen(BOX.format('rgba=".2 1 .2 .4"'))
    glass = mask_of(annotation, "thing")
    opaque = seen(BOX.format('rgba=".2 1 .2 1"'))[1]
    assert coverage["passed"]
    assert glass.sum() > 300
    assert not np.array_equal(image[glass], opaque[glass])  # what is behind it shines through
    for label in (annotation.depth, annotation.disparity, annotation.flow, annotation.normals):
        assert np.isnan(label[glass]).all()
    for label in (annotation.occlusion, annotation.covisibility):
        assert (label[glass] == NOTHING).all()
    assert np.isfinite(annotation.depth[~glass & (annotation.classes > 0)]).all()


def test_more_markers_than_a_buffer_are_all_drawn(seen, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    spots = [(1.2 + 0.05 * i, 0.08 * j) for i in range(20) for j in range(-6, 7)]
    text = "".join(f'<site pos="{x} {y} .01" size=".01"/>' for x, y in spots)
    annotation, _, coverage = seen(text)
    seen_sites = set(np.unique(annotation.segmentation))
    numbers = {k for k, x in enumerate(annotation.annotator.things, 1) if "site/" in x.name}
    assert coverage["passed"]
    assert len(numbers & seen_sites) > 150
    assert os.listdir(tmp_path) == ["world.xml"]


def test_reflections_are_off_and_said(seen, tmp_path):
    pillar = '<geom type="box" size=".1 .1 .5" pos="1.9 0 .5" rgba="1 0 0 1"/>'
    floor = '<geom type="box" name="thing" size=".3 .5 .01" pos="1.2 0 .01" material="mirror"/>'
    with pytest.warns(Remark, match=r"world\.xml: reflections are not rendered \(material mirror"):
        annotation, mirror, coverage = seen(pillar + floor)
    floor_px = mask_of(annotation, "thing")
    assert coverage["passed"]
    assert floor_px.sum() > 300
    redness = mirror[floor_px][:, 0].astype(int) - mirror[floor_px][:, 2]
    assert redness.max() < 20  # the red pillar is not mirrored
    world = build_world(load_scene(str(tmp_path / "world.xml")), SETTINGS)
    assert rendering_entry(world)["reflections_off"] == ["mirror"]


@pytest.mark.parametrize("group", [IMAGE_GROUP, LABEL_GROUP])
def test_coverage_fails_where_only_images_or_labels_show(seen, group):
    spec = mujoco.MjSpec.from_string(WORLD.format(BOX.format(f'group="{group}"'), ""))
    scene = Scene("own", "", spec, {"default": np.eye(2)}, (-1, -1, 2, 2))
    _, _, coverage = seen(scene=scene)
    assert not coverage["passed"]
    assert coverage["unlabelled_max_px"] > 600


def test_coverage_finds_what_is_no_object_of_the_labels(tmp_path, monkeypatch):
    """The ray of a range finder, drawn in images and labels as in a viewer, is none."""
    path = tmp_path / "world.xml"
    path.write_text(WORLD.format(SITES, RAY))
    world = build_world(load_scene(str(path)), SETTINGS)
    with StereoRenderer(world, SETTINGS.render) as renderer:
        world.place_bodies()
        mujoco.mj_forward(world.model, world.data)
        assert unlabelled_pixels(renderer) == 0
        monkeypatch.setattr("sim.camera.render.DRAWN", mujoco.mjtCatBit.mjCAT_ALL)
        for option in (renderer._image_option, renderer._label_option):
            option.flags[mujoco.mjtVisFlag.mjVIS_RANGEFINDER] = 1
        assert unlabelled_pixels(renderer) > 10


def test_coverage_finds_colours_that_have_no_depth(tmp_path):
    """A name that is written beside a thing, as a viewer does it, over the sky."""
    path = tmp_path / "world.xml"
    thing = '<geom name="a sign far away" size=".05" pos="2 .3 1.5"/>'
    path.write_text(WORLD.format(thing, ""))
    world = build_world(load_scene(str(path)), amended(SETTINGS, {"rig.tilt_deg": -15}))
    with StereoRenderer(world, SETTINGS.render) as renderer:
        world.place_bodies()
        assert unlabelled_pixels(renderer) == 0
        renderer._image_option.label = mujoco.mjtLabel.mjLABEL_GEOM
        assert unlabelled_pixels(renderer) > 30


def test_planes_from_behind_are_drawn_in_neither(seen):
    plane = '<geom name="{}" type="plane" size=".2 .2 1" pos="1.5 {} .3" zaxis="{} 0 0"'
    wall = plane + ' rgba="1 0 0 1" contype="0" conaffinity="0"/>'
    annotation, image, coverage = seen(wall.format("back", 0.3, 1) + wall.format("front", -0.3, -1))
    red = image[..., 0] > image[..., 2].astype(int) + 60
    front, back = mask_of(annotation, "front"), mask_of(annotation, "back")
    assert coverage["passed"]
    assert (front & red).sum() > max(300, 0.9 * red.sum())
    assert not (back | red)[:, :75].any()


def test_camera_that_passes_through_a_body_is_remarked(tmp_path):
    path = tmp_path / "world.xml"
    post = '<geom name="post" type="box" pos=".45 0 .5" size=".15 .4 .5" contype="0"/>'
    path.write_text(WORLD.format(post, ""))
    scene, drive = load_scene(str(path)), {"drive.waypoints": ((0.0, 0.0), (0.6, 0.0))}
    said = r"world\.xml: the camera passes through post, first at \(0\.[3-6]\d, .*, 0\.\d\d\) m"
    with pytest.warns(Remark, match=said):
        record(scene, amended(SETTINGS, drive), tmp_path / "out")


def test_contradictions_spare_outlines_and_find_small_things():
    label = np.full((20, 20), 4.0, np.float32)
    label[:, :5], label[:2] = 1.0, np.nan
    image = label.copy()
    image[2:, 5] = 1.0  # an outline one pixel beside
    assert not contradictions(label, image)[:, 3:].any()
    image[10:12, 10:12] = 3.0
    image[0, 15] = 3.0
    assert contradictions(label, image).sum() == 5
    image[10:13, 10:13] = np.nan
    assert contradictions(label, image).sum() == 10
