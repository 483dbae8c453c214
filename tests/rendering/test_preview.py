"""Preview: labels in the right colours, ceilings off, routes in place, films that play."""

from dataclasses import replace

import cv2
import mujoco
import numpy as np
import pytest
from typer.testing import CliRunner

from scenes.scene import Kind
from sim.camera.render import StereoRenderer
from sim.labels.labels import Occlusion
from sim.preview.cameras import render_world_map
from sim.preview.colours import NOTHING, DepthScale, depth_scale, flow_colours, round_down
from sim.preview.film import first_seconds, make_film, writing
from sim.preview.label_plates import (
    INVISIBLE,
    KINDS,
    class_colours,
    label_position,
    normal_colours,
    object_colours,
    visibility_colours,
)
from sim.preview.preview import changed_settings, contact_sheet, preview, write_picture
from sim.preview.route_map import BAR_SHARE, arrow_places
from sim.preview.sample_views import render_sample_views, short_trip
from sim.settings import RecordSettings
from sim.world.trip import make_trip
from sim.world.world import START_S, build_world
from trials.cli.main import app
from vo.contract import se3
from vo.contract.errors import SettingsError

SMALL = {"rig": {"width_px": 160, "height_px": 120}, "render": {"samples": 0, "shadow_size_px": 0}}


def settings_of(**changes) -> RecordSettings:
    return RecordSettings.model_validate({**SMALL, **changes})


def test_depth_colours_are_warm_near_cold_far_dark_unknown():
    near, far, nothing = DepthScale(0.5, 8).colours(np.array([[0.5, 8.0, np.nan]]))[0].astype(int)
    assert near[0] > near[2] + 60
    assert far[2] > far[0] + 30
    np.testing.assert_array_equal(nothing, NOTHING)


@pytest.mark.parametrize("depth_m", [(0.6, 0.7), (0.6, 40.0), (3.0, 3.0)])
def test_depth_scale_is_round_and_contains_depths(depth_m):
    scale = depth_scale(np.linspace(*depth_m, 1000).reshape(10, 100))
    assert scale.near_m <= depth_m[0]
    assert scale.far_m >= np.quantile(np.linspace(*depth_m, 1000), 0.98)
    marks = scale.marks(4)
    assert 1 <= len(marks) <= 4
    assert scale.near_m * 0.99 <= marks[0] <= marks[-1] <= scale.far_m * 1.01


def test_depth_scale_of_sky_only_exists():
    assert depth_scale(np.full((4, 4), np.nan)).far_m > 1


def test_object_colours_differ_largest_first():
    objects = np.repeat(np.arange(12), np.arange(1, 13) ** 2)[None]
    rgb, order = object_colours(objects)
    assert order == list(range(11, 0, -1))
    colours = np.array([rgb[0, objects[0] == k][0] for k in range(12)], float)
    gaps = np.linalg.norm(colours[:, None] - colours, axis=-1) + 1e3 * np.eye(12)
    assert gaps.min() > 25


def test_class_colours_are_those_of_the_key():
    rgb = class_colours(np.array([[k.value for k in Kind]]))
    assert [tuple(c) for c in rgb[0].tolist()] == [KINDS[k] for k in Kind]


def test_normal_colours_by_direction():
    directions = np.array([[(1, 0, 0), (0, -1, 0), (0, 0, -1), (np.nan,) * 3]], np.float32)
    right, up, towards, none = normal_colours(directions)[0].astype(int)
    assert np.argmax(right) == 0
    assert np.argmax(up) == 1
    assert np.argmax(towards) == 2
    np.testing.assert_array_equal(none, NOTHING)


def test_flow_colours_by_direction_and_dark_unknown():
    flow = np.array([[(0, 0, 1), (9, 0, 1), (-9, 0, 1), (np.nan, np.nan, 1)]], np.float32)
    rest, right, left, unknown = flow_colours(flow, 9)[0].astype(int)
    assert np.ptp(rest) == 0
    assert right[0] > 200
    assert right[2] < 30
    assert left[0] < 30
    np.testing.assert_array_equal(unknown, NOTHING)


def test_visibility_colours_mark_invisible_pixels():
    codes = np.array([[int(code) for code in Occlusion]])
    view = np.full((*codes.shape, 3), 100, np.uint8)
    rgb = visibility_colours(codes, view)
    for code, colour in INVISIBLE.items():
        assert tuple(rgb[0, int(code)].tolist()) == colour
    assert np.ptp(rgb[0, 0].astype(int)) == 0


def test_label_positions_are_inside_objects_and_apart():
    mask, taken = np.zeros((120, 160), bool), np.zeros((120, 160), bool)
    mask[40:110, 20:150] = True
    places = [label_position("bench", mask, taken) for _ in range(3)]
    for place in places:
        assert place is not None
        assert mask[int(place[1]), int(place[0])]
    gaps = np.abs(np.diff(np.array(places), axis=0))
    assert ((gaps[:, 0] > 10) | (gaps[:, 1] > 6)).all()
    assert label_position("bench", np.zeros((120, 160), bool), taken) is None


@pytest.mark.parametrize(("width_m", "bar_m"), [(6, 1), (14, 2), (104, 20), (0.5, 0.1)])
def test_scale_bar_fits_the_map(width_m, bar_m):
    assert round_down(BAR_SHARE * width_m) == pytest.approx(bar_m)


def test_arrows_are_even_and_along_the_route():
    way = np.array([(0, 0), (1, 0), (1, 0.0001), (1, 3.0)])
    places, directions = arrow_places(way, 4)
    np.testing.assert_allclose(places, [(0.5, 0), (1, 0.5), (1, 1.5), (1, 2.5)], atol=1e-3)
    np.testing.assert_allclose(directions, [(1, 0), (0, 1), (0, 1), (0, 1)], atol=1e-9)


def test_changed_settings_are_listed_as_set_options():
    settings = settings_of(sensor={"auto_exposure": True}, exposure={"time_ms": 2.5})
    assert set(changed_settings(settings)) >= {"sensor.auto_exposure=true", "exposure.time_ms=2.5"}
    assert changed_settings(RecordSettings()) == []


@pytest.mark.parametrize("name", ["a.bmp", "a"])
def test_write_picture_unknown_suffix_is_refused(tmp_path, name):
    with pytest.raises(SettingsError, match=r"\.png or \.jpg"):
        write_picture(tmp_path / name, np.zeros((4, 4, 3), np.uint8))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "options", [("--film", "a.avi"), ("--out", "a.gif"), ("--film", "a.mp4", "--out", "b.tiff")]
)
def test_preview_bad_suffix_is_refused_before_building(tmp_path, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sim.batch.build", lambda *_: pytest.fail("built nevertheless"))
    result = CliRunner().invoke(app, ["preview", "office", *options])
    assert isinstance(result.exception, SettingsError)
    assert "must end in" in str(result.exception)
    assert not list(tmp_path.iterdir())


def test_film_of_all_scenes_is_refused(tmp_path):
    result = CliRunner().invoke(app, ["preview", "all", "--film", str(tmp_path / "a.mp4")])
    assert isinstance(result.exception, SettingsError)


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_film_is_complete_or_absent(tmp_path, suffix):
    out = tmp_path / f"film{suffix}"
    with writing(out, 15.0) as show:
        for k in range(5):
            show(np.full((48, 64, 3), (40 * k, 0, 0), np.uint8))
    clip = cv2.VideoCapture(str(out))
    reds = []
    while (frame := clip.read()[1]) is not None:
        reds.append(int(frame[24, 32, 2]))
    np.testing.assert_allclose(reds, 40 * np.arange(5), atol=12)
    out.unlink()

    def broken() -> None:
        with writing(out, 15.0) as show:
            show(np.zeros((48, 64, 3), np.uint8))
            raise KeyError

    with pytest.raises(KeyError):
        broken()
    assert not list(tmp_path.iterdir())


def test_film_trip_is_the_start_of_the_whole_trip(make_scene):
    settings = settings_of()
    whole = make_trip(build_world(make_scene(bumps=True), settings), settings)
    _, trip = first_seconds(build_world(make_scene(bumps=True), settings), settings, 2.0)
    count = int(trip.delivered.sum())
    assert count == 2 * settings.rig.rate_hz + 1  # one more at the end, for the flow
    assert len(trip) < 0.8 * len(whole)
    np.testing.assert_array_equal(trip.T_world_body[:count], whole.T_world_body[:count])


@pytest.mark.parametrize("carrier", ["rover", "handheld"])
def test_short_trip_is_at_its_time_of_the_whole_trip(make_scene, carrier):
    settings = settings_of(drive={"carrier": carrier})
    scene = make_scene()
    scene.spec.worldbody.add_body(name="clock", mocap=True)
    scene = replace(scene, movers={"clock": lambda t: se3.pose(np.eye(3), np.array([t, 9, 9]))})
    there, trip = short_trip(build_world(scene, settings), settings, 0.5)
    frames = np.flatnonzero(trip.delivered)
    assert len(frames) == 2
    assert trip.T_world_body[frames[0], 0, 3] == pytest.approx(1.6, abs=0.15)
    assert trip.v_world_body[frames[0], 0] > 0.15
    there_s = there.movers["clock"](START_S)[0, 3] - START_S
    assert there_s == pytest.approx(1.5 / settings.drive.speed_mps, abs=0.6)


def test_short_trip_with_auto_exposure_has_metering_frames(make_scene):
    settings = settings_of(sensor={"auto_exposure": True})
    trip = short_trip(build_world(make_scene(), settings), settings, 0.2)[1]
    assert trip.delivered.sum() > 6


def room(make_scene, ceiling: bool):
    """The toy scene in four walls of 2 m; the ceiling is of another colour."""
    scene = make_scene()
    walls = [((x, 0, 1), (0.1, 2.5, 1)) for x in (-1.5, 5.5)]
    walls += [((2, y, 1), (3.4, 0.1, 1)) for y in (-2.5, 2.5)]
    lids = [((2, 0, 2.1), (3.5, 2.6, 0.05))] if ceiling else []
    for k, (centre, half) in enumerate([*walls, *lids]):
        colour = (0, 0, 1, 1) if k == 4 else (0.9, 0.1, 0.1, 1)
        box = mujoco.mjtGeom.mjGEOM_BOX
        scene.spec.worldbody.add_geom(type=box, pos=centre, size=half, rgba=colour)
    return scene


@pytest.mark.gl
def test_overhead_map_hides_ceiling_and_keeps_walls(make_scene):
    images = []
    for ceiling in (False, True):
        world = build_world(room(make_scene, ceiling), settings_of())
        groups = world.model.geom_group.copy()
        with StereoRenderer(world, settings_of().render, color=True) as renderer:
            top_down = render_world_map(world, renderer)
        np.testing.assert_array_equal(world.model.geom_group, groups)
        images.append(top_down.image.astype(int))
    u, v = top_down.pixels(np.array([(-1.5, 0.0)]))[0].round().astype(int)
    assert images[1][v, u, 0] > 2 * images[1][v, u, 2]  # a red wall
    assert np.abs(images[1] - images[0]).mean() < 1
    blue = (images[1][..., 2] > 1.5 * images[1][..., 0]) & (images[1][..., 2] > 60)
    assert blue.mean() < 0.01


@pytest.mark.gl
def test_sample_views_match_the_recorded_images(make_scene):
    """A noisy grey camera in the dusk gives noisy grey views; their noise is that of the sensor."""
    clean = settings_of()
    noisy = settings_of(sensor={"read_noise": 300})
    views = []
    for settings in (clean, noisy):
        world = build_world(make_scene(boxes=True), settings)
        samples = render_sample_views(world, settings)
        views.append(np.array([sample.view for sample in samples.views], float))
        assert (np.ptp(views[-1], axis=-1) == 0).all()  # grey
    difference = np.std(views[1] - views[0])
    assert 1 < difference < 40
    sheet = contact_sheet(world, samples)
    assert sheet.shape[1] == 1920
    assert len(np.unique(sheet.astype(int) @ (1, 256, 65536))) > 3000  # colours


@pytest.mark.gl
def test_preview_sheet_and_film_are_written(make_scene, tmp_path):
    settings = settings_of(drive={"distance_m": 1.0})
    preview(make_scene(boxes=True), settings, tmp_path / "sheet.jpg")
    assert cv2.imread(str(tmp_path / "sheet.jpg")).shape[1] == 1920
    steps = []
    out = tmp_path / "film.mp4"
    make_film(make_scene(boxes=True), settings, out, 0.6, lambda *x: steps.append(x))
    clip = cv2.VideoCapture(str(out))
    assert steps[-1][0] == steps[-1][1] == int(clip.get(cv2.CAP_PROP_FRAME_COUNT)) == 9
    assert clip.get(cv2.CAP_PROP_FPS) == settings.rig.rate_hz
    assert sorted(x.name for x in tmp_path.iterdir()) == ["film.mp4", "sheet.jpg"]
