"""Exports, each opened by a reader that is not this project's, and compared with the truth."""

import json
import resource
import sys
import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from evo.tools import file_interface
from folders import BASELINE_M, DISPARITY_PX, F_PX, wall, write_euroc
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from PIL import Image
from recordings import OFFICE, shared_recording
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation
from terminal import driftyard

import driftyard as dy
from trials.estimators.choice import Named, estimate
from trials.formats.registry import FORMATS, export
from vo.contract.errors import DatasetError, SettingsError
from vo.contract.remarks import Remark
from vo.recordings.pairing import FrameSelection
from vo.recordings.readers import open_sequence, read_truth

FRAMES = 4
pytestmark = [pytest.mark.gl, pytest.mark.slow]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return shared_recording(tmp_path_factory, "office", 5, OFFICE)


@pytest.fixture(scope="module")
def exported(dataset, tmp_path_factory):
    """Export the first frames in a format, once."""
    root, made = tmp_path_factory.mktemp("exports"), {}

    def make(name):
        if name not in made:
            made[name] = root / name
            assert export([dataset], name, made[name], FrameSelection(last=FRAMES - 1)) == FRAMES
        return made[name]

    return make


@pytest.fixture(scope="module")
def truth(dataset):
    """Rig, times and labels of the first frames, read from the files without this project."""
    sheet = yaml.safe_load((dataset / "mav0/cam0/sensor.yaml").read_text())
    right = yaml.safe_load((dataset / "mav0/cam1/sensor.yaml").read_text())
    T_body_cam, T_body_right = (np.reshape(x["T_BS"]["data"], (4, 4)) for x in (sheet, right))
    f, _, cx, cy = sheet["intrinsics"]
    rows, images = (
        [x.split(",") for x in lines(dataset / f"mav0/{name}/data.csv")]
        for name in ("state_groundtruth_estimate0", "cam0")
    )
    poses = {}
    for row in rows:
        T = np.eye(4)
        T[:3, 3] = [float(x) for x in row[1:4]]
        w, x, y, z = map(float, row[4:8])
        T[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
        poses[row[0]] = T @ T_body_cam
    chosen = [x[0] for x in images[:FRAMES]]
    depth = [cv2.imread(str(dataset / f"mav0/depth0/data/{x}.tiff"), -1) for x in chosen]
    baseline = np.linalg.norm(T_body_right[:3, 3] - T_body_cam[:3, 3])
    return {
        "K": np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]]),
        "baseline": baseline,
        "T_body_cam": T_body_cam,
        "times": [int(x) for x in chosen],
        "T_world_cam": np.array([poses[x] for x in chosen]),
        "depth": depth,
        "disparity": [f * baseline / x for x in depth],
        "left": [cv2.imread(str(dataset / f"mav0/cam0/data/{x}.png"), -1) for x in chosen],
        "right": [cv2.imread(str(dataset / f"mav0/cam1/data/{x}.png"), -1) for x in chosen],
        "hidden": [cv2.imread(str(dataset / f"mav0/occlusion0/data/{x}.png"), -1) for x in chosen],
        "flow": [
            cv2.imread(str(dataset / f"mav0/flow0/data/{x}.tiff"), -1)[..., ::-1] for x in chosen
        ],
    }


def read(path):
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, path
    return image


def lines(path):
    """Lines of a text without comments; empty ones stay, as COLMAP has them."""
    return [x for x in path.read_text().splitlines() if x[:1] != "#"]


def is_same(path, image):
    return np.array_equal(read(path), image)


def test_kitti_is_read_by_evo_and_opencv(exported, truth):
    out = exported("kitti")
    poses = np.array(file_interface.read_kitti_poses_file(out / "poses.txt").poses_se3)
    first = np.linalg.inv(truth["T_world_cam"][0])
    assert np.allclose(poses, first @ truth["T_world_cam"], atol=1e-9)
    times = [int(x.replace(".", "")) for x in (out / "times.txt").read_text().split()]
    assert times == truth["times"]
    rows = dict(x.split(": ") for x in (out / "calib.txt").read_text().splitlines())
    P = {key: np.reshape(row.split(), (3, 4)).astype(float) for key, row in rows.items()}
    assert np.allclose(P["P0"], np.c_[truth["K"], np.zeros(3)], rtol=1e-14)
    assert np.allclose(P["P1"][0, 3], -truth["K"][0, 0] * truth["baseline"])
    assert np.allclose(P["Tr"], np.linalg.inv(truth["T_body_cam"])[:3])
    for i in range(FRAMES):
        assert is_same(out / f"image_0/{i:06d}.png", truth["left"][i])
        assert is_same(out / f"image_1/{i:06d}.png", truth["right"][i])


@pytest.fixture(scope="module")
def there(dataset, tmp_path_factory):
    """The estimate on the dataset itself."""
    out = tmp_path_factory.mktemp("run") / "a.txt"
    return estimate(Named("driftyard"), dataset, out, frames=FrameSelection(last=9))


@pytest.mark.parametrize("name", ["kitti", "tartanair", "mcap"])
def test_estimate_on_an_export_is_that_on_the_dataset(dataset, there, name, tmp_path):
    export([dataset], name, tmp_path / name, FrameSelection(last=9))
    recording = tmp_path / name / (dataset.name if name == "mcap" else "")
    back = estimate(Named("driftyard"), recording, tmp_path / "b.txt")
    assert np.array_equal(there.trajectory.timestamps_ns, back.trajectory.timestamps_ns)
    difference = there.trajectory.T_ref_frame - back.trajectory.T_ref_frame
    # A baseline that differs in its last digit may exchange one match of a consensus.
    assert np.abs(difference).max() < 1e-4
    assert np.linalg.norm(back.trajectory.T_ref_frame[-1][:3, 3]) > 0.1
    expected, found = read_truth(dataset), read_truth(recording)
    if name == "mcap":
        wheels, true_wheels = open_sequence(recording).wheels, open_sequence(dataset).wheels
        for t in there.trajectory.timestamps_ns.tolist():
            assert wheels.at(t) == true_wheels.at(t)
    steps = [
        np.linalg.inv(x[0]) @ x
        for x in (expected.at(there.trajectory.timestamps_ns).T_ref_frame, found.T_ref_frame)
    ]
    assert np.abs(steps[0] - steps[1]).max() < 1e-9


def test_labels_of_tartanair_are_those_of_the_dataset(exported, dataset):
    """Within the rounding of flow to 1/64 px; an outline, which it does not know, is occluded."""
    ds, back = dy.open(dataset), dy.open(exported("tartanair"))
    assert back.labels == ("depth", "disparity", "flow", "covisibility")
    assert np.allclose(back.T_world_cam, ds.T_world_cam[:FRAMES], atol=1e-9)
    assert np.array_equal(back.depth(1), ds.depth(1), equal_nan=True)
    factor = ds.rig.f_px * ds.rig.baseline_m
    assert np.allclose(back.disparity(1), factor / ds.depth(1), rtol=1e-6, equal_nan=True)
    known = back.covisibility(1) != 3
    error = np.abs(back.flow(1) - ds.flow(1))[known][:, :2]
    assert error.max() <= 0.501 / 64
    codes = np.array([0, 1, 2, 0, 1])[ds.covisibility(1)]
    assert (back.covisibility(1) == codes).mean() > 0.999
    with pytest.raises(DatasetError, match="the last frame, 3, has no flow"):
        back.flow(FRAMES - 1)


def test_labels_of_other_tools_are_exported(exported, tmp_path, truth):
    assert export([exported("tartanair")], "sceneflow", tmp_path / "out") == FRAMES
    disparity = read(tmp_path / "out/disparity/tartanair/left/0001.pfm")
    assert np.allclose(disparity, truth["disparity"][1], rtol=1e-6, equal_nan=True)


def test_tum_is_read_by_evo_and_opencv(exported, truth):
    out = exported("tum")
    trajectory = file_interface.read_tum_trajectory_file(out / "groundtruth.txt")
    assert np.allclose(trajectory.poses_se3, truth["T_world_cam"], atol=2e-9)
    assert np.allclose(trajectory.timestamps, np.array(truth["times"]) / 1e9, atol=1e-9)
    pairs = [x.split() for x in (out / "associations.txt").read_text().splitlines()]
    for i, (stamp, image, same, depth) in enumerate(pairs):
        assert stamp == same
        assert int(stamp.replace(".", "")) == truth["times"][i]
        assert is_same(out / image, truth["left"][i])
        levels, metres = read(out / depth), truth["depth"][i]
        assert levels.dtype == np.uint16
        assert np.array_equal(levels == 0, np.isnan(metres) | (metres * 5000 > 65535.5))
        known = levels > 0
        assert np.abs(levels[known] / 5000 - metres[known]).max() <= 1.001e-4
    assert len(pairs) == FRAMES
    camera = cv2.FileStorage(str(out / "camera.yaml"), cv2.FILE_STORAGE_READ)
    assert camera.getNode("Camera.fx").real() == pytest.approx(truth["K"][0, 0])
    bf = truth["K"][0, 0] * truth["baseline"]
    assert camera.getNode("Camera.bf").real() == pytest.approx(bf)


def test_kitti_stereo_disparity_is_that_of_the_depth(exported, truth):
    out = exported("kitti_stereo") / "training"
    for i in range(FRAMES):
        levels, expected = read(out / f"disp_occ_0/{i:06d}_10.png"), truth["disparity"][i]
        assert levels.dtype == np.uint16
        assert np.array_equal(levels == 0, np.isnan(expected))
        known = levels > 0
        assert np.abs(levels[known] / 256 - expected[known]).max() <= 0.501 / 256
        seen = read(out / f"disp_noc_0/{i:06d}_10.png")
        assert np.array_equal(seen, np.where(truth["hidden"][i] == 0, levels, 0))
    # The right image shows a left pixel further left by its disparity.
    left, right = (read(out / f"image_{k}/000000_10.png").astype(float) for k in (2, 3))
    v, u = np.nonzero(read(out / "disp_noc_0/000000_10.png"))
    d = levels_to_px(read(out / "disp_noc_0/000000_10.png"))[v, u]
    inside = u + d < left.shape[1] - 1
    v, u, d = v[inside], u[inside], d[inside]
    residual = {
        sign: np.abs(left[v, u] - right[v, np.rint(u - sign * d).astype(int)]).mean()
        for sign in (1, -1)
    }
    assert residual[1] < 0.5 * residual[-1]


def levels_to_px(levels):
    return levels.astype(float) / 256


def test_middlebury_depth_follows_from_its_calibration(exported, truth):
    scenes = sorted(exported("middlebury").iterdir())
    assert len(scenes) == FRAMES
    for scene, depth, hidden in zip(scenes, truth["depth"], truth["hidden"], strict=True):
        lines = (scene / "calib.txt").read_text().splitlines()
        values = dict(x.split("=") for x in lines)
        K = np.array([x.split() for x in values["cam0"].strip("[]").split(";")], float)
        disparity = read(scene / "disp0.pfm")
        assert np.array_equal(np.isinf(disparity), np.isnan(depth))
        z_mm = float(values["baseline"]) * K[0, 0] / (disparity + float(values["doffs"]))
        known = np.isfinite(disparity)
        assert np.allclose(z_mm[known] / 1000, depth[known], rtol=1e-6)
        assert np.allclose(K, truth["K"])
        assert disparity[known].max() <= float(values["ndisp"])
        mask = read(scene / "mask0nocc.png")
        assert np.array_equal(mask == 255, (hidden == 0) & known)
    assert is_same(scenes[1] / "im1.png", truth["right"][1])


def test_sceneflow_holds_disparity_and_flow(exported, dataset, truth):
    out, name = exported("sceneflow"), dataset.name
    for i in range(FRAMES):
        disparity = read(out / f"disparity/{name}/left/{i:04d}.pfm")
        assert np.allclose(disparity, truth["disparity"][i], rtol=1e-6, equal_nan=True)
        assert is_same(out / f"frames_cleanpass/{name}/right/{i:04d}.png", truth["right"][i])
    flows = sorted((out / f"optical_flow/{name}/into_future/left").iterdir())
    assert len(flows) == FRAMES - 1
    assert np.array_equal(
        read(flows[1])[..., ::-1][..., :2], truth["flow"][1][..., :2], equal_nan=True
    )


def tartanair_pose(row):
    T = np.eye(4)
    T[:3, 3], T[:3, :3] = row[:3], Rotation.from_quat(row[3:]).as_matrix()
    return T


def test_tartanair_flow_follows_from_depth_and_poses(exported, truth):
    """Axes, encodings and signs agree: points of one frame, moved by the poses, end at the flow."""
    out = exported("tartanair")
    T_ned_cam = [tartanair_pose(x) for x in np.loadtxt(out / "pose_lcam_front.txt")]
    T_ned_right = tartanair_pose(np.loadtxt(out / "pose_rcam_front.txt")[0])
    right_of_left = np.linalg.inv(T_ned_cam[0]) @ T_ned_right
    assert np.allclose(right_of_left[:3, 3], [0, truth["baseline"], 0])  # y is to the right
    camera = json.loads((out / "camera.json").read_text())
    f, cx, cy = camera["fx"], camera["cx"], camera["cy"]
    depth = np.squeeze(read(out / "depth_lcam_front/000001_lcam_front_depth.png").view("<f4"), -1)
    sky = np.isnan(truth["depth"][1])
    assert np.array_equal(depth[~sky], truth["depth"][1][~sky])
    assert (depth[sky] == 10_000).all()
    encoded = read(out / "flow_lcam_front/000001_000002_flow.png")
    flow, mask = (encoded[..., :2].astype(float) - 32768) / 64, encoded[..., 2]
    assert mask.dtype == np.uint16
    v, u = np.nonzero((mask == 0) & ~sky)
    assert len(u) > 0.5 * depth.size
    z = depth[v, u].astype(float)
    points = np.stack([z, (u - cx) * z / f, (v - cy) * z / f, np.ones_like(z)])
    x, y, z, _ = np.linalg.inv(T_ned_cam[2]) @ T_ned_cam[1] @ points
    ends = np.stack([f * y / x + cx, f * z / x + cy], axis=-1)
    error = np.abs(ends - np.stack([u, v], axis=-1) - flow[v, u]).max(axis=-1)
    assert np.quantile(error, 0.99) < 0.02  # objects that move are few
    down = T_ned_cam[0][:3, :3] @ [0, 0, 1]
    assert down[2] > 0.5  # z of the world is down
    times = [int(x.replace(".", "")) for x in (out / "imu/cam_time.txt").read_text().split()]
    assert times == truth["times"]


def test_colmap_points_project_to_their_observations(exported, truth):
    out = exported("colmap")
    model = {x: lines(out / f"sparse/0/{x}.txt") for x in ("cameras", "images", "points3D")}
    cameras = {int(x.split()[0]): x.split()[4:] for x in model["cameras"]}
    points = {int(x.split()[0]): np.array(x.split()[1:4], float) for x in model["points3D"]}
    tracks = {int(x.split()[0]): x.split()[8:] for x in model["points3D"]}
    seen = 0
    for head, row in zip(model["images"][::2], model["images"][1::2], strict=True):
        number, *numbers, camera, name = head.split()
        w, x, y, z, *t = map(float, numbers)
        R = Rotation.from_quat([x, y, z, w]).as_matrix()
        i, eye = divmod(int(number) - 1, 2)
        assert (out / "images" / name).is_file()
        centre = truth["T_world_cam"][i] @ [truth["baseline"] * eye, 0, 0, 1]
        assert np.allclose(-R.T @ t, centre[:3], atol=1e-9)
        fx, fy, cx, cy = map(float, cameras[int(camera)])
        assert (cx, cy) == (truth["K"][0, 2] + 0.5, truth["K"][1, 2] + 0.5)
        for k, (u, v, point) in enumerate(np.reshape(row.split(), (-1, 3))):
            x, y, z = R @ points[int(point)] + t
            assert fx * x / z + cx == pytest.approx(float(u), abs=1e-4)
            assert fy * y / z + cy == pytest.approx(float(v), abs=1e-4)
            track = tracks[int(point)]
            assert dict(zip(track[::2], track[1::2], strict=True))[number] == str(k)
            seen += 1
    assert seen > 1.5 * len(points) > 0


def test_mcap_is_read_by_its_own_reader_and_by_rosbags(exported, dataset, truth):
    bag = exported("mcap") / dataset.name
    found = {}
    with (bag / f"{dataset.name}.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, raw, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((raw.log_time, message))
    f, baseline = truth["K"][0, 0], truth["baseline"]
    for i, time in enumerate(truth["times"]):
        for eye in ("left", "right"):
            stamped, image = found[f"/stereo/{eye}/image_rect"][i]
            assert stamped == time == image.header.stamp.sec * 10**9 + image.header.stamp.nanosec
            pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)
            assert image.encoding == "mono8"
            assert np.array_equal(pixels, truth[eye][i])
            info = found[f"/stereo/{eye}/camera_info"][i][1]
            assert np.allclose(np.reshape(info.k, (3, 3)), truth["K"])
            assert info.p[3] == pytest.approx(-f * baseline if eye == "right" else 0)
        disparity = found["/stereo/disparity"][i][1]
        values = np.frombuffer(disparity.image.data, np.float32).reshape(truth["left"][i].shape)
        valid = values >= disparity.min_disparity
        assert np.array_equal(valid, ~np.isnan(truth["depth"][i]))
        z = disparity.f * disparity.t / values[valid]
        assert np.allclose(z, truth["depth"][i][valid], rtol=1e-5)
        T_world_body = truth["T_world_cam"][i] @ np.linalg.inv(truth["T_body_cam"])
        odometry, (transform,) = (
            found["/ground_truth/odometry"][i][1],
            found["/tf"][i][1].transforms,
        )
        for place in (odometry.pose.pose.position, transform.transform.translation):
            assert np.allclose([place.x, place.y, place.z], T_world_body[:3, 3])
        turn = transform.transform.rotation
        R = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
        assert np.allclose(R, T_world_body[:3, :3])
    names = {x.child_frame_id: x.transform for x in found["/tf_static"][0][1].transforms}
    gap = np.subtract(
        *(
            [x.translation.x, x.translation.y, x.translation.z]
            for x in (names["left_camera"], names["right_camera"])
        )
    )
    assert np.linalg.norm(gap) == pytest.approx(baseline)
    table = np.loadtxt(dataset / "mav0/imu0/data.csv", delimiter=",", skiprows=1)
    within = (table[:, 0] >= truth["times"][0]) & (table[:, 0] <= truth["times"][-1])
    rows = [
        (t, m.angular_velocity.x, m.linear_acceleration.z, m.orientation_covariance[0])
        for t, m in found["/imu"]
    ]
    expected = np.c_[table[within][:, [0, 1, 6]], -np.ones(within.sum())]
    assert np.allclose(rows, expected)
    with AnyReader([bag]) as reader:
        kinds = {x.topic: x.msgtype for x in reader.connections}
        assert reader.message_count == sum(map(len, found.values()))
    assert kinds["/stereo/disparity"] == "stereo_msgs/msg/DisparityImage"


def test_webdataset_samples_are_runs_of_one_name(exported, dataset, truth):
    (path,) = exported("webdataset").iterdir()
    samples = {}
    with tarfile.open(path) as shard:
        for entry in shard:
            key, suffix = entry.name.split(".", 1)
            assert key in list(samples)[-1:] or key not in samples  # not resumed later
            samples.setdefault(key, {})[suffix] = shard.extractfile(entry).read()
    assert len(samples) == FRAMES
    for i, sample in enumerate(samples.values()):
        about = json.loads(sample["json"])
        assert about["timestamp_ns"] == truth["times"][i]
        assert np.allclose(about["T_world_cam"], truth["T_world_cam"][i])
        assert np.allclose(about["K"], truth["K"])
        image = cv2.imdecode(np.frombuffer(sample["right.png"], np.uint8), -1)
        assert np.array_equal(image, truth["right"][i])
        head, _, data = sample["depth.npy"].partition(b"\n")
        assert b"'<f4'" in head
        depth = np.frombuffer(data, "<f4").reshape(truth["depth"][i].shape)
        assert np.array_equal(depth, truth["depth"][i], equal_nan=True)
        assert ("flow.npy" in sample) == (i < FRAMES - 1)


def test_huggingface_card_and_columns(exported, truth, dataset):
    out = exported("huggingface")
    _, head, card = (out / "README.md").read_text().split("---\n", 2)
    front = yaml.safe_load(head)
    assert front["license"] == "mit"
    assert front["configs"][0]["data_files"] == [{"split": "train", "path": "train/**"}]
    assert f"figures/{dataset.name}.png" in card
    assert (out / f"figures/{dataset.name}.png").is_file()
    rows = [json.loads(x) for x in (out / "train/metadata.jsonl").read_text().splitlines()]
    assert len(rows) == FRAMES
    for i, row in enumerate(rows):
        left, depth = (
            np.array(Image.open(out / "train" / row[f"{x}_file_name"])) for x in ("left", "depth")
        )
        assert np.array_equal(left, truth["left"][i])
        assert np.array_equal(depth, truth["depth"][i], equal_nan=True)
        assert np.allclose(row["T_world_cam"], truth["T_world_cam"][i])


@pytest.fixture
def street(tmp_path):
    """A recording of other origin without labels; its truth is 50 mm a frame along x."""
    return write_euroc(tmp_path / "street", wall(3), truth_step_m=0.05)


def test_export_of_other_recordings_and_many_at_once(street, tmp_path):
    other = write_euroc(tmp_path / "other", wall(2, seed=1), truth_step_m=0.05)
    result = driftyard("export", street, other, "--to", "kitti", "--out", "o", cwd=tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    assert "5 frames" in result.stdout
    poses = np.loadtxt(tmp_path / "o/street/poses.txt").reshape(-1, 3, 4)
    assert np.allclose(poses[:, 0, 3], [0, 0.05, 0.1])
    assert len(np.loadtxt(tmp_path / "o/other/times.txt")) == 2
    result = driftyard("export", street, other, "--to", "huggingface", "--out", "h", cwd=tmp_path)
    assert result.returncode == 0
    assert len((tmp_path / "h/test/metadata.jsonl").read_text().splitlines()) == 2
    assert "license: unknown" in (tmp_path / "h/README.md").read_text()


def test_export_in_python_takes_folders_and_chosen_frames(street, tmp_path):
    chosen = dy.open(street, first=1)
    assert dy.export(chosen, "kitti", tmp_path / "a") == tmp_path / "a"
    assert len(dy.open(tmp_path / "a")) == 2
    dy.export(str(street), "kitti", str(tmp_path / "b"))
    assert len(dy.open(tmp_path / "b")) == 3
    for datasets, said in ((), "no dataset"), ((chosen, street), "the chosen frames differ"):
        with pytest.raises(dy.SettingsError, match=said):
            dy.export(datasets, "kitti", tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_export_frames_beyond_the_truth_are_left_out(street, tmp_path):
    table = street / "mav0/state_groundtruth_estimate0/data.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:-1]))
    export([street], "webdataset", tmp_path / "w")
    with tarfile.open(tmp_path / "w/street-000000.tar") as shard:
        about = json.load(shard.extractfile("street_000002.json"))
    assert about["T_world_cam"] is None
    with pytest.warns(Remark, match="street: 1 frames have no true pose and are left out"):
        assert export([street], "kitti", tmp_path / "o") == 2
    assert len(list((tmp_path / "o/image_1").iterdir())) == 2


def test_mcap_without_truth_has_images_only(tmp_path):
    plain = write_euroc(tmp_path / "plain", wall(2))
    with pytest.warns(Remark, match="plain: has no ground truth"):
        export([plain], "mcap", tmp_path / "o")
    with AnyReader([tmp_path / "o/plain"]) as reader:
        topics = {x.topic for x in reader.connections}
        (right,) = (x for x in reader.connections if x.topic == "/stereo/right/camera_info")
        _, _, raw = next(reader.messages([right]))
        info = reader.deserialize(raw, right.msgtype)
    assert "/ground_truth/odometry" not in topics
    assert info.p[3] == pytest.approx(-F_PX * BASELINE_M)
    assert DISPARITY_PX > 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--to", "kity"), f"no format 'kity'; the formats are {', '.join(FORMATS)}"),
        (("--to", "tum"), "street: has no labels of depth or disparity"),
        (("--to", "kitti", "--out", "street"), "street: already exists"),
        (("--to", "kitti", "--out", "file/o"), "file/o: cannot be written (Not a directory)"),
        (("--to", "kitti", "--out", "/proc/o"), "/proc/o: cannot be written"),
        (("--to", "tum", "--out", "new/folder/o"), "street: has no labels of depth"),
        (("--to", "kitti", "--first", "9"), "frames 9 to 2"),
        (("street", "--to", "kitti"), "street: two datasets have this name"),
        (("nowhere", "--to", "kitti"), "nowhere: no such folder"),
    ],
)
def test_export_bad_input_is_one_line_and_leaves_nothing(street, tmp_path, words, said):
    (tmp_path / "file").write_text("")
    before = sorted(tmp_path.iterdir())
    given = words if "--out" in words else (*words, "--out", "o")
    result = driftyard("export", "street", *given, cwd=tmp_path)
    assert result.returncode == 2
    (line,) = (x for x in result.stderr.splitlines() if "remark" not in x)
    assert said in line
    assert line.startswith("driftyard: error: ")
    assert sorted(tmp_path.iterdir()) == before


def test_export_without_truth_names_what_is_missing(tmp_path):
    plain = write_euroc(tmp_path / "plain", wall(2))
    with pytest.raises(DatasetError, match="plain: has no ground truth; this format needs true"):
        export([plain], "colmap", tmp_path / "o")
    assert [x.name for x in tmp_path.iterdir()] == ["plain"]


def test_export_malformed_manifest_is_named(street, tmp_path):
    (street / "dataset.json").write_text('{"schema_version": 1, "scene": 3}')
    with pytest.raises(DatasetError, match=r"street/dataset\.json: scene is malformed"):
        export([street], "webdataset", tmp_path / "o")
    assert not (tmp_path / "o").exists()


def test_mcap_without_rosbags_says_what_to_install(street, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(SettingsError, match=r"pip install 'driftyard\[mcap\]'"):
        export([street], "mcap", tmp_path / "o")
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("name", ["kitti", "mcap", "webdataset"])
def test_export_without_space_names_the_folder(street, tmp_path, name):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4000, limits[1]))
    try:
        with pytest.raises(DatasetError, match=r"/o: cannot be written \(File too large\)"):
            export([street], name, tmp_path / "o")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert [x.name for x in tmp_path.iterdir()] == ["street"]


def test_export_damaged_image_is_named(street, tmp_path):
    image = next(iter((street / "mav0/cam1/data").iterdir()))
    image.write_bytes(image.read_bytes()[:-20])
    with pytest.raises(DatasetError, match=rf"{image.name}: the PNG is truncated"):
        export([street], "webdataset", tmp_path / "o")
    assert not (tmp_path / "o").exists()
    with pytest.raises(SettingsError, match="the formats are kitti, "):
        export([Path(street)], "", tmp_path / "o")
