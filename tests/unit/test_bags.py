"""Bags of ROS 1 and 2, written message by message, against the same recordings as folders."""

import pickle
import sys
import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from bags import LATE_NS, BagWriter, rectified_infos
from folders import BASELINE_M, F_PX, HEIGHT, PERIOD_NS, WIDTH, wall, write_euroc
from rosbags.rosbag2 import StoragePlugin
from scipy.spatial.transform import Rotation
from terminal import driftyard

import driftyard as dy
from vo.contract.errors import CalibrationError, DatasetError, ImageError, SettingsError
from vo.contract.remarks import Remark
from vo.recordings.readers import open_sequence, read_imu, read_truth

PAIRS = wall(3)
SIZE = (WIDTH, HEIGHT)
TIMES = [(i + 1) * PERIOD_NS for i in range(len(PAIRS))]
EYES = ("/cam0/image_raw", "/cam1/image_raw")
INFOS = ("/cam0/camera_info", "/cam1/camera_info")


def write_pairs(bag, topics=EYES, pairs=PAIRS, **changes):
    for t, pair in zip(TIMES, pairs, strict=True):
        for topic, image in zip(topics, pair, strict=True):
            bag.image(topic, t, image, **changes)


def simple_bag(path, **changes):
    with BagWriter(path) as bag:
        rectified_infos(bag, INFOS, SIZE)
        write_pairs(bag, **changes)
    return path


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return simple_bag(tmp_path_factory.mktemp("bag") / "run.mcap")


@pytest.mark.parametrize("name", ["run.bag", "run.mcap", "run.db3", "sqlite3", "mcap"])
def test_frames_are_those_of_the_folder(tmp_path, name):
    euroc = open_sequence(write_euroc(tmp_path / "euroc", PAIRS))
    storage = StoragePlugin.MCAP if name == "mcap" else StoragePlugin.SQLITE3
    with BagWriter(tmp_path / name, storage) as bag:
        rectified_infos(bag, INFOS, SIZE)
        write_pairs(bag)
    sequence = open_sequence(tmp_path / name)
    assert sequence.timestamps_ns.tolist() == TIMES  # of the headers, not of receipt
    assert sequence.rig.K.tolist() == euroc.rig.K.tolist()
    assert sequence.rig.baseline_m == pytest.approx(BASELINE_M, rel=1e-14)
    for i in (2, 0, 1, 1):  # also against the order of the bag
        assert np.array_equal(sequence[i].left, euroc[i].left)
        assert np.array_equal(sequence[i].right, euroc[i].right)


GREY = PAIRS[0][0]
COLOUR = np.dstack([GREY, np.roll(GREY, 3, 0), np.roll(GREY, 5, 1)])  # B, G, R
DEEP = GREY.astype(np.uint16) * 257


def mosaic(pattern):
    channels = {"B": COLOUR[..., 0], "G": COLOUR[..., 1], "R": COLOUR[..., 2]}
    out = GREY.copy()
    for k, letter in enumerate(pattern.upper()):
        out[k // 2 :: 2, k % 2 :: 2] = channels[letter][k // 2 :: 2, k % 2 :: 2]
    return out


LUMA = cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY)
ENCODINGS = {
    "mono8": (GREY, GREY, 0),
    "8UC1": (GREY, GREY, 0),
    "mono16": (DEEP, GREY, 0),
    "bgr8": (COLOUR, LUMA, 0),
    "rgb8": (COLOUR[..., ::-1], LUMA, 0),
    "bgra8": (np.dstack([COLOUR, GREY]), LUMA, 0),
    "rgba8": (np.dstack([COLOUR[..., ::-1], GREY]), LUMA, 0),
    "yuv422": (np.dstack([GREY // 2, GREY]), GREY, 0),
    "yuv422_yuy2": (np.dstack([GREY, GREY // 2]), GREY, 0),
    **{f"bayer_{x}8": (mosaic(x), LUMA, 12) for x in ("rggb", "bggr", "gbrg", "grbg")},
}


@pytest.mark.filterwarnings("ignore::vo.contract.remarks.Remark")
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_encodings_become_the_grey_image(tmp_path, encoding):
    pixels, expected, tolerance = ENCODINGS[encoding]
    pairs = [(pixels, pixels)] * len(PAIRS)
    path = simple_bag(tmp_path / "run.bag", pairs=pairs, encoding=encoding)
    found = open_sequence(path)[1].left[4:-4, 4:-4].astype(int)
    assert np.median(np.abs(found - expected[4:-4, 4:-4])) <= tolerance


def test_bayer_patterns_are_told_apart(tmp_path):
    red = np.zeros((HEIGHT, WIDTH), np.uint8)
    red[::2, ::2] = 200  # of rggb, the red pixels
    for pattern, weight in (("rggb", 0.299), ("bggr", 0.114)):
        path = tmp_path / f"{pattern}.bag"
        simple_bag(path, pairs=[(red, red)] * len(PAIRS), encoding=f"bayer_{pattern}8")
        assert open_sequence(path)[0].left[8:-8, 8:-8].mean() == pytest.approx(200 * weight, abs=3)


def test_big_endian_and_padded_rows_are_read(tmp_path):
    padded = np.zeros((HEIGHT, WIDTH + 9), np.uint16)
    padded[:, :WIDTH] = DEEP
    big = padded.astype(">u2").view(np.uint16)
    changes = {"encoding": "mono16", "is_bigendian": 1, "width": WIDTH}
    path = simple_bag(tmp_path / "run.bag", pairs=[(big, big)] * len(PAIRS), **changes)
    with pytest.warns(Remark, match="16 bits"):
        sequence = open_sequence(path)
    assert np.array_equal(sequence[0].left, GREY)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_compressed_images_are_decoded(tmp_path, suffix):
    with BagWriter(tmp_path / "run.mcap") as bag:
        rectified_infos(bag, ("/left/camera_info", "/right/camera_info"), SIZE)
        for t, pair in zip(TIMES, PAIRS, strict=True):
            for side, image in zip(("left", "right"), pair, strict=True):
                data = cv2.imencode(suffix, image)[1].ravel()
                message = bag.make(
                    "sensor_msgs/CompressedImage", header=bag.header(t), format="x", data=data
                )
                bag.write(f"/{side}/image_raw/compressed", t, message)
    sequence = open_sequence(tmp_path / "run.mcap")
    error = np.abs(sequence[1].right.astype(int) - PAIRS[1][1])
    assert error.max() == 0 if suffix == ".png" else np.median(error) < 8


def distorted(tmp_path):
    """A folder with a distorted pair of cameras that are turned to each other, and its matrices."""
    K = np.array([[F_PX, 0, 118.0], [0, 1.01 * F_PX, 91.0], [0, 0, 1]])
    D = [-0.1, 0.01, 0.001, -0.002]
    T_left_right = np.eye(4)
    T_left_right[:3, :3] = Rotation.from_euler("xyz", [0.01, -0.02, 0.015]).as_matrix()
    T_left_right[:3, 3] = [BASELINE_M, 0.002, -0.001]
    folder = write_euroc(tmp_path / "euroc", PAIRS, K, D, (np.eye(4), T_left_right))
    return folder, K, D, T_left_right


def test_raw_images_are_rectified_by_camera_info(tmp_path):
    folder, K, D, T_left_right = distorted(tmp_path)
    T = np.linalg.inv(T_left_right)
    R_left, R_right, P_left, P_right = cv2.stereoRectify(
        K, np.array(D), K, np.array(D), SIZE, T[:3, :3], T[:3, 3:]
    )[:4]
    with BagWriter(tmp_path / "run.mcap") as bag:
        for topic, R, P in zip(INFOS, (R_left, R_right), (P_left, P_right), strict=True):
            bag.info(topic, SIZE, K, [*D, 0], R, P)
        write_pairs(bag)
    expected, found = open_sequence(folder), open_sequence(tmp_path / "run.mcap")
    assert found.rig.baseline_m == pytest.approx(expected.rig.baseline_m)
    assert np.allclose(found.rig.K, expected.rig.K, atol=1e-6)
    assert np.abs(found[1].right.astype(int) - expected[1].right).max() <= 1


def test_calibration_beside_the_bag_is_used(tmp_path):
    folder, K, D, T_left_right = distorted(tmp_path)
    camera = {
        "camera_model": "pinhole",
        "intrinsics": [float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])],
        "distortion_model": "radtan",
        "distortion_coeffs": D,
        "resolution": list(SIZE),
    }
    right = camera | {"T_cn_cnm1": np.linalg.inv(T_left_right).tolist()}
    (tmp_path / "camchain.yaml").write_text(yaml.safe_dump({"cam0": camera, "cam1": right}))
    with BagWriter(tmp_path / "run.bag") as bag:
        write_pairs(bag)
    with pytest.warns(Remark, match=r"run.bag: has no camera_info; .*camchain\.yaml"):
        found = open_sequence(tmp_path / "run.bag")
    assert np.array_equal(found[0].right, open_sequence(folder)[0].right)
    (tmp_path / "camchain.yaml").unlink()
    with pytest.raises(CalibrationError, match=r"run\.bag: has no calibration of /cam0/image_raw"):
        open_sequence(tmp_path / "run.bag")


def test_baseline_of_tf_replaces_a_missing_one(tmp_path):
    T = np.eye(4)
    T[0, 3] = BASELINE_M
    with BagWriter(tmp_path / "run.mcap") as bag:
        rectified_infos(bag, INFOS, SIZE, baseline_m=0.0)
        bag.transform("/tf_static", TIMES[0], "cam0_frame", "cam1_frame", T)
        write_pairs(bag)
    assert open_sequence(tmp_path / "run.mcap").rig.baseline_m == pytest.approx(BASELINE_M)


def test_missing_topics_are_answered_with_those_there_are(tmp_path, bag):
    with pytest.raises(DatasetError, match=r"run\.mcap: topic /nix is not there; left .*; topics:"):
        open_sequence(Path(f"{bag}@left=/nix"))
    with pytest.raises(DatasetError, match=r"/cam0/camera_info is of sensor_msgs/CameraInfo; left"):
        open_sequence(Path(f"{bag}@left=/cam0/camera_info"))
    with pytest.raises(SettingsError, match="lft: expected left, right, left_info"):
        open_sequence(Path(f"{bag}@lft=/cam0/image_raw"))
    path = simple_bag(tmp_path / "mono.bag", topics=("/up/image", "/down/image"))
    message = r"no two topics .*mono\.bag@left=TOPIC,right=TOPIC; topics: .*/up/image \(sensor"
    with pytest.raises(DatasetError, match=message):
        open_sequence(path)


def test_topics_are_chosen_by_the_name_of_the_recording(tmp_path):
    with BagWriter(tmp_path / "run.bag") as bag:
        rectified_infos(bag, ("/rig/a/calibration", "/rig/b/calibration"), SIZE)
        write_pairs(bag, ("/rig/a/picture", "/rig/b/picture"))
    topics = "left=/rig/a/picture,right=/rig/b/picture"
    infos = "left_info=/rig/a/calibration,right_info=/rig/b/calibration"
    ds = dy.open(f"{tmp_path}/run.bag@{topics},{infos}")
    assert ds.name == "run"
    assert np.array_equal(ds[2].right, PAIRS[2][1])
    assert np.array_equal(pickle.loads(pickle.dumps(ds))[2].right, PAIRS[2][1])


def test_rectified_images_are_preferred_and_others_named(tmp_path):
    with BagWriter(tmp_path / "run.bag") as bag:
        for rig in ("/front", "/rear"):
            rectified_infos(bag, [f"{rig}/{x}/camera_info" for x in ("left", "right")], SIZE)
            for name in ("image_raw", "image_rect", "depth"):
                write_pairs(bag, [f"{rig}/{x}/{name}" for x in ("left", "right")])
    with pytest.warns(Remark, match="left is /front/left/image_rect; there are also pairs in /rea"):
        open_sequence(tmp_path / "run.bag")


def test_times_of_receipt_replace_empty_headers(tmp_path):
    path = simple_bag(tmp_path / "run.bag", stamp_ns=0)
    with pytest.warns(Remark, match="headers without a time; times are those of receipt"):
        assert open_sequence(path).timestamps_ns[0] == TIMES[0] + LATE_NS


def test_repeated_and_late_messages_are_put_in_order(tmp_path):
    with BagWriter(tmp_path / "run.bag") as bag:
        rectified_infos(bag, INFOS, SIZE)
        for i in (2, 0, 1, 1):
            for topic, image in zip(EYES, PAIRS[i], strict=True):
                bag.image(topic, TIMES[i], image)
    with pytest.warns(Remark, match="1 messages with the time of another, left out"):
        sequence = open_sequence(tmp_path / "run.bag")
    assert sequence.timestamps_ns.tolist() == TIMES
    assert all(np.array_equal(sequence[i].left, PAIRS[i][0]) for i in range(3))


def body(i):
    T = np.eye(4)
    T[:3, 3], T[:3, :3] = [i, 2, 3], Rotation.from_euler("z", 0.1 * i).as_matrix()
    return T


T_BODY_CAM, T_BODY_MARKER = np.eye(4), np.eye(4)
T_BODY_CAM[:3, :3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
T_BODY_CAM[:3, 3], T_BODY_MARKER[:3, 3] = [0.1, 0.2, 0.3], [0, 0, 0.5]


def posed_bag(path):
    """Poses of the body in tf, and of a marker, a camera and an odometry in topics."""
    with BagWriter(path) as bag:
        rectified_infos(bag, INFOS, SIZE)
        bag.transform("/tf_static", TIMES[0], "base_link", "cam0_frame", T_BODY_CAM)
        bag.transform("/tf_static", TIMES[0], "base_link", "marker", T_BODY_MARKER)
        write_pairs(bag)
        for i, t in enumerate(TIMES):
            bag.transform("/tf", t, "map", "odom", body(-i))
            bag.transform("/tf", t, "odom", "base_link", body(2 * i))
            bag.pose_stamped("/amcl", t, body(i))
            values = {
                "header": bag.header(t, "world"),
                "child_frame_id": "marker",
                "pose": bag.make(
                    "geometry_msgs/PoseWithCovariance",
                    pose=bag.pose(body(i) @ T_BODY_MARKER),
                    covariance=np.zeros(36),
                ),
                "twist": bag.make(
                    "geometry_msgs/TwistWithCovariance",
                    twist=bag.make(
                        "geometry_msgs/Twist",
                        linear=bag.make("geometry_msgs/Vector3", x=0.0, y=0.0, z=0.0),
                        angular=bag.make("geometry_msgs/Vector3", x=0.0, y=0.0, z=0.0),
                    ),
                    covariance=np.zeros(36),
                ),
            }
            bag.write("/mocap/odometry", t, bag.make("nav_msgs/Odometry", **values))
            point = bag.make("geometry_msgs/Point", x=float(i), y=0.0, z=0.0)
            message = {"header": bag.header(t, "world"), "point": point}
            bag.write("/prism", t, bag.make("geometry_msgs/PointStamped", **message))
    return path


@pytest.fixture(scope="module", params=["run.bag", "run.mcap"])
def posed(request, tmp_path_factory):
    return posed_bag(tmp_path_factory.mktemp("posed") / request.param)


def test_truth_is_that_of_the_frame_that_messages_name(posed):
    expected = np.array([body(i) @ T_BODY_CAM for i in range(3)])
    truth = read_truth(posed)
    assert truth.timestamps_ns.tolist() == TIMES
    assert np.allclose(truth.T_ref_frame, expected, atol=1e-12)
    assert np.allclose(open_sequence(posed).rig.T_body_cam, T_BODY_CAM)
    with pytest.warns(Remark, match="/amcl: poses are taken for those of the body"):
        assert np.allclose(read_truth(Path(f"{posed}@truth=/amcl")).T_ref_frame, expected)
    chained = [body(-i) @ body(2 * i) @ T_BODY_CAM for i in range(3)]
    assert np.allclose(read_truth(Path(f"{posed}@truth=/tf")).T_ref_frame, chained)
    with pytest.warns(Remark, match="/prism: has positions only"):
        assert read_truth(Path(f"{posed}@truth=/prism")).point_cam is not None


def test_odometry_is_no_truth_unless_it_is_chosen(tmp_path):
    with BagWriter(tmp_path / "run.bag") as bag:
        rectified_infos(bag, INFOS, SIZE)
        write_pairs(bag)
        bag.pose_stamped("/amcl", TIMES[0], body(0))
    with pytest.warns(Remark, match=r"choose .*run\.bag@truth=TOPIC; .* poses: /amcl"):
        assert not dy.open(tmp_path / "run.bag").has_poses


def test_inertial_readings_are_read(tmp_path):
    with BagWriter(tmp_path / "run.bag") as bag:
        rectified_infos(bag, INFOS, SIZE)
        bag.transform("/tf_static", TIMES[0], "cam0_frame", "unit", T_BODY_MARKER)
        write_pairs(bag)
        for t in TIMES:
            values = {
                "header": bag.header(t, "unit"),
                "orientation": bag.pose(np.eye(4)).orientation,
                "angular_velocity": bag.make("geometry_msgs/Vector3", x=1.0, y=2.0, z=3.0),
                "linear_acceleration": bag.make("geometry_msgs/Vector3", x=0.0, y=0.0, z=9.81),
            }
            values |= {
                f"{x}_covariance": np.zeros(9)
                for x in ("orientation", "angular_velocity", "linear_acceleration")
            }
            bag.write("/imu0", t, bag.make("sensor_msgs/Imu", **values))
    imu = read_imu(tmp_path / "run.bag")
    assert imu.timestamps_ns.tolist() == TIMES
    assert imu.gyro_radps[1].tolist() == [1, 2, 3]
    assert np.allclose(imu.accel_mps2[:, 2], 9.81)
    assert np.allclose(imu.T_body_imu, T_BODY_MARKER)


@pytest.mark.filterwarnings("ignore:.*common pairs")
def test_damaged_bags_are_named(tmp_path, bag):
    data = bag.read_bytes()
    for name, content in (
        ("empty.mcap", b""),
        ("text.bag", b"hello"),
        ("short.mcap", data[: len(data) // 2]),
        ("text.db3", b"hello"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(DatasetError, match=rf"^{tmp_path}/{name}: .*cannot be read \("):
            open_sequence(tmp_path / name)
    (tmp_path / "holes.mcap").write_bytes(data[:100_000] + bytes(80_000) + data[180_000:])
    with pytest.warns(Remark, match="messages can be read: the bag is damaged"):
        open_sequence(tmp_path / "holes.mcap")
    with pytest.raises(DatasetError, match=r"gone\.bag: no such file"):
        open_sequence(tmp_path / "gone.bag")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "run.bag").write_bytes(b"hello")
    with pytest.raises(DatasetError, match=r"folder: not a recording; .*run\.bag is one"):
        open_sequence(tmp_path / "folder")


def test_wheels_are_the_joints_that_are_named_so(tmp_path):
    with BagWriter(tmp_path / "run.bag") as bag:
        rectified_infos(bag, INFOS, SIZE)
        write_pairs(bag)
        nothing = np.zeros(0)
        for t, names, angles in (
            (TIMES[0], ["wheel_left_joint", "arm", "wheel_right_joint"], [0.0, 9.0, 2 * np.pi]),
            (TIMES[0] + 1, ["arm"], [1.0]),
            (TIMES[1], ["wheel_left_joint", "wheel_right_joint"], [np.pi, -np.pi]),
            (TIMES[2], ["wheel_left_joint", "wheel_right_joint"], [np.nan, 0.0]),
        ):
            values = {"header": bag.header(t), "name": names, "position": np.array(angles)}
            message = bag.make("sensor_msgs/JointState", **values, velocity=nothing, effort=nothing)
            bag.write("/joint_states", t, message)
    frames = list(open_sequence(tmp_path / "run.bag"))
    assert [x.wheel_ticks for x in frames] == [(0, 2000), (1000, -1000), (1000, -1000)]


def test_damaged_image_costs_its_frame(tmp_path):
    with BagWriter(tmp_path / "run.bag") as bag:
        rectified_infos(bag, INFOS, SIZE)
        write_pairs(bag, pairs=PAIRS)
        for topic, image in zip(EYES, PAIRS[0], strict=True):
            bag.image(topic, 4 * PERIOD_NS, image, height=HEIGHT + 1)
    sequence = open_sequence(tmp_path / "run.bag")
    with pytest.raises(
        ImageError, match=r"run\.bag/cam0/image_raw/400000000: 43200 bytes for 240x"
    ):
        sequence[3]
    with pytest.warns(Remark, match="1 of 4 frames are lost by such images"):
        run = dy.run(tmp_path / "run.bag", "corner_flow", tmp_path / "run.txt")
    assert [x.value for x in run.frames.status][-1] == "lost"


def test_unknown_encoding_lists_the_known_ones(tmp_path):
    path = simple_bag(tmp_path / "run.bag", encoding="32FC1")
    with pytest.raises(ImageError, match="encoding 32FC1; expected one of mono8"):
        open_sequence(path)


def test_missing_package_names_the_extra(bag, monkeypatch):
    for name in [x for x in sys.modules if x.partition(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    bag.touch()  # it was opened before
    with pytest.raises(DatasetError, match=r"need the package rosbags: pip install 'driftyard\[mc"):
        open_sequence(bag)


def test_bags_are_not_held_in_memory(tmp_path):
    frames, image = 48, np.zeros((480, 640), np.uint8)
    with BagWriter(tmp_path / "run.bag") as bag:
        rectified_infos(bag, INFOS, (640, 480))
        for i in range(frames):
            for topic in EYES:
                bag.image(topic, (i + 1) * PERIOD_NS, image)
    tracemalloc.start()
    sequence = open_sequence(tmp_path / "run.bag")
    assert sum(1 for _ in sequence) == frames
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 0.3 * (tmp_path / "run.bag").stat().st_size


def test_runs_scores_and_reports_of_a_bag(tmp_path):
    bag = Path(f"{posed_bag(tmp_path / 'run.mcap')}@truth=/tf")
    run = dy.run(bag, "corner_flow", tmp_path / "run.txt")
    assert dy.score(bag, run).compared == len(PAIRS)
    assert dy.report(bag, [run], tmp_path / "report.html").is_file()
    assert f"{bag}" in run.about["dataset"]
    table = driftyard("score", bag, "run.txt", cwd=tmp_path).stdout
    assert table.split()[0] == "run"
