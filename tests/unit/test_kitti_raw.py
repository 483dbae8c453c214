"""Poses of KITTI's raw recordings, from satellites and inertial unit."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vo.contract import se3
from vo.contract.errors import TrajectoryError
from vo.contract.remarks import Remark
from vo.recordings.kitti_raw import read_oxts


def write_oxts(folder, T_world_imu, latitude):
    """Write poses around a latitude, on a sphere, whose Mercator plane is scaled there."""
    (folder / "oxts" / "data").mkdir(parents=True)
    scale_m = 6378137 * np.cos(latitude)
    north = np.arctanh(np.sin(latitude)) + T_world_imu[:, 1, 3] / scale_m
    angles = Rotation.from_matrix(T_world_imu[:, :3, :3]).as_euler("xyz")
    for i, T in enumerate(T_world_imu):
        place = np.degrees([np.arctan(np.sinh(north[i])), 0.1 + T[0, 3] / scale_m])
        row = [*place, 112 + T[2, 3], *angles[i], *[0.0] * 24]
        (folder / "oxts" / "data" / f"{i:010d}.txt").write_text(
            " ".join(map(repr, map(float, row)))
        )
    dates = (f"2011-09-26 13:02:25.{i}00000000\n" for i in range(len(T_world_imu)))
    (folder / "oxts" / "timestamps.txt").write_text("".join(dates))


def test_oxts_of_kitti_are_poses_of_the_left_camera(tmp_path):
    T_world_imu = se3.exp(np.outer(np.arange(4), [1.0, 2.0, 0.1, 0.01, 0.02, 0.3]))
    steps = {
        "calib_cam_to_cam.txt": se3.exp(np.array([0, 0, 0, 0.01, 0.02, 0.03])),
        "calib_velo_to_cam.txt": se3.exp(np.array([0.1, 0.2, 0.3, 1, -1, 1])),
        "calib_imu_to_velo.txt": se3.exp(np.array([-0.8, 0.3, -0.8, 0, 0.01, 0])),
    }
    folder, T_cam0_imu = tmp_path / "drive_sync", np.eye(4)
    write_oxts(folder, T_world_imu, np.radians(49.0))
    T_cam0_left = se3.pose(np.eye(3), np.array([0.06, 0, 0]))
    with pytest.warns(Remark, match=r"oxts: is no truth without calib_cam_to_cam.txt and"):
        assert read_oxts(folder, T_cam0_left) is None
    for name, T in steps.items():
        rows = {"R_rect_00" if "cam_to_cam" in name else "R": T[:3, :3].ravel(), "T": T[:3, 3]}
        text = "".join(f"{key}: {' '.join(map(repr, x.tolist()))}\n" for key, x in rows.items())
        (tmp_path / name).write_text(f"calib_time: 15-Mar-2012 11:45:23\n{text}")
        T_cam0_imu = T_cam0_imu @ T
    found = read_oxts(folder, T_cam0_left)
    expected = T_world_imu @ se3.inverse(T_cam0_imu) @ T_cam0_left
    assert np.allclose(found.T_ref_frame, expected, atol=1e-6)
    assert np.diff(found.timestamps_ns).tolist() == [10**8] * 3
    (folder / "oxts" / "data" / "0000000003.txt").write_text("49 8\n")
    with pytest.raises(TrajectoryError, match=r"0000000003.txt:1: 2 columns; expected latitude"):
        read_oxts(folder, T_cam0_left)
