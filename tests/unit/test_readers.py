"""Folder readers on folders that the tests write: EuRoC and KITTI."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from folders import BASELINE_M, F_PX, HEIGHT, PERIOD_NS, WIDTH, wall, write_euroc

from vo.contract.errors import CalibrationError, DatasetError, TrajectoryError
from vo.contract.inertial import ImuLog
from vo.contract.remarks import Remark
from vo.contract.sequence import STALE_NS, WheelLog
from vo.recordings.kitti import pose_files
from vo.recordings.readers import open_sequence, read_truth


@pytest.fixture
def euroc(tmp_path):
    return write_euroc(tmp_path / "drive", wall(3), truth_step_m=0.5)


@pytest.fixture
def kitti(tmp_path):
    folder = tmp_path / "05"
    for side in ("image_0", "image_1"):
        (folder / side).mkdir(parents=True)
    for i, pair in enumerate(wall(3)):
        for side, image in zip(("image_0", "image_1"), pair, strict=True):
            cv2.imwrite(str(folder / side / f"{i:06d}.png"), image)
    P0 = [F_PX, 0, 100, 0, 0, F_PX, 90, 0, 0, 0, 1, 0]
    P1 = [*P0[:3], -F_PX * BASELINE_M, *P0[4:]]
    rows = [f"{name}: " + " ".join(map(str, P)) for name, P in (("P0", P0), ("P1", P1))]
    (folder / "calib.txt").write_text("\n".join(rows) + "\n")
    (folder / "times.txt").write_text("0.0\n1.036e-01\n0.2\n")
    return folder


def test_euroc_pixels_and_calibration_are_unchanged(euroc):
    sequence = open_sequence(euroc)
    assert (sequence.name, len(sequence)) == ("drive", 3)
    rig = sequence.rig
    assert (rig.f_px, rig.baseline_m, rig.cx_px) == (F_PX, BASELINE_M, (WIDTH - 1) / 2)
    for i, (frame, (left, right)) in enumerate(zip(sequence, wall(3), strict=True)):
        assert frame.timestamp_ns == (i + 1) * PERIOD_NS
        assert (frame.left == left).all()
        assert (frame.right == right).all()


def test_mav0_itself_opens_too(euroc):
    assert len(open_sequence(euroc / "mav0")) == 3


def test_euroc_truth_is_of_the_left_camera(tmp_path):
    T_body_left, T_body_right = np.eye(4), np.eye(4)
    T_body_left[:3, 3] = [0.3, 0.0, 0.5]
    T_body_right[:3, 3] = [0.3 + BASELINE_M, 0.0, 0.5]
    folder = write_euroc(
        tmp_path / "x", wall(2), T_body_cams=(T_body_left, T_body_right), truth_step_m=2.0
    )
    assert np.allclose(read_truth(folder).T_ref_frame[1, :3, 3], [2.3, 0, 0.5])


def test_truth_missing_is_none(tmp_path):
    assert read_truth(write_euroc(tmp_path / "x", wall(2))) is None


def test_kitti_opens(kitti):
    sequence = open_sequence(kitti)
    assert sequence.timestamps_ns.tolist() == [0, 103_600_000, 200_000_000]
    rig = sequence.rig
    assert (rig.f_px, rig.cx_px, rig.cy_px) == (F_PX, 100, 90)
    assert rig.baseline_m == pytest.approx(BASELINE_M)
    assert (sequence[2].right == wall(3)[2][1]).all()
    assert read_truth(kitti) is None


def test_kitti_times_in_nanoseconds_are_read(kitti):
    times = [1403636579763555584 + i * 50_000_000 for i in range(3)]
    (kitti / "times.txt").write_text("".join(f"{x}\r\n" for x in times))
    assert open_sequence(kitti).timestamps_ns.tolist() == times


@pytest.mark.parametrize(
    ("header", "separator", "as_seconds", "suffix"),
    [
        ("timestamp,filename\n", ",", False, ".png"),
        ("#timestamp [ns],filename\n", "\t", False, ""),
        ("", " ; ", False, ".png"),
        ("# stamps\n", " ", True, ".png"),
    ],
)
def test_euroc_image_table_is_read_in_every_notation(euroc, header, separator, as_seconds, suffix):
    for eye in (0, 1):
        times = [(i + 1) * PERIOD_NS for i in range(3)]
        words = [f"{x / 1e9:.3f}" if as_seconds else f"{x}.0" for x in times]
        rows = (f"{a}{separator}{b}{suffix}\r\n" for a, b in zip(words, times, strict=True))
        (euroc / f"mav0/cam{eye}/data.csv").write_text(header + "".join(rows))
    sequence = open_sequence(euroc)
    assert sequence.timestamps_ns.tolist() == times
    assert (sequence[2].left == wall(3)[2][0]).all()


@pytest.mark.parametrize("name", ["{}", "{:020d}", "s"])
def test_names_of_images_are_timestamps_without_a_table(euroc, name):
    times = [(i + 9) * PERIOD_NS for i in range(3)]  # the last has one digit more
    for eye in (0, 1):
        (euroc / f"mav0/cam{eye}/data.csv").unlink()
        files = sorted((euroc / f"mav0/cam{eye}/data").iterdir())
        for file, time in zip(files, times, strict=True):
            stem = f"{time / 1e9:.6f}" if name == "s" else name.format(time)
            file.rename(file.with_name(f"{stem}.png"))
    with pytest.warns(Remark, match=r"cam[01]/data\.csv: missing; the names of 3 images"):
        sequence = open_sequence(euroc)
    assert sequence.timestamps_ns.tolist() == times
    assert (sequence[2].left == wall(3)[2][0]).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("#timestamp [ns],filename\n", r"data\.csv: holds no rows; expected 'timestamp"),
        (
            f"{PERIOD_NS},x.png\n{2 * PERIOD_NS},x.png\n",
            r"data\.csv:2: x.png is the image of line",
        ),
    ],
)
def test_euroc_image_table_without_unique_rows_is_refused(euroc, text, message):
    (euroc / "mav0/cam0/data.csv").write_text(text)
    for read in (open_sequence, read_truth):
        with pytest.raises(DatasetError, match=message):
            read(euroc)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("{:06d}", r"timestamps are 1 apart: seconds"),
        ("left{}", r"left0 is not a number; expected"),
    ],
)
def test_names_that_are_no_timestamps_are_refused(euroc, name, message):
    (euroc / "mav0/cam0/data.csv").unlink()
    for i, file in enumerate(sorted((euroc / "mav0/cam0/data").iterdir())):
        file.rename(file.with_name(f"{name.format(i)}.png"))
    with (
        pytest.warns(Remark, match="missing; the names of 3 images"),
        pytest.raises(DatasetError, match=message),
    ):
        open_sequence(euroc)


def test_kitti_truth_of_the_benchmark_layout(kitti):
    poses = kitti.parent.parent / "poses"
    poses.mkdir()
    (poses / "05.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2 + "1 0 0 7 0 1 0 0 0 0 1 0\n")
    assert read_truth(kitti).T_ref_frame[2, 0, 3] == 7
    (poses / "05.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    with pytest.raises(TrajectoryError, match="1 poses for 3 times"):
        read_truth(kitti)


def test_kitti_folder_may_lie_directly_under_the_root():
    assert pose_files(Path("/k01")) == (Path("/k01/poses.txt"), Path("/poses/k01.txt"))


def test_kitti_pairs_of_common_names(kitti):
    (kitti / "image_1" / "000001.png").unlink()
    with pytest.warns(Remark, match="3 images left, 2 right: the 2 common pairs"):
        sequence = open_sequence(kitti)
    assert sequence.timestamps_ns.tolist() == [0, 200_000_000]
    assert (sequence[1].right == wall(3)[2][1]).all()


def test_kitti_times_of_missing_images_are_left_out(kitti):
    for side in ("image_0", "image_1"):
        (kitti / side / "000001.png").unlink()
    with pytest.warns(Remark, match="3 times for 2 images, taken by their numbers"):
        assert open_sequence(kitti).timestamps_ns.tolist() == [0, 200_000_000]


def test_kitti_numbers_are_sorted_as_numbers(kitti):
    for side in ("image_0", "image_1"):
        for i, new in enumerate((2, 10, 9)):
            (kitti / side / f"{i:06d}.png").rename(kitti / side / f"{new}.png")
    assert (open_sequence(kitti)[1].left == wall(3)[2][0]).all()


def test_kitti_faults(kitti):
    (kitti / "times.txt").write_text("0\n0.2\n0.1\n")
    with pytest.raises(DatasetError, match=r"times.txt: time must increase, but that of row 3"):
        open_sequence(kitti)
    (kitti / "times.txt").write_text("0\n1\n")
    with pytest.raises(DatasetError, match="2 times for 3 images"):
        open_sequence(kitti)
    for i in range(3):
        (kitti / "image_1" / f"{i:06d}.png").unlink()
    with pytest.raises(DatasetError, match="image_1: holds no images"):
        open_sequence(kitti)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("P0: 1 2 3\n", r"calib.txt:1: P0 must be 12 numbers"),
        ("1 2 3 4 5 6 7 8 9 10 11 12\n", "a row that begins with 'P0: ', 12 numbers"),
        (f"P0: {'0 ' * 12}\n", "positive focal lengths"),
        ("P0: 9 0 5 0 0 9 5 0 0 0 1 0\nP1: 9 0 5 -9 0 9 5 9 0 0 1 0\n", "not side by side"),
        ("P0: 9 0 5 0 0 9 5 0 0 0 1 0\nP1: 9 0 5 -1e99 0 9 5 0 0 0 1 0\n", "too far from the body"),
        ("P0: 99 0 99 0 0 99 99 0 0 0 1 0\nP1: 99 0 99 9 0 99 99 0 0 0 1 0\n", "swapped"),
    ],
)
def test_kitti_calibration_faults(kitti, text, message):
    (kitti / "calib.txt").write_text(text)
    with pytest.raises(CalibrationError, match=message):
        open_sequence(kitti)


def test_kitti_principal_point_of_the_right_eye_is_honoured(kitti):
    calibration = (kitti / "calib.txt").read_text()
    right = f"P1: {F_PX:.1f} 0 100"
    assert right in calibration
    # The right image lies 3 pixels further to the left than that of an equal camera.
    (kitti / "calib.txt").write_text(calibration.replace(right, f"P1: {F_PX:.1f} 0 97"))
    sequence = open_sequence(kitti)
    assert (sequence.rig.f_px, sequence.rig.cx_px) == (F_PX, 100)
    assert sequence.rig.baseline_m == pytest.approx(BASELINE_M)
    left, right = wall(3)[1]
    assert (sequence[1].left == left).all()
    assert (sequence[1].right[:, 3:] == right[:, :-3]).all()


def test_kitti_colour_pair_has_the_truth_of_its_left_eye(kitti):
    for old, new in (("image_0", "image_2"), ("image_1", "image_3")):
        (kitti / old).rename(kitti / new)
    rows = (
        [F_PX, 0, 100, 12, 0, F_PX, 90, 0, 0, 0, 1, 0],
        [F_PX, 0, 100, -8, 0, F_PX, 90, 0, 0, 0, 1, 0],
    )
    text = [f"P{k}: " + " ".join(map(str, row)) for k, row in zip((2, 3), rows, strict=True)]
    (kitti / "calib.txt").write_text("\n".join(text))
    (kitti / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 3)
    sequence = open_sequence(kitti)
    assert sequence.rig.baseline_m == pytest.approx(BASELINE_M)
    assert sequence.rig.T_body_cam[0, 3] == pytest.approx(-0.06)
    assert read_truth(kitti).T_ref_frame[1, 0, 3] == pytest.approx(-0.06)


def test_kitti_raw_opens(kitti):
    drive = kitti.parent / "2011_09_26" / "drive_sync"
    for eye in (0, 1):
        (drive / f"image_0{eye}").mkdir(parents=True)
        (kitti / f"image_{eye}").rename(drive / f"image_0{eye}" / "data")
        stamps = [f"2011-09-26 13:02:25.{k}64389445\n" for k in (1, 2, 3)]
        (drive / f"image_0{eye}" / "timestamps.txt").write_text("".join(stamps))
    text = (kitti / "calib.txt").read_text().replace("P0", "P_rect_00").replace("P1", "P_rect_01")
    (drive.parent / "calib_cam_to_cam.txt").write_text("calib_time: 09-Jan-2012\n" + text)
    sequence = open_sequence(drive)
    assert sequence.rig.baseline_m == pytest.approx(BASELINE_M)
    assert sequence.timestamps_ns[0] == 1317042145164389445
    assert np.diff(sequence.timestamps_ns).tolist() == [PERIOD_NS, PERIOD_NS]
    (drive / "image_00" / "timestamps.txt").write_text("2011-09-26 13:02\nyesterday\n")
    with pytest.raises(DatasetError, match=r"timestamps.txt:2: expected a time such as"):
        open_sequence(drive)


def test_tumvi_opens_with_its_camchain(euroc, tmp_path):
    dso = tmp_path / "room" / "dso"
    chain = {}
    for eye in (0, 1):
        data = euroc / "mav0" / f"cam{eye}" / "data"
        (dso / f"cam{eye}").mkdir(parents=True)
        data.rename(dso / f"cam{eye}" / "images")
        rows = [f"{k * PERIOD_NS} {k * 0.1:.9f} 2.5\n" for k in (1, 2, 3)]
        (dso / f"cam{eye}" / "times.txt").write_text("# name time exposure\n" + "".join(rows))
        T_cam_imu = np.eye(4)
        T_cam_imu[0, 3] = -eye * BASELINE_M
        chain[f"cam{eye}"] = {
            "camera_model": "pinhole",
            "distortion_model": "equidistant",
            "distortion_coeffs": [0.0, 0.0, 0.0, 0.0],
            "intrinsics": [F_PX, F_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2],
            "resolution": [WIDTH, HEIGHT],
            "T_cam_imu": T_cam_imu.tolist(),
        }
    (dso / "camchain.yaml").write_text(yaml.safe_dump(chain))
    sequence = open_sequence(tmp_path / "room")
    assert sequence.timestamps_ns.tolist() == [k * PERIOD_NS for k in (1, 2, 3)]
    assert sequence.rig.baseline_m == pytest.approx(BASELINE_M)
    assert read_truth(dso) is None
    rows = [f"{k * PERIOD_NS},{k},0,0,1,0,0,0\n" for k in (1, 2, 3)]
    (dso / "gt_imu.csv").write_text("# timestamp[ns],tx,ty,tz,qw,qx,qy,qz\n" + "".join(rows))
    assert read_truth(dso).T_ref_frame[:, 0, 3] == pytest.approx([1, 2, 3])
    assert len(open_sequence(dso)) == 3


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("intrinsics: ", "[.nan, 200, 1, 1]", "NaN"),
        ("intrinsics: ", "[-1.0, 200, 1, 1]", "must be positive"),
        ("camera_model: ", "omni", "camera_model omni"),
        ("resolution: ", "[240]", "resolution must be width and height"),
        ("T_BS: ", "{}", "key 'data' is missing"),
    ],
)
def test_euroc_calibration_faults(euroc, key, value, message):
    path = euroc / "mav0" / "cam0" / "sensor.yaml"
    sheet = yaml.safe_load(path.read_text().removeprefix("%YAML:1.0\n"))
    sheet[key.rstrip(": ")] = yaml.safe_load(value)
    path.write_text(yaml.safe_dump(sheet))
    with pytest.raises(CalibrationError, match=message):
        open_sequence(euroc)


def test_euroc_swapped_cameras_are_refused(tmp_path):
    left = np.eye(4)
    left[0, 3] = BASELINE_M
    with pytest.raises(CalibrationError, match="swapped"):
        open_sequence(write_euroc(tmp_path / "x", wall(2), T_body_cams=(left, np.eye(4))))


def test_unknown_layout_lists_the_known_ones(tmp_path):
    with pytest.raises(DatasetError, match=r"EuRoC .* KITTI odometry"):
        open_sequence(tmp_path)


def test_calibration_of_another_name_is_read_with_a_remark(euroc):
    for eye in (0, 1):
        sheet = euroc / "mav0" / f"cam{eye}" / "sensor.yaml"
        sheet.rename(sheet.with_name("left.yml" if eye == 0 else "right.yml"))
    with pytest.warns(Remark, match="the calibration is that of"):
        assert open_sequence(euroc).rig.f_px == F_PX


def test_folder_of_recordings_names_one(euroc):
    with pytest.raises(DatasetError, match=rf"not a recording; {euroc} is one; expected"):
        open_sequence(euroc.parent)


@pytest.mark.parametrize("separator", [" ", "=", ":"])
def test_kitti_keys_end_in_a_colon_or_else(kitti, separator):
    path = kitti / "calib.txt"
    path.write_text(path.read_text().replace(": ", separator))
    assert open_sequence(kitti).rig.baseline_m == pytest.approx(BASELINE_M)


def test_colour_is_read_as_grey(euroc):
    path = euroc / "mav0" / "cam0" / "data" / f"{PERIOD_NS}.png"
    colour = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    colour[..., 1] = 200
    cv2.imwrite(str(path), colour)
    assert (open_sequence(euroc)[0].left == round(0.587 * 200)).all()


def write_wheels(folder, rows):
    table = folder / "mav0" / "wheels0" / "data.csv"
    table.parent.mkdir()
    table.write_text("#timestamp [ns],left [ticks],right [ticks]\n" + rows)


def test_frame_has_the_last_wheel_reading(euroc):
    assert open_sequence(euroc)[0].wheel_ticks is None
    rows = [f"{PERIOD_NS},-3,4", f"{2 * PERIOD_NS - 1},5,6", f"{2 * PERIOD_NS + 1},7,8"]
    write_wheels(euroc, "\n".join(rows))
    ticks = [frame.wheel_ticks for frame in open_sequence(euroc)]
    assert ticks == [(-3, 4), (5, 6), (7, 8)]


def test_frame_has_the_angles_of_the_gyroscope(euroc):
    """The rate about x grows by 1 rad/s in a period, about y it is -2 rad/s, about z it is zero."""
    table = euroc / "mav0" / "imu0" / "data.csv"
    table.parent.mkdir()
    times_ns = range(0, 4 * PERIOD_NS, PERIOD_NS // 10)
    table.write_text("".join(f"{t},{t / PERIOD_NS},-2,0,0,0,9.81\n" for t in times_ns))
    frames = list(open_sequence(euroc))
    seconds = np.array([frame.timestamp_ns for frame in frames]) * 1e-9
    expected = np.stack([seconds**2 / (2e-9 * PERIOD_NS), -2 * seconds, 0 * seconds], axis=-1)
    np.testing.assert_allclose([frame.gyro_rad for frame in frames], expected, atol=1e-9)
    table.write_text("0,1,2\n")
    with pytest.warns(Remark, match="the gyroscope is not used"):
        assert open_sequence(euroc)[0].gyro_rad is None


def test_gyroscope_that_pauses_has_no_angles():
    times_ns = np.array([1, 2, 5]) * 10**8
    log = ImuLog(times_ns, np.ones((3, 3)), np.zeros((3, 3)))
    assert log.angles_at(10**8 - 1) is None
    assert log.angles_at(15 * 10**7) == pytest.approx((0.05, 0.05, 0.05))
    assert log.angles_at(3 * 10**8) is None
    assert log.angles_at(5 * 10**8 + 1) is None


def test_stale_encoder_readings_are_none():
    log = WheelLog(np.array([10**9, 2 * 10**9]), np.array([[1, 2], [3, 4]]))
    assert log.at(10**9 - 1) is None
    assert log.at(10**9 + STALE_NS) == (1, 2)
    assert log.at(10**9 + STALE_NS + 1) is None
    assert log.at(2 * 10**9) == (3, 4)


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("2000,1", "expected 'timestamp"),
        ("2000,1,nan", "whole numbers"),
        ("2000,1,2,3", "expected"),
        ("1000,1,2", "time must increase"),
    ],
)
def test_wheel_table_faults_name_the_line(euroc, row, message):
    write_wheels(euroc, f"1000,0,0\n{row}\n")
    with pytest.raises(DatasetError, match=rf"wheels0/data.csv:3: .*{message}"):
        open_sequence(euroc)
