"""Damaged folders in KITTI's layout end in an error of our own that names the file."""

import cv2
import numpy as np
import pytest
from folders import BASELINE_M, F_PX, wall

from vo.contract.errors import CalibrationError, DatasetError, DriftyardError, TrajectoryError
from vo.contract.remarks import Remark
from vo.recordings.readers import open_sequence, read_truth

STILL = "1 0 0 0 0 1 0 0 0 0 1 0"


def projection(right_px=0.0, f_px=F_PX):
    return f"{f_px} 0 100 {right_px} 0 {f_px} 90 0 0 0 1 0"


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "drive"
    for i, eyes in enumerate(wall(3)):
        for name, image in zip(("image_0", "image_1"), eyes, strict=True):
            (folder / name).mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / name / f"{i:06d}.png"), image)
    calibration = f"P0: {projection()}\nP1: {projection(-F_PX * BASELINE_M)}\n"
    (folder / "calib.txt").write_text(calibration)
    (folder / "times.txt").write_text("0\n0.1\n0.2\n")
    (folder / "poses.txt").write_text(f"{STILL}\n" * 3)
    return folder


@pytest.mark.parametrize(
    "row", [STILL.replace("1", "nan", 1), STILL.replace("1", "inf", 1), STILL[:-2], f"{STILL} 0"]
)
def test_kitti_bad_pose_names_file_and_line(folder, row):
    (folder / "poses.txt").write_text(f"{STILL}\n{row}\n{STILL}\n")
    with pytest.raises(TrajectoryError, match=r"poses\.txt:2: "):
        read_truth(folder)


def test_kitti_poses_all_of_11_columns_are_refused(folder):
    (folder / "poses.txt").write_text(f"{STILL[:-2]}\n" * 3)
    with pytest.raises(TrajectoryError, match=r"poses\.txt:1: "):
        read_truth(folder)


@pytest.mark.parametrize(
    "calibration",
    [
        f"P0: {projection()}\n",
        f"P1: {projection(-60)}\n",
        f"P0: {projection(f_px=0)}\nP1: {projection(-60, f_px=0)}\n",
        f"P0: {projection(f_px=-1)}\nP1: {projection(60, f_px=-1)}\n",
        f"P0: {projection(f_px=np.nan)}\nP1: {projection(-60)}\n",
        f"P0: {projection()}\nP1: {projection(np.nan)}\n",
        f"P0: {projection()}\nP1: {projection(-60, f_px=np.nan)}\n",
        f"P0: {projection()}\nP1: {projection()}\n",
        "",
    ],
    ids=[
        "no P1",
        "no P0",
        "f 0",
        "f -1",
        "f NaN",
        "baseline NaN",
        "right f NaN",
        "baseline 0",
        "empty",
    ],
)
def test_kitti_bad_calibration_names_the_file(folder, calibration):
    (folder / "calib.txt").write_text(calibration)
    with pytest.raises(CalibrationError, match=r"calib\.txt"):
        open_sequence(folder)


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        *((k, "nan") for k in range(12)),
        (3, "-inf"),
        *((k, x) for k in (0, 5, 10) for x in ["0", "-1"]),
    ],
)
@pytest.mark.parametrize("eye", [0, 1])
def test_kitti_bad_entry_of_a_projection_names_the_line(folder, eye, entry, value):
    lines = [line.split() for line in (folder / "calib.txt").read_text().splitlines()]
    lines[eye][1 + entry] = value
    (folder / "calib.txt").write_text("".join(f"{' '.join(x)}\n" for x in lines))
    with pytest.raises(CalibrationError, match=rf"calib\.txt:{eye + 1}: P{eye} must be finite"):
        open_sequence(folder)


def test_kitti_without_images_is_refused(folder):
    for file in folder.glob("image_*/*.png"):
        file.unlink()
    (folder / "times.txt").write_text("")
    with pytest.raises(DatasetError, match=r"image_0\b.* holds no images"):
        open_sequence(folder)


def test_kitti_without_calibration_is_refused(folder):
    (folder / "calib.txt").unlink()
    with pytest.raises(DriftyardError, match=str(folder)):
        open_sequence(folder)


def test_kitti_positions_of_a_point_in_a_plane_are_a_truth(folder):
    (folder / "poses.txt").unlink()
    rows = "0,0,1.5,2\n1,0.1,1.6,2\n"
    (folder / "gt_xy.csv").write_text(
        f"# frame,t,x,y of the point (no camera), tracked; as is\n{rows}"
    )
    with pytest.warns(Remark, match="positions in a plane only"):
        found = read_truth(folder)
    assert found.timestamps_ns.tolist() == [0, 100_000_000]
    assert found.T_ref_frame[:, :3, 3].tolist() == [[1.5, 2, 0], [1.6, 2, 0]]
    assert found.point_cam.tolist() == [0, 0, 0]
