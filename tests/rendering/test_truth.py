"""Truth beyond labels: motion between any frames, boxes, clouds, occupancy; against geometry."""

import json
import re
import shutil
import sys
import warnings
from itertools import pairwise
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from terminal import ROOT
from typer.testing import CliRunner

import driftyard as dy
from driftyard.dataset import Dataset
from sim.labels.labels import EDGE, HIDDEN, NOTHING, OUTSIDE, VISIBLE
from sim.labels.views import View, covisibility_between, flow_between
from trials.cli.main import app
from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.remarks import Remark
from vo.recordings.images import read_codes, read_float

pytestmark = pytest.mark.gl

WORLD = """
import mujoco, numpy as np
from scenes.scene import Scene

def passing(time_s):
    c, s = np.cos(0.8 * (time_s - 1)), np.sin(0.8 * (time_s - 1))
    T = np.eye(4)
    T[:2, :2] = (c, -s), (s, c)
    T[:3, 3] = 1.3, -0.3 + 0.3 * (time_s - 1), 0.11
    return T

def make():
    spec = mujoco.MjSpec()
    box, plane = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_PLANE
    spec.worldbody.add_geom(name="ground", type=plane, size=(6, 6, 1))
    spec.worldbody.add_geom(name="post", type=box, size=(0.04, 0.04, 0.3), pos=(1.9, 0.1, 0.3),
                            quat=(0.9238795, 0, 0, 0.3826834))
    spec.worldbody.add_geom(name="wall", type=box, size=(0.05, 2, 0.2), pos=(3, 0, 0.2))
    spec.worldbody.add_light(type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, dir=(0.3, 0.2, -1))
    spec.worldbody.add_body(name="mover", mocap=True).add_geom(
        name="mover", type=box, size=(0.15, 0.15, 0.10))
    route = {"default": np.array([[0.0, 0.0], [3.0, 0.0]])}
    extent = (-2.0, -3.0, 6.0, 3.0)
    return Scene("passage", "Tests.", spec, route, extent, movers={"mover": passing})
"""
"""A box that passes and turns in front of a post and a wall."""
SETTINGS = {
    "rig": {"width_px": 160, "height_px": 120, "rate_hz": 5},
    "drive": {"distance_m": 0.4, "speed_mps": 0.36},
    "render": {"samples": 0, "shadow_size_px": 0},
    "labels": {"flow": True, "covisibility": True, "segmentation": True},
}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("truth")
    (folder / "passage_world.py").write_text(WORLD)
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        patch.chdir(folder)
        warnings.simplefilter("ignore", Remark)  # without textures, the certificate has no power
        dy.record("passage_world:make", folder / "ds", settings=SETTINGS)
    return folder / "ds"


@pytest.fixture(scope="module")
def ds(recorded) -> Dataset:
    return dy.open(recorded)


@pytest.fixture(autouse=True)
def beside_the_world(recorded, monkeypatch):
    monkeypatch.chdir(recorded.parent)


def numbered(ds: Dataset, name: str) -> int:
    return next(number for number, thing in ds.things.items() if thing == name)


def moved(ds: Dataset, i: int, j: int) -> Array:
    """Motion of the mover in the world between two frames, by its formula."""
    passing = sys.modules["passage_world"].passing
    then, now = (passing(ds.timestamps_ns[k] * 1e-9) for k in (j, i))
    return then @ se3.inverse(now)


def expected_pixels(ds: Dataset, i: int, j: int) -> Array:
    """(H, W, 3) u, v and disparity in frame j of what frame i shows, by depth and poses."""
    v, u = np.mgrid[: ds.rig.height_px, : ds.rig.width_px].astype(float)
    z = ds.depth(i).astype(float)
    points = np.stack([(u - ds.rig.cx_px) * z, (v - ds.rig.cy_px) * z, ds.rig.f_px * z], -1)
    world = se3.transform(ds.T_world_cam[i], (points / ds.rig.f_px).reshape(-1, 3))
    is_mover = (ds.segmentation(i) == numbered(ds, "mover")).ravel()
    world[is_mover] = se3.transform(moved(ds, i, j), world[is_mover])
    found = ds.rig.project(se3.transform(se3.inverse(ds.T_world_cam[j]), world))
    return found.reshape(*z.shape, 3)


def test_flow_to_the_next_frame_is_the_label(ds):
    assert (ds.segmentation(1) == numbered(ds, "mover")).sum() > 100
    for i, j in pairwise(range(3)):
        motion = dy.flow(ds, i, j)
        np.testing.assert_allclose(motion.flow, ds.flow(i)[..., :2], atol=1e-4)
        np.testing.assert_allclose(motion.depth_m, ds.flow(i)[..., 2], rtol=1e-6)
        np.testing.assert_array_equal(motion.covisibility, ds.covisibility(i))


@pytest.mark.parametrize(("i", "j"), [(0, -1), (-1, 0), (2, 5), (3, 3)])
def test_flow_between_any_frames_follows_geometry(ds, i, j):
    i, j = ds.row(i), ds.row(j)
    motion, expected = dy.flow(ds, i, j), expected_pixels(ds, i, j)
    v, u = np.mgrid[: ds.rig.height_px, : ds.rig.width_px]
    error = np.hypot(*np.moveaxis(motion.flow + np.stack([u, v], -1) - expected[..., :2], -1, 0))
    near = expected[..., 2] < 500  # what comes close to the camera moves by any number of pixels
    assert near.mean() > 0.5
    assert np.nanmax(error[near]) < 2e-3
    assert (motion.covisibility == VISIBLE).mean() > 0.3
    assert cv2.imdecode(np.frombuffer(motion._repr_png_(), np.uint8), 1).shape == (120, 160, 3)
    if i == j:
        assert set(np.unique(motion.covisibility)) <= {VISIBLE, NOTHING}


def test_covisibility_agrees_with_rays(ds):
    """Rays of MuJoCo from the camera of frame j to what frame i shows, as an independent test."""
    i, j = 1, len(ds) - 1
    codes, motion = dy.flow(ds, i, j).covisibility, dy.flow(ds, i, j)
    replay = ds.views.replay
    model, data = replay.world.model, replay.world.data
    time_ns = int(ds.timestamps_ns[j])
    replay.world.place(time_ns * 1e-9, replay.trip.states.at(model, time_ns))
    eye, compared = ds.T_world_cam[j, :3, 3], 0
    v, u = np.nonzero(np.isin(codes, (VISIBLE, HIDDEN)))
    for k in range(0, len(u), 17):
        pixel = np.array([u[k], v[k]]) + motion.flow[v[k], u[k]]
        z = float(motion.depth_m[v[k], u[k]])
        point = se3.transform(ds.T_world_cam[j], z * np.array([[*ds.rig.normalized(pixel), 1.0]]))[
            0
        ]
        ray, geom = point - eye, np.zeros(1, np.int32)
        groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)
        reach = mujoco.mj_ray(model, data, eye, ray, groups, 1, -1, geom)
        assert (reach < 0.985) == (codes[v[k], u[k]] == HIDDEN), (u[k], v[k], reach)
        compared += 1
    assert compared > 300
    assert (codes == HIDDEN).sum() > 20


def test_tracks_agree_with_flow_and_with_stereo(ds):
    number, row = numbered(ds, "mover"), 2
    v, u = np.argwhere(ds.segmentation(row) == number)[60]
    sky = np.argwhere(ds.segmentation(row) == 0)
    queries = [[float(u), float(v)], [20.0, 100.0], sky[3][::-1]]
    tracks = dy.tracks(ds, queries, frame=row)
    assert tracks.queries[0].tolist() == [row, u, v]
    for j in range(len(ds)):
        motion = dy.flow(ds, row, j)
        for k, (x, y) in enumerate(np.array(queries, int)):
            np.testing.assert_allclose(tracks.pixels[k, j], [x, y] + motion.flow[y, x], atol=2e-3)
            if j != row:
                assert tracks.visibility[k, j] == motion.covisibility[y, x]
    assert np.isnan(tracks.points_world[2]).all()
    expected = se3.transform(moved(ds, row, 0), tracks.points_world[0, [row]])
    np.testing.assert_allclose(tracks.points_world[0, 0], expected[0], atol=1e-6)
    disparity = ds.disparity(row)[v, u]
    np.testing.assert_allclose(tracks.pixels_right[0, row], [u - disparity, v], atol=1e-4)


def test_tracks_are_saved_as_tap_vid_names_them(ds, tmp_path):
    tracks = dy.tracks(ds, 40)
    saved = np.load(tracks.save(tmp_path / "tracks.npz"))
    count = len(tracks.pixels)
    assert saved["points"].shape == (count, len(ds), 2)
    assert saved["occluded"].shape == (count, len(ds))
    np.testing.assert_array_equal(saved["query_points"][:, [2, 1]], tracks.pixels[:, 0])
    assert not saved["occluded"][:, 0][tracks.visibility[:, 0] != NOTHING].any()
    assert set(np.unique(tracks.visibility)) <= {VISIBLE, HIDDEN, OUTSIDE, NOTHING, EDGE}


def test_static_pixels_need_no_simulation(ds, recorded, tmp_path):
    """Where the mover is out of view, labels give what a replay gives."""
    folder = tmp_path / "ds"
    shutil.copytree(recorded, folder)
    shutil.rmtree(folder / "mav0/segmentation0")
    static, replayed = dy.open(recorded), dy.open(folder)
    tracks, again = (dy.tracks(x, [[20.5, 100.25], [80, 110]]) for x in (static, replayed))
    assert "replay" not in vars(static.views)
    assert "replay" in vars(replayed.views)
    np.testing.assert_allclose(tracks.pixels, again.pixels, atol=1e-4)
    np.testing.assert_array_equal(tracks.visibility, again.visibility)


def test_recordings_of_others_are_taken_for_static(ds, recorded, tmp_path):
    folder = dy.export(dy.open(recorded, last=5), "tartanair", tmp_path / "P000")
    other = dy.open(folder)
    with pytest.warns(Remark, match="all is taken for static"):
        motion = dy.flow(other, 0, 5)
    static = ds.segmentation(0) != numbered(ds, "mover")
    expected = dy.flow(ds, 0, 5)
    known = static & np.isfinite(ds.depth(0)) & (expected.depth_m > 0.1)
    assert np.abs(motion.flow - expected.flow)[known].max() < 2e-3
    assert len(dy.point_cloud(other, voxel_m=0.1).points_world) > 100
    with pytest.raises(dy.DatasetError, match="P000: is not of driftyard: its world is unknown"):
        dy.boxes(other, 0)


def test_what_deforms_has_no_motion():
    rig = dy.StereoRig(4, 3, f_px=4.0, cx_px=1.5, cy_px=1.0, baseline_m=0.1)
    depth, numbers = np.full((3, 4), 2, np.float32), np.zeros((3, 4), np.int64)
    unpredicted = np.zeros((3, 4), bool)
    unpredicted[1, 2] = True
    view = View(
        rig, depth, depth, numbers, np.zeros(1, int), None, unpredicted, np.eye(4), np.eye(4)[None]
    )
    flow = flow_between(view, view)
    assert np.isnan(flow[1, 2]).all()
    assert np.isfinite(flow[~unpredicted]).all()
    assert covisibility_between(flow, view, depth)[1, 2] == NOTHING


def test_boxes_enclose_objects(ds):
    i = 4
    boxes, objects = {x.name: x for x in dy.boxes(ds, i)}, ds.segmentation(i)
    assert {x.id for x in boxes.values()} == set(np.unique(objects)) - {0}
    for box in boxes.values():
        assert ds.things[box.id] == box.name
        v, u = np.nonzero(objects == box.id)
        edges = [u.min() - 0.5, v.min() - 0.5, u.max() + 0.5, v.max() + 0.5]
        assert box.modal_px.tolist() == edges
        assert (box.amodal_px[:2] < box.modal_px[:2] + 1).all()
        assert (box.amodal_px[2:] > box.modal_px[2:] - 1).all()
    mover, post = boxes["mover"], boxes["post"]
    np.testing.assert_allclose(mover.size_m, (0.3, 0.3, 0.2), atol=1e-6)
    passing = sys.modules["passage_world"].passing(ds.timestamps_ns[i] * 1e-9)
    np.testing.assert_allclose(mover.T_world_box[:3, 3], passing[:3, 3], atol=1e-9)
    turn = np.abs(mover.T_world_box[:3, :3].T @ passing[:3, :3])  # axes are its own, in any order
    np.testing.assert_allclose(np.sort(turn, axis=1), [[0, 0, 1]] * 3, atol=1e-3)
    corners = ds.rig.project(mover.corners_cam)[:, :2]
    np.testing.assert_allclose(corners.min(axis=0), mover.amodal_px[:2], atol=0.1)
    np.testing.assert_allclose(corners.max(axis=0), mover.amodal_px[2:], atol=0.1)
    np.testing.assert_allclose(np.sort(post.size_m), (0.08, 0.08, 0.6), atol=1e-4)
    assert mover.to_dict()["size_m"] == mover.size_m.tolist()


def test_clouds_lie_on_the_static_surfaces(ds, tmp_path):
    cloud = dy.point_cloud(ds, voxel_m=0.02)
    x, y, z = cloud.points_world.T
    beyond = np.abs(z) < 0.01
    beyond |= np.abs(x - 2.95) < 0.01
    beyond |= (np.abs(z - 0.4) < 0.01) & (np.abs(x - 3.0) < 0.06)  # the top of the wall
    beyond |= (np.hypot(x - 1.9, y - 0.1) < 0.07) & (z < 0.61)
    assert beyond.mean() > 0.99
    assert len(cloud.points_world) > 2000
    header, _, body = cloud.save(tmp_path / "c.ply").read_bytes().partition(b"end_header\n")
    kinds = [(k, "<f4") for k in "xyz"] + [(k, "u1") for k in "rgb"]
    assert f"element vertex {len(x)}".encode() in header
    np.testing.assert_allclose(np.frombuffer(body, kinds)["x"], x, atol=1e-6)
    sampled = dy.point_cloud(ds, "surfaces", per_m2=200).points_world
    on_wall = (np.abs(sampled[:, 0] - 2.95) < 1e-6) & (sampled[:, 2] > 1e-6)
    assert abs(on_wall.sum() / (4 * 0.4 * 200) - 1) < 0.15


SOLIDS = """<mujoco><worldbody>
 <geom name="ground" type="plane" size="3 3 1"/>
 <geom name="box" type="box" size=".3 .2 .4" pos="1 1 .6" euler="20 30 40"/>
 <geom name="ball" type="sphere" size=".4" pos="-1 1 .7"/>
 <geom name="drum" type="cylinder" size=".3 .4" pos="-1 -1 .7" euler="50 0 0"/>
 <geom name="pill" type="capsule" size=".2 .3" pos="1 -1 .7" euler="0 60 0"/>
 <geom name="egg" type="ellipsoid" size=".2 .3 .4" pos="0 2 .8"/>
 <geom name="table" type="box" size=".3 .3 .02" pos="0 -2 .7"/>
</worldbody></mujoco>"""


def test_voxels_are_occupied_inside_solids_and_under_ground(tmp_path):
    (tmp_path / "solids.xml").write_text(SOLIDS)
    voxels = dy.occupancy(tmp_path / "solids.xml", 0.1, dimensions=3, z_m=(-0.2, 1.6))
    model = mujoco.MjModel.from_xml_string(SOLIDS)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    occupied = voxels.centres()
    near = np.min([_distance(model, data, k, occupied) for k in range(model.ngeom)], axis=0)
    assert near.max() < 0.1 * np.sqrt(3) / 2 + 0.01  # a surface passes through the voxel
    free = voxels.centres(0)
    for k in range(model.ngeom):
        assert _distance(model, data, k, free).min() > -0.01
    assert voxels.at([[0, -2, 0.3], [0, -2, 0.7], [1, 1, 0.6], [1, 1, -0.1]]).tolist() == [
        *(0, 100, 100, 100)
    ]
    assert (np.abs(occupied[:, :2]) < 3.1).all()


def _distance(model, data, geom, points):
    """Signed distance (N,) of points to a geom, at least that to its surface, m."""
    local = (points - data.geom_xpos[geom]) @ data.geom_xmat[geom].reshape(3, 3)
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])).name[7:], model.geom_size[geom]
    x, y, z = local.T
    if kind == "PLANE":
        return np.where((np.abs(local[:, :2]) < 3).all(axis=1), z, 9)
    if kind == "SPHERE":
        return np.linalg.norm(local, axis=1) - size[0]
    if kind == "ELLIPSOID":
        return (np.linalg.norm(local / size, axis=1) - 1) * size.min()
    if kind == "CAPSULE":
        along = np.clip(z, -size[1], size[1])
        return np.sqrt(x**2 + y**2 + (z - along) ** 2) - size[0]
    if kind == "CYLINDER":
        away = np.column_stack([np.hypot(x, y) - size[0], np.abs(z) - size[1]])
    else:
        away = np.abs(local) - size
    outside = np.linalg.norm(np.maximum(away, 0), axis=1)
    return outside + np.minimum(away.max(axis=1), 0)


def test_rooms_hide_what_is_beyond_and_in_cupboards(tmp_path):
    boxes = (
        *(("2 .05 1", "0 2 1"), ("2 .05 1", "0 -2 1"), (".05 2 1", "2 0 1"), (".05 2 1", "-2 0 1")),
        *(("2.1 2.1 .05", "0 0 2.05"), (".2 .02 .2", "1.5 1.3 .2"), (".2 .02 .2", "1.5 1.7 .2")),
        *((".02 .2 .2", "1.3 1.5 .2"), (".02 .2 .2", "1.7 1.5 .2"), (".22 .22 .02", "1.5 1.5 .4")),
    )
    geoms = "".join(f'<geom type="box" size="{s}" pos="{p}"/>' for s, p in boxes)
    ground = '<geom type="plane" size="4 4 1"/>'
    file = tmp_path / "room.xml"
    file.write_text(f"<mujoco><worldbody>{ground}{geoms}</worldbody></mujoco>")
    places = [[0, 0, 1.0], [1.5, 1.5, 0.2], [3, 3, 1.0], [1.5, 1.5, 1.0], [0, 2, 1.0]]
    voxels = dy.occupancy(file, 0.05, dimensions=3)
    assert voxels.at(places).tolist() == [0, -1, -1, 0, 100]
    ground = dy.occupancy(file, 0.05)
    assert ground.at(np.array(places)[:, :2]).tolist() == [0, 100, -1, 100, 100]
    shown = cv2.imdecode(np.frombuffer(ground._repr_png_(), np.uint8), 0)
    assert set(np.unique(shown)) == {0, 205, 254}
    saved = ground.save(tmp_path / "map.yaml").read_text()
    assert "image: map.pgm" in saved
    assert (tmp_path / "map.pgm").read_bytes().startswith(b"P5 ")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda ds: dy.flow(ds, 0, 999), "frame 999: the frames are 0 to"),
        (
            lambda ds: dy.tracks(ds, [[1.0, 2.0], [160.0, 3.0]]),
            r"points: row 1, \(160, 3\), is out",
        ),
        (lambda ds: dy.tracks(ds, [1.0, 2.0]), r"points: shape \(2,\); expected \(N, 2\)"),
        (lambda ds: dy.tracks(ds, [[1.0], [2.0, 3.0]]), "points: expected numbers"),
        (lambda ds: dy.tracks(ds, 0), "points: a spacing of 0 px"),
        (lambda ds: dy.tracks(ds, 40).save("t.csv"), "t.csv: the name must end in .npz"),
        (lambda ds: dy.point_cloud(ds, "mesh"), "a point cloud of mesh; expected depth or surf"),
        (lambda ds: dy.point_cloud(ds, voxel_m=0), "voxel_m 0: expected a positive number"),
        (lambda ds: dy.occupancy(ds, 1e-4, dimensions=3), "resolution 0.0001 m: .* voxels; exp"),
        (lambda ds: dy.occupancy(ds, 1e-5), "resolution_m 1e-05: .* cells; expected up to"),
        (lambda ds: dy.occupancy("yrad"), "unknown scene yrad"),
    ],
)
def test_bad_requests_are_one_family_of_errors(ds, call, message):
    with pytest.raises(dy.DriftyardError, match=message) as raised:
        call(ds)
    assert "\n" not in str(raised.value)


def test_a_world_that_is_gone_is_one_error(recorded, tmp_path, monkeypatch):
    """Whatever needs the drive again says so; labels still give what they can."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "passage_world")
    monkeypatch.setattr(sys, "path", [x for x in sys.path if x != ""])
    moved = dy.open(recorded)
    with pytest.raises(dy.DatasetError, match="cannot be simulated again"):
        dy.boxes(moved, 0)
    assert dy.tracks(moved, [[20.5, 100.25]]).visibility[0, 0] == VISIBLE


def test_command_writes_every_kind_with_pictures(recorded, tmp_path):
    out = tmp_path / "labels"
    words = ["label", "ds", "--out", str(out), "--last", "1", "--apart", "-1", "--pictures"]
    more = ["--voxel", "0.1", "--resolution", "0.2", "--grid", "40"]
    done = CliRunner().invoke(app, words + more, catch_exceptions=False)
    assert done.exit_code == 0, done.stdout
    chosen = dy.open(recorded, last=1)
    label = read_float(out / "flow/000001_000000.tiff", 3)
    np.testing.assert_allclose(label, chosen.flow(1, 0), atol=1e-6)
    codes = read_codes(out / "covisibility/000001_000000.png")
    np.testing.assert_array_equal(codes, chosen.covisibility(1, 0))
    frames = json.loads((out / "boxes.json").read_text())["frames"]
    assert [x["timestamp_ns"] for x in frames] == chosen.timestamps_ns.tolist()
    assert {x["name"] for x in frames[0]["boxes"]} >= {"ground", "mover", "wall"}
    written = {x.name for x in out.iterdir()}
    assert written > {"tracks.npz", "cloud.ply", "ground.yaml", "ground.pgm", "voxels.npz"}
    for picture in ("tracks", "boxes_000000", "flow_000001_000000", "cloud", "occupancy"):
        image = cv2.imread(str(out / f"pictures/{picture}.png"))
        assert image.std() > 5


def test_command_refuses_unknown_kinds_and_leaves_nothing(recorded, tmp_path):
    for words in (["--what", "masks"], ["--what", ","], ["--what", "flow", "--apart", "99"]):
        with pytest.raises(dy.SettingsError, match=r"valid: flow, tracks|--apart 99: there are"):
            CliRunner().invoke(
                app, ["label", "ds", "--out", str(tmp_path / "x"), *words], catch_exceptions=False
            )
    assert not (tmp_path / "x").exists()


def test_example_of_the_page_runs(recorded, tmp_path, monkeypatch):
    (tmp_path / "data").symlink_to(recorded)
    shutil.copy(recorded.parent / "passage_world.py", tmp_path)
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "docs/truth.md").read_text(), re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(code, "docs/truth.md", "exec"), names)
    assert len(names["boxes"]) >= 3
    assert (tmp_path / "cloud.ply").stat().st_size > 1000
