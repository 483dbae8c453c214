"""Cameras from the sheets of a calibration: sizes, matrices, distortions and poses."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.errors import CalibrationError
from vo.contract.remarks import remark
from vo.recordings.calibration_files import (
    FOCAL,
    ORBSLAM_BODY,
    Sheet,
    numbers,
    read_pose,
    read_sheets,
    read_yaml,
)
from vo.recordings.images import grey_reader, list_images
from vo.recordings.rectify import Camera, Lens

LENSES: dict[str, Lens | None] = {
    "radial-tangential": Lens.RADIAL_TANGENTIAL,
    "radtan": Lens.RADIAL_TANGENTIAL,
    "plumb_bob": Lens.RADIAL_TANGENTIAL,
    "rational_polynomial": Lens.RADIAL_TANGENTIAL,
    "brown-conrady": Lens.RADIAL_TANGENTIAL,
    "equidistant": Lens.EQUIDISTANT,
    "equi": Lens.EQUIDISTANT,
    "kannala-brandt": Lens.EQUIDISTANT,
    "fisheye": Lens.EQUIDISTANT,
}
"""Names of distortion models; capitals, blanks, hyphens and underscores do not matter."""

CAMERAS: dict[str, Lens | None] = {
    "pinhole": None,
    "pinhole-radtan": Lens.RADIAL_TANGENTIAL,
    "pinhole-equi": Lens.EQUIDISTANT,
    "kannala-brandt": Lens.EQUIDISTANT,
    "kannala-brandt8": Lens.EQUIDISTANT,
    "fisheye": Lens.EQUIDISTANT,
    "rectified": None,
}
"""Names of camera models, and the distortion that they imply."""

SIZES = (("resolution",), ("image_size",), ("image_width", "image_height"), ("width", "height"))
INTRINSICS = ("intrinsics", "camera_matrix", "K")
COEFFICIENTS = ("distortion_coefficients", "distortion_coeffs", "dist_coeffs", "distortion", "D")
MODELS = ("distortion_model", "distortion_type")
POSES = ("T_BS", "T_imu_cam", "T_cam_imu", "T_cn_cnm1")
BODY_POSES = (*POSES[:2], "body_T_cam0", "body_T_cam1", *ORBSLAM_BODY)
LINE_TIMES = {"line_delay": 1.0, "line_delay_nanoseconds": 1e-9}
"""Keys of the time from one row's exposure to that of the next one below, with their unit, s."""
MAX_LINE_TIME_S = 1e-3
"""Largest line time: larger ones are of another unit."""
RECTIFIED = (("rectification_matrix", "R"), ("projection_matrix", "P"))

COUNTS = {Lens.RADIAL_TANGENTIAL: (0, 2, 3, 4, 5, 8, 12, 14), Lens.EQUIDISTANT: (4,)}
"""Valid numbers of coefficients: k1 k2, or k1 k2 k3, or k1 k2 p1 p2 k3 … in OpenCV's order."""


def read_cameras(left: Path, right: Path, images: Path | None = None) -> tuple[Camera, Camera]:
    """Read the calibrations of the left and the right camera, which may be one file of both.

    Where they do not state a size, that of the first image in the folder `images` is taken.

    The poses of the cameras are those in the body frame, if the files have one, else in the left
    camera's frame: T_BS or T_imu_cam (maps camera to body), T_cam_imu (body to camera), T_cn_cnm1
    (left to right camera), or the rectification and projection matrices of ROS.

    Raises:
        CalibrationError: If a file is missing, or a key is missing, malformed or unknown.
    """
    return describe_cameras((left, right), read_sheets(left, right), images)


def describe_cameras(
    paths: tuple[Path, Path], sheets: tuple[Sheet, Sheet], images: Path | None = None
) -> tuple[Camera, Camera]:
    """Read the left and the right camera from the keys of their calibrations, as `read_cameras`.

    Raises:
        CalibrationError: If a key is missing, malformed or unknown; names the path.
    """
    poses = _body_poses(*paths, *sheets)
    first, second = (
        _camera(path, sheet, T, images) for path, sheet, T in zip(paths, sheets, poses, strict=True)
    )
    return first, second


def read_sensor_pose(path: Path) -> Array | None:
    """Read T_BS (4, 4), a sensor in the body frame; None if it is not given.

    Raises:
        CalibrationError: If the file is missing or malformed.
    """
    return read_pose(path, read_yaml(path), "T_BS")


def _camera(path: Path, sheet: Sheet, T_body_cam: Array, images: Path | None) -> Camera:
    width, height = _size(path, sheet, images)
    lens, distortion = _distortion(path, sheet)
    K, line_time_s = _matrix_K(path, sheet), _line_time_s(path, sheet)
    return Camera(path, width, height, K, distortion, T_body_cam, lens, line_time_s)


def _line_time_s(path: Path, sheet: Sheet) -> float:
    """Return the time from one row's exposure to the next one's; 0, a global shutter, if unsaid."""
    key = next((x for x in LINE_TIMES if sheet.get(x) is not None), None)
    if key is None:
        return 0.0
    value = float(numbers(path, key, sheet[key], 1).item()) * LINE_TIMES[key]
    if not abs(value) <= MAX_LINE_TIME_S:
        raise CalibrationError(
            f"{path}: {key} must be at most {MAX_LINE_TIME_S / LINE_TIMES[key]:g}, is {sheet[key]}"
        )
    return value


def _size(path: Path, sheet: Sheet, images: Path | None) -> tuple[int, int]:
    for keys in SIZES:
        if all(key in sheet for key in keys):
            name = " and ".join(keys)
            values = numbers(path, name, [sheet[x] for x in keys] if keys[1:] else sheet[keys[0]])
            if values.shape != (2,) or (values % 1).any():
                raise CalibrationError(f"{path}: {name} must be width and height, px")
            return int(values[0]), int(values[1])
    if images and (files := list_images(images)):
        width, height = grey_reader(files[:1]).size_px
        remark(f"{path}: key 'resolution' is missing; the images have {width}x{height} px")
        return width, height
    raise CalibrationError(f"{path}: key 'resolution' is missing (or image_width, image_height)")


def _matrix_K(path: Path, sheet: Sheet) -> Array:
    found: dict[str, Array] = {}
    for key in INTRINSICS:
        if key in sheet:
            value: Any = sheet[key]
            if isinstance(value, Mapping) and all(x in value for x in FOCAL):
                value = [value[x] for x in FOCAL]
            values = numbers(path, key, value)
            if values.size == 9:
                found[key] = values.reshape(3, 3)
            elif values.shape == (4,):
                fx, fy, cx, cy = values
                found[key] = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
            else:
                raise CalibrationError(f"{path}: {key} must be [fx, fy, cx, cy] or a 3x3 matrix")
    if not found:
        raise CalibrationError(f"{path}: key 'intrinsics' is missing (or camera_matrix, K)")
    (name, K), *others = found.items()
    for other, matrix in others:
        if not np.allclose(K, matrix, equal_nan=True):
            raise CalibrationError(f"{path}: {name} and {other} differ")
    return K


def _distortion(path: Path, sheet: Sheet) -> tuple[Lens, Array]:
    lens, model = _lens(path, sheet)
    key = next((x for x in COEFFICIENTS if sheet.get(x) is not None), None)
    if key is None:
        if model:
            others = ", ".join(COEFFICIENTS[1:])
            raise CalibrationError(
                f"{path}: distortion model {model}, but key 'distortion_coefficients' is missing "
                f"(or {others})"
            )
        if unknown := [x for x in sheet if "dist" in x.lower() and x not in MODELS]:
            raise CalibrationError(
                f"{path}: key '{unknown[0]}' is unknown; expected {', '.join(COEFFICIENTS)}"
            )
        return Lens.RADIAL_TANGENTIAL, np.zeros(4)
    values = numbers(path, key, sheet[key]).ravel()
    if lens is None:
        if values.any():
            remark(f"{path}: {key} without distortion_model; radial-tangential is assumed")
        lens = Lens.RADIAL_TANGENTIAL
    if values.size not in COUNTS[lens]:
        valid = ", ".join(map(str, COUNTS[lens]))
        raise CalibrationError(f"{path}: {key} has {values.size} numbers; {lens.value} has {valid}")
    if values.size == 3:
        remark(f"{path}: the three numbers of {key} are taken for k1, k2, k3")
        values = np.r_[values[:2], 0, 0, values[2]]
    return lens, np.r_[values, np.zeros(max(0, 4 - values.size))]


def _lens(path: Path, sheet: Sheet) -> tuple[Lens | None, str]:
    """Return the lens that the models of camera and distortion name, and that name if any."""
    camera = str(sheet.get("camera_model") or "pinhole")
    implied = _named(path, "camera_model", camera, CAMERAS)
    if sheet.get("fisheye_model") in (1, True):  # of OpenCV's calibration sample
        return Lens.EQUIDISTANT, "fisheye_model"
    model = next((str(sheet[key]) for key in MODELS if sheet.get(key)), "")
    if model.lower() in ("", "none"):
        return implied, camera if implied else ""
    return _named(path, "distortion_model", model, LENSES), model


def _named(path: Path, key: str, name: str, valid: Mapping[str, Lens | None]) -> Lens | None:
    plain = {x.replace("-", "").replace("_", ""): value for x, value in valid.items()}
    word = name.lower().replace("-", "").replace("_", "").replace(" ", "")
    if word not in plain:
        raise CalibrationError(f"{path}: {key} {name}; valid: {', '.join(valid)}")
    return plain[word]


def _body_poses(
    left: Path, right: Path, sheet_left: Sheet, sheet_right: Sheet
) -> tuple[Array, Array]:
    """Return T_body_cam of both cameras."""
    poses = _T_body_cam(left, sheet_left), _T_body_cam(right, sheet_right)
    if poses[0] is not None and poses[1] is not None:
        return poses[0], poses[1]
    T_right_left = read_pose(right, sheet_right, "T_cn_cnm1")
    if T_right_left is None:
        T_right_left = _from_rectified(left, right, sheet_left, sheet_right)
    if T_right_left is None:
        path = left if poses[0] is None else right
        others = ", ".join((*POSES[1:], "rectification_matrix and projection_matrix"))
        raise CalibrationError(f"{path}: key 'T_BS' is missing (or {others})")
    T_body_left = np.eye(4) if poses[0] is None else poses[0]
    return T_body_left, T_body_left @ se3.inverse(T_right_left)


def _T_body_cam(path: Path, sheet: Sheet) -> Array | None:
    for key in BODY_POSES:
        if (T := read_pose(path, sheet, key)) is not None:
            return T
    T_cam_body = read_pose(path, sheet, "T_cam_imu")
    return None if T_cam_body is None else se3.inverse(T_cam_body)


def _from_rectified(left: Path, right: Path, a: Sheet, b: Sheet) -> Array | None:
    """Return T_right_left from ROS' rotations to rectified axes, and projections in these."""
    R: list[Array] = []
    x_m: list[float] = []
    for path, sheet in ((left, a), (right, b)):
        rotation, projection = (next((x for x in keys if x in sheet), "") for keys in RECTIFIED)
        if not rotation or not projection:
            return None
        R.append(numbers(path, rotation, sheet[rotation], 9).reshape(3, 3))
        P = numbers(path, projection, sheet[projection], 12).reshape(3, 4)
        if not P[0, 0] > 0:
            raise CalibrationError(f"{path}: {projection} must have a positive focal length")
        x_m.append(P[0, 3] / P[0, 0])
    return se3.pose(R[1].T @ R[0], R[1].T @ np.array([x_m[1] - x_m[0], 0, 0]))
