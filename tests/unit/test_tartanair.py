"""TartanAir's folders as published, V1 and V2, written by hand."""

import json

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import driftyard as dy
from vo.contract.errors import CalibrationError, DatasetError, ImageError, TrajectoryError
from vo.contract.remarks import Remark
from vo.recordings.readers import open_sequence, read_truth

V1 = {"left": "image_left", "right": "image_right", "pose": "pose_left.txt", "size": (640, 480)}
V2 = {
    "left": "image_lcam_front",
    "right": "image_rcam_front",
    "pose": "pose_lcam_front.txt",
    "size": (640, 640),
}
FRAMES = 2


def write(folder, layout, size=None):
    """Two frames; the camera looks north and drives north by 1 m, then has turned to the east."""
    width, height = size or layout["size"]
    for side in ("left", "right"):
        eye = folder / layout[side]
        eye.mkdir(parents=True)
        for i in range(FRAMES):
            end = layout[side].removeprefix("image_")
            cv2.imwrite(str(eye / f"{i:06d}_{end}.png"), np.full((height, width), 40 * i, np.uint8))
    turned = Rotation.from_euler("z", 90, degrees=True).as_quat()  # NED: about the axis down
    rows = [[0, 0, 0, 0, 0, 0, 1], [1, 0, -0.5, *turned]]
    np.savetxt(folder / layout["pose"], rows)
    return folder


@pytest.fixture
def v1(tmp_path):
    return write(tmp_path / "P000", V1)


@pytest.fixture
def v2(tmp_path):
    folder = write(tmp_path / "P001", V2)
    (folder / "imu").mkdir()
    np.save(folder / "imu" / "cam_time.npy", np.array([0.0, 0.1], np.float32))
    return folder


def test_v1_has_the_published_calibration_at_10_hz(v1):
    with pytest.warns(Remark, match=r"has no imu/cam_time\.txt; frames are taken at 10 Hz"):
        sequence = open_sequence(v1)
    rig = sequence.rig
    assert (rig.f_px, rig.cx_px, rig.cy_px, rig.baseline_m) == (320, 320, 240, 0.25)
    assert sequence.timestamps_ns.tolist() == [0, 100_000_000]
    assert sequence[1].right.mean() == 40


def test_v2_has_its_calibration_and_times(v2):
    sequence = open_sequence(v2)
    rig = sequence.rig
    assert (rig.f_px, rig.cx_px, rig.cy_px, rig.baseline_m) == (320, 320, 320, 0.25)
    assert np.allclose(sequence.timestamps_ns, [0, 100_000_000], atol=2)


def test_poses_become_those_of_a_world_with_z_up(v2):
    T = read_truth(v2).T_ref_frame
    # North is x, east is -y, up is z. The camera's axes are right, down, forward.
    assert np.allclose(T[0, :3, :3], [[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    assert np.allclose(T[1, :3, 3], [1, 0, 0.5])
    assert np.allclose(T[1, :3, 2], [0, -1, 0])  # forward is east


@pytest.mark.filterwarnings("ignore:.*frames are taken at 10 Hz")
def test_labels_of_v1_are_arrays(v1):
    depth = np.full((480, 640), 4.0, np.float32)
    depth[0] = 10_000
    flow, mask = np.full((480, 640, 2), 2.5, np.float32), np.zeros((480, 640), np.uint8)
    mask[1], mask[2] = 100, 10
    for folder, name, values in (
        ("depth_left", "000000_left_depth", depth),
        ("flow", "000000_000001_flow", flow),
        ("flow", "000000_000001_mask", mask),
        ("seg_left", "000000_left_seg", mask),
    ):
        (v1 / folder).mkdir(exist_ok=True)
        np.save(v1 / folder / f"{name}.npy", values)
    ds = dy.open(v1)
    assert ds.labels == ("depth", "disparity", "flow", "covisibility", "segmentation")
    assert ds.disparity(0)[5, 5] == 80 / 4
    assert np.isnan(ds.depth(0)[0]).all()
    assert ds.flow(0)[5, 5, :2].tolist() == [2.5, 2.5]
    assert ds.covisibility(0)[:4, 0].tolist() == [0, 2, 1, 0]
    assert ds.segmentation(0).dtype == np.uint8
    with pytest.raises(DatasetError, match="the last frame, 1, has no flow"):
        ds.flow(1)
    with pytest.raises(DatasetError, match=r"depth_left/000001: cannot be read"):
        ds.depth(1)
    (v1 / "depth_left" / "000000_left_depth.npy").write_bytes(b"hello")
    with pytest.raises(DatasetError, match=r"000000_left_depth\.npy: cannot be read"):
        ds.depth(0)


def test_images_of_another_size_need_camera_json(tmp_path):
    folder = write(tmp_path / "P002", V2, size=(64, 48))
    (folder / "imu").mkdir()
    (folder / "imu" / "cam_time.txt").write_text("0.0\n0.1\n")
    with pytest.raises(CalibrationError, match=r"camera\.json: missing; images are 64x48, those"):
        open_sequence(folder)
    camera = dict.fromkeys(("fx", "fy"), 50) | {"cx": 31.5, "cy": 23.5, "width": 64, "height": 48}
    (folder / "camera.json").write_text(json.dumps(camera))
    with pytest.raises(CalibrationError, match=r"camera\.json: expected numbers for fx, fy, .*"):
        open_sequence(folder)
    (folder / "camera.json").write_text(json.dumps(camera | {"baseline": 0.1}))
    assert open_sequence(folder).rig.baseline_m == 0.1
    depth = folder / "depth_lcam_front"
    depth.mkdir()
    cv2.imwrite(str(depth / "000000_lcam_front_depth.png"), np.zeros((48, 64), np.uint8))
    with pytest.raises(ImageError, match=r"_depth\.png: expected four channels of 8 bits"):
        dy.open(folder).depth(0)


def test_faults_of_a_folder_are_named(v2):
    (v2 / "pose_lcam_front.txt").write_text("0 0 0 0 0 0 1\n")
    with pytest.raises(TrajectoryError, match=r"1 poses for 2 times of .*cam_time\.npy"):
        read_truth(v2)
    (v2 / "pose_lcam_front.txt").write_text("0 0 0 0 0 0 1\n0 0 0 0 0 0\n")
    with pytest.raises(TrajectoryError, match=r"pose_lcam_front\.txt:2: .*tx ty tz qx qy qz qw"):
        read_truth(v2)
    np.save(v2 / "imu" / "cam_time.npy", np.array([0.1, 0.1]))
    with pytest.raises(DatasetError, match=r"cam_time\.npy: expected times in seconds that incr"):
        open_sequence(v2)
    for file in (v2 / "image_rcam_front").iterdir():
        file.unlink()
    with pytest.raises(DatasetError, match="image_rcam_front: holds no images; a stereo pair nee"):
        open_sequence(v2)
