"""Calibrations as ASL, Kalibr, OpenCV and ROS write them."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml

from vo.contract import se3
from vo.contract.errors import CalibrationError
from vo.contract.remarks import Remark
from vo.recordings.calibration import read_cameras
from vo.recordings.calibration_files import find_stereo_file
from vo.recordings.rectify import Lens, rectify

FOCAL = [200.0, 201.0, 119.5, 89.5]
K = [[200.0, 0.0, 119.5], [0.0, 201.0, 89.5], [0.0, 0.0, 1.0]]
COEFFICIENTS = [-0.28, 0.07, 2e-4, 2e-5]
T_BODY_LEFT = se3.exp(np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6]))
T_LEFT_RIGHT = se3.exp(np.array([0.11, 0.002, -0.001, 0.003, -0.002, 0.004]))
T_BODY = T_BODY_LEFT, T_BODY_LEFT @ T_LEFT_RIGHT


def asl(eye, **changes):
    sheet = {
        "T_BS": {"rows": 4, "cols": 4, "data": T_BODY[eye].ravel().tolist()},
        "camera_model": "pinhole",
        "intrinsics": FOCAL,
        "resolution": [240, 180],
        "distortion_model": "radial-tangential",
        "distortion_coefficients": COEFFICIENTS,
    }
    return {key: value for key, value in {**sheet, **changes}.items() if value != "absent"}


def write(folder, texts):
    paths = [folder / f"cam{eye}.yaml" for eye in (0, 1)]
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text if isinstance(text, str) else yaml.safe_dump(text))
    return paths


def read_changed(folder, **changes):
    return read_cameras(*write(folder, [asl(eye, **changes) for eye in (0, 1)]))


def assert_same(cameras, distortion=COEFFICIENTS, lens=Lens.RADIAL_TANGENTIAL, T=T_BODY):
    for camera, T_body_cam in zip(cameras, T, strict=True):
        assert (camera.width_px, camera.height_px, camera.lens) == (240, 180, lens)
        np.testing.assert_allclose(camera.K, K)
        np.testing.assert_array_equal(camera.distortion, distortion)
        np.testing.assert_allclose(camera.T_body_cam, T_body_cam, atol=1e-9)


def opencv_matrix(rows):
    values = np.atleast_2d(rows)
    data = ", ".join(repr(float(x)) for x in values.ravel())
    shape = f"   rows: {values.shape[0]}\n   cols: {values.shape[1]}\n"
    return f"!!opencv-matrix\n{shape}   dt: d\n   data: [ {data} ]\n"


def opencv_sheet(eye):
    return (
        "%YAML:1.0\n---\nimage_width: 240\nimage_height: 180\n"
        f"camera_matrix: {opencv_matrix(K)}distortion_coefficients: {opencv_matrix(COEFFICIENTS)}"
        f"distortion_model: plumb_bob\nT_BS: {opencv_matrix(T_BODY[eye])}"
    )


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"distortion_model": "radtan"},
        {"distortion_model": "Radial Tangential"},
        {"camera_model": "absent"},
        {"camera_model": "pinhole-radtan", "distortion_model": "absent"},
        {"resolution": "absent", "image_width": 240, "image_height": 180},
        {"resolution": "absent", "width": 240, "height": 180},
        {"intrinsics": dict(zip(("fx", "fy", "cx", "cy"), FOCAL, strict=True))},
        {"intrinsics": "absent", "K": np.ravel(K).tolist()},
        {
            "intrinsics": "absent",
            "camera_matrix": {"rows": 3, "cols": 3, "data": np.ravel(K).tolist()},
        },
        {"distortion_coefficients": "absent", "distortion_coeffs": COEFFICIENTS},
        {"distortion_coefficients": "absent", "D": COEFFICIENTS},
    ],
)
def test_names_of_keys_and_models(tmp_path, changes):
    assert_same(read_changed(tmp_path, **changes))


def test_sheets_of_opencv(tmp_path):
    assert_same(read_cameras(*write(tmp_path, [opencv_sheet(0), opencv_sheet(1)])))


@pytest.mark.parametrize("imu", [False, True])
def test_camchain_of_kalibr(tmp_path, imu):
    chain = {}
    for eye in (0, 1):
        sheet = asl(eye, T_BS="absent", distortion_coefficients="absent", cam_overlaps=[1 - eye])
        chain[f"cam{eye}"] = sheet | {
            "distortion_coeffs": COEFFICIENTS,
            "distortion_model": "radtan",
            "rostopic": f"/cam{eye}/image_raw",
        }
        if imu:
            chain[f"cam{eye}"]["T_cam_imu"] = se3.inverse(T_BODY[eye]).tolist()
    chain["cam1"]["T_cn_cnm1"] = se3.inverse(T_LEFT_RIGHT).tolist()
    (tmp_path / "notes.yaml").write_text("- a list\n")
    path = tmp_path / ("camchain-imucam.yaml" if imu else "camchain.yaml")
    path.write_text(yaml.safe_dump(chain))
    assert find_stereo_file((tmp_path / "nowhere", tmp_path)) == path
    assert_same(read_cameras(path, path), T=T_BODY if imu else (np.eye(4), T_LEFT_RIGHT))


def settings(**values):
    rows = {key: x if isinstance(x, str) else repr(x) for key, x in values.items()}
    return "%YAML:1.0\n" + "".join(f"{key}: {x}\n" for key, x in rows.items())


def orbslam_eye(name, names):
    values = dict(zip(("fx", "fy", "cx", "cy", *names), [*FOCAL, *COEFFICIENTS], strict=True))
    return {f"{name}.{key}": x for key, x in values.items()}


SIZE = {"Camera.width": 240, "Camera.height": 180}


@pytest.mark.parametrize("body", [{}, {"IMU.T_b_c1": T_BODY_LEFT}, {"Tbc": T_BODY_LEFT}])
@pytest.mark.parametrize("lens", Lens)
def test_settings_of_orbslam3(tmp_path, lens, body):
    is_fisheye = lens is Lens.EQUIDISTANT
    eyes = [
        orbslam_eye(
            f"Camera{eye}", ["k1", "k2", "k3", "k4"] if is_fisheye else ["k1", "k2", "p1", "p2"]
        )
        for eye in (1, 2)
    ]
    poses = {"Stereo.T_c1_c2": opencv_matrix(T_LEFT_RIGHT)}
    poses |= {key: opencv_matrix(x) for key, x in body.items()}
    kind = {"Camera.type": "KannalaBrandt8" if is_fisheye else "PinHole"}
    path = tmp_path / "EuRoC.yaml"
    text = settings(**kind, **eyes[0], **eyes[1], **SIZE, **poses)
    path.write_text(text + "Viewer.PointSize:2\n")
    assert find_stereo_file((tmp_path,)) == path
    T = T_BODY if body else (np.eye(4), T_LEFT_RIGHT)
    assert_same(read_cameras(path, path), lens=lens, T=T)


@pytest.mark.parametrize("baseline", [{"Camera.bf": 0.11 * FOCAL[0]}, {"Stereo.b": 0.11}])
def test_rectified_settings_of_orbslam(tmp_path, baseline):
    eye = dict(list(orbslam_eye("Camera", ("k1", "k2", "p1", "p2")).items())[:4])
    path = tmp_path / "KITTI.yaml"
    path.write_text(settings(**eye, **SIZE, **baseline))
    T = np.eye(4), se3.pose(np.eye(3), np.array([0.11, 0, 0]))
    assert_same(read_cameras(path, path), [0, 0, 0, 0], T=T)
    path.write_text(settings(**{"Camera.type": "Omni"}, **eye, **SIZE, **baseline))
    with pytest.raises(CalibrationError, match=r"KITTI.yaml: camera_model Omni; valid: pinhole,"):
        read_cameras(path, path)


def test_rectification_maps_of_orbslam2(tmp_path):
    cameras = read_cameras(*write(tmp_path, [asl(eye) for eye in (0, 1)]))
    rotations, baseline_m = rectifying_rotations(cameras), np.linalg.norm(T_LEFT_RIGHT[:3, 3])
    values = orbslam_eye("Camera", ("k1", "k2", "p1", "p2")) | SIZE | {"Camera.bf": 47.9}
    for eye, side in enumerate(("LEFT", "RIGHT")):
        P = np.hstack([np.diag([190.0, 190.0, 1.0]), np.zeros((3, 1))])
        P[0, 3] = -190 * eye * baseline_m
        found = {"K": K, "D": [[*COEFFICIENTS, 0.0]], "R": rotations[eye], "P": P}
        values |= {f"{side}.height": 180, f"{side}.width": 240}
        values |= {f"{side}.{key}": opencv_matrix(x) for key, x in found.items()}
    path = tmp_path / "orb.yaml"
    path.write_text(settings(**values).replace("data: [", "data:["))
    assert_same(read_cameras(path, path), [*COEFFICIENTS, 0], T=(np.eye(4), T_LEFT_RIGHT))


@pytest.mark.parametrize("model", ["PINHOLE", "KANNALA_BRANDT", "MEI"])
def test_configuration_of_vins_fusion(tmp_path, model):
    lens = Lens.EQUIDISTANT if model == "KANNALA_BRANDT" else Lens.RADIAL_TANGENTIAL
    focal, names = ("fx", "fy", "cx", "cy"), ("k1", "k2", "p1", "p2")
    if lens is Lens.EQUIDISTANT:
        focal, names = ("mu", "mv", "u0", "v0"), ("k2", "k3", "k4", "k5")
    sheet = {"model_type": model, "image_width": 240, "image_height": 180}
    sheet["distortion_parameters"] = dict(zip(names, COEFFICIENTS, strict=True))
    sheet["projection_parameters"] = dict(zip(focal, FOCAL, strict=True))
    names = {f"cam{eye}_calib": f'"{x.name}"' for eye, x in enumerate(write(tmp_path, [sheet] * 2))}
    poses = {f"body_T_cam{eye}": opencv_matrix(T_BODY[eye]) for eye in (0, 1)}
    path = tmp_path / "euroc_stereo_imu_config.yaml"
    path.write_text(settings(imu=1, **names, **poses))
    assert find_stereo_file((tmp_path,)) == path
    if model == "MEI":
        with pytest.raises(CalibrationError, match="camera_model MEI; valid: pinhole"):
            read_cameras(path, path)
    else:
        assert_same(read_cameras(path, path), lens=lens)


@pytest.mark.parametrize("names", [("M", "D"), ("cameraMatrix", "distCoeffs")])
def test_stereo_calibration_of_opencv(tmp_path, names):
    eyes = {f"{names[0]}{i}": opencv_matrix(K) for i in (1, 2)}
    eyes |= {f"{names[1]}{i}": opencv_matrix(COEFFICIENTS) for i in (1, 2)}
    T = se3.inverse(T_LEFT_RIGHT)
    path = tmp_path / "intrinsics.yml"
    path.write_text(settings(**eyes))
    with pytest.raises(CalibrationError, match=r"intrinsics.yml: key 'R' is missing"):
        find_stereo_file((tmp_path,))
    poses = {"R": opencv_matrix(T[:3, :3]), "T": opencv_matrix(T[:3, 3:])}
    (tmp_path / "extrinsics.yml").write_text(settings(**poses))
    assert find_stereo_file((tmp_path,)) == path
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((180, 240), np.uint8))
    with pytest.warns(Remark) as remarks:
        found = read_cameras(path, path, tmp_path)
    assert_same(found, T=(np.eye(4), T_LEFT_RIGHT))
    said = " ".join(str(x.message) for x in remarks)
    assert "'resolution' is missing; the images have 240x180 px" in said
    assert "radial-tangential is assumed" in said


def rectifying_rotations(cameras):
    """Both cameras turn to axes whose x axis is the baseline."""
    T_left_right = se3.inverse(cameras[0].T_body_cam) @ cameras[1].T_body_cam
    x = T_left_right[:3, 3] / np.linalg.norm(T_left_right[:3, 3])
    y = np.cross([0, 0, 1], x) / np.linalg.norm(np.cross([0, 0, 1], x))
    R_rectified_left = np.stack([x, y, np.cross(x, y)])
    return R_rectified_left, R_rectified_left @ T_left_right[:3, :3]


def test_camera_info_of_ros(tmp_path):
    rotations = rectifying_rotations(read_cameras(*write(tmp_path, [asl(0), asl(1)])))
    sheets = []
    for eye, R in enumerate(rotations):
        P = np.hstack([np.diag([190.0, 190.0, 1.0]), np.zeros((3, 1))])
        P[0, 3] = -190 * eye * np.linalg.norm(T_LEFT_RIGHT[:3, 3])
        sheet = asl(eye, T_BS="absent", resolution="absent", intrinsics="absent")
        matrices = {"camera_matrix": K, "rectification_matrix": R, "projection_matrix": P}
        sheet |= {key: {"data": np.ravel(x).tolist()} for key, x in matrices.items()}
        sheet |= {"image_width": 240, "image_height": 180, "distortion_model": "plumb_bob"}
        sheets.append(sheet)
    assert_same(read_cameras(*write(tmp_path, sheets)), T=(np.eye(4), T_LEFT_RIGHT))


@pytest.mark.parametrize(
    ("values", "distortion"),
    [
        ([], [0, 0, 0, 0]),
        ([-0.2, 0.1], [-0.2, 0.1, 0, 0]),
        ([-0.2, 0.1, 1e-3, 2e-3, 3e-3], [-0.2, 0.1, 1e-3, 2e-3, 3e-3]),
        ([[-0.2, 0.1, 1e-3, 2e-3]], [-0.2, 0.1, 1e-3, 2e-3]),
        ([0.1 * k for k in range(8)], [0.1 * k for k in range(8)]),
        (["-2e-1", "1e-1"], [-0.2, 0.1, 0, 0]),  # no numbers in YAML 1.1
    ],
)
def test_numbers_of_radial_tangential_coefficients(tmp_path, values, distortion):
    assert_same(read_changed(tmp_path, distortion_coefficients=values), distortion)


def test_three_coefficients_are_radial_with_a_remark(tmp_path):
    with pytest.warns(Remark, match="k1, k2, k3"):
        cameras = read_changed(tmp_path, distortion_coefficients=[-0.2, 0.1, 0.05])
    assert_same(cameras, [-0.2, 0.1, 0, 0, 0.05])


@pytest.mark.parametrize(
    "names",
    [
        {"distortion_model": "equidistant"},
        {"distortion_model": "Kannala-Brandt"},
        {"camera_model": "kannala_brandt", "distortion_model": "none"},
        {"distortion_model": "absent", "fisheye_model": 1},
    ],
)
def test_names_of_the_equidistant_lens(tmp_path, names):
    assert_same(read_changed(tmp_path, **names), lens=Lens.EQUIDISTANT)


def test_no_distortion_keys_are_no_distortion(tmp_path):
    absent = dict.fromkeys(("distortion_model", "distortion_coefficients"), "absent")
    assert_same(read_changed(tmp_path, **absent), [0, 0, 0, 0])
    absent["distortion_model"] = "none"
    assert_same(read_changed(tmp_path, **absent), [0, 0, 0, 0])


def test_coefficients_without_model_bring_a_remark(tmp_path):
    with pytest.warns(Remark, match="without distortion_model; radial-tangential is assumed"):
        assert_same(read_changed(tmp_path, distortion_model="absent"))


@pytest.mark.parametrize("T", [T_BODY_LEFT.tolist(), T_BODY_LEFT.ravel().tolist()])
def test_poses_as_rows_or_flat(tmp_path, T):
    sheets = [asl(0, T_BS=T), asl(1)]
    assert_same(read_cameras(*write(tmp_path, sheets)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"distortion_coefficients": "absent"}, "key 'distortion_coefficients' is missing"),
        ({"distortion_coefficients": None}, "key 'distortion_coefficients' is missing"),
        ({"distortion_coefficients": [0.1] * 6}, "has 6 numbers; radial-tangential has 0, 2, 3, 4"),
        ({"distortion_model": "equi", "distortion_coefficients": [0.1] * 5}, "equidistant has 4"),
        ({"distortion_coefficients": ["a", "b"]}, "distortion_coefficients must hold numbers only"),
        ({"distortion_model": "fov"}, "distortion_model fov; valid: radial-tangential, radtan"),
        ({"camera_model": "omni"}, "camera_model omni; valid: pinhole"),
        ({"T_BS": "absent"}, "key 'T_BS' is missing .*T_cn_cnm1"),
        ({"T_BS": T_BODY_LEFT.T.tolist()}, "T_BS is not a rigid 4x4 transform"),
        ({"T_BS": np.eye(3).tolist()}, "T_BS is not a rigid 4x4 transform"),
        ({"intrinsics": "absent"}, "key 'intrinsics' is missing"),
        ({"intrinsics": [1, 2, 3]}, r"intrinsics must be \[fx, fy, cx, cy\] or a 3x3 matrix"),
        ({"K": np.eye(3).tolist()}, "intrinsics and K differ"),
        ({"intrinsics": [[9, 1, 9], [0, 9, 9], [0, 0, 1]]}, "skew"),
        ({"resolution": "absent"}, "key 'resolution' is missing"),
        ({"resolution": [240, 180.5]}, "resolution must be width and height"),
    ],
)
def test_calibration_faults_name_file_and_key(tmp_path, changes, message):
    with pytest.raises(CalibrationError, match=rf"cam0.yaml: .*{message}"):
        read_changed(tmp_path, **changes)


def test_unknown_distortion_key_is_named(tmp_path):
    changes = {"distortion_coefficients": "absent", "distortion_model": "absent"}
    with pytest.raises(CalibrationError, match="key 'distort_params' is unknown; expected dist"):
        read_changed(tmp_path, **changes, distort_params=[0.1, 0.2])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"resolution": [120, 90]}, r"principal point \(119.5, 89.5\) px is far from the middle"),
        ({"intrinsics": [3.6, 3.6, 119.5, 89.5]}, "a focal length of 3.6 px is unlikely"),
    ],
)
def test_unlikely_intrinsics_bring_a_remark(tmp_path, changes, message):
    left, right = read_changed(tmp_path, **changes, distortion_coefficients=[])
    T = np.eye(4)
    T[0, 3] = 0.1
    with pytest.warns(Remark, match=message):
        rectify(replace(left, T_body_cam=np.eye(4)), replace(right, T_body_cam=T))


def test_baseline_in_millimetres_brings_a_remark(tmp_path):
    left, right = read_changed(tmp_path, distortion_coefficients=[], intrinsics=[200, 200, 120, 90])
    T = np.eye(4)
    T[0, 3] = 110.0
    with pytest.warns(Remark, match="the baseline is 110 m; expected metres"):
        rectify(replace(left, T_body_cam=np.eye(4)), replace(right, T_body_cam=T))


def test_invalid_yaml_names_its_line(tmp_path):
    paths = write(
        tmp_path, ["%YAML:1.0\nresolution: [1, 2]\nintrinsics: [1, 2\nT_BS: {}\n", asl(1)]
    )
    with pytest.raises(CalibrationError, match=r"cam0.yaml:4: not valid YAML"):
        read_cameras(*paths)
