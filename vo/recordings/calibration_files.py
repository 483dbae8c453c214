"""YAML files of calibrations: of one camera each, or of both, in the keys of several programs."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from vo.contract import se3
from vo.contract.arrays import Array
from vo.contract.errors import CalibrationError
from vo.contract.files import read_lines

FOCAL, KANNALA_BRANDT = ("fx", "fy", "cx", "cy"), ("mu", "mv", "u0", "v0")
RADIAL_TANGENTIAL = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
OPENCV = (("M{}", "D{}"), ("K{}", "D{}"), ("cameraMatrix{}", "distCoeffs{}"))
"""Names of the matrices and coefficients of cameras 1 and 2 in files of OpenCV's users."""

SHARED = ("image_size", "image_width", "image_height", "distortion_model", "fisheye_model")
"""Keys of such a file that hold for both cameras."""

ORBSLAM_BODY = ("IMU.T_b_c1", "Tbc")
"""Names of the pose of ORB-SLAM's left camera in the body."""

MISSING_BLANK = re.compile(r"^(\s*[A-Za-z_][\w.]*:)(?=[^\s:/])")
"""Key without a blank after its colon, which OpenCV reads and ORB-SLAM's files have."""

ROTATION = 1e-3
"""Largest difference of R Rᵀ of a pose from the identity."""

Sheet = Mapping[str, Any]
"""Calibration of one camera by the keys of ASL, Kalibr or ROS."""


class _Loader(yaml.SafeLoader):
    """Loader that reads a value of any tag, such as `!!opencv-matrix`, as if it had none."""


def _untagged(loader: yaml.SafeLoader, _: str, node: yaml.Node) -> Any:
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node) if isinstance(node, yaml.ScalarNode) else None


_Loader.add_multi_constructor("", _untagged)


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a mapping from YAML, or from OpenCV's dialect of it (`%YAML:1.0`).

    Raises:
        CalibrationError: If the file is missing or holds none; names file and line.
    """
    # The version line of OpenCV is not YAML; a blank one keeps the numbers of lines.
    lines = read_lines(path, CalibrationError)
    if any(x.startswith("%YAML:") for x in lines):
        lines = [MISSING_BLANK.sub(r"\1 ", x) for x in lines]
    try:
        content = yaml.load("\n".join("" if x.startswith("%YAML") else x for x in lines), _Loader)
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or error
        place = f"{path}:{mark.line + 1}" if mark else f"{path}"
        raise CalibrationError(f"{place}: not valid YAML ({problem})") from None
    if not isinstance(content, dict):
        raise CalibrationError(f"{path}: holds no calibration")
    return {str(key): value for key, value in content.items()}


def read_sheets(left: Path, right: Path) -> tuple[Sheet, Sheet]:
    """Read the sheets of both cameras, from a file each or from one of both.

    Raises:
        CalibrationError: If a file is missing, malformed, or lacks a key of its program.
    """
    first, second = read_yaml(left), read_yaml(right)
    if left == right and (both := _of_both(left, first)):
        return both
    return _camodocal(_part(first, "cam0")), _camodocal(_part(second, "cam1"))


def find_stereo_file(folders: Sequence[Path]) -> Path | None:
    """Return the YAML file of both cameras in the first folder that has one.

    Of several, that with the inertial unit (Kalibr's camchain-imucam) is preferred.

    Raises:
        CalibrationError: If such a file lacks a key of its program.
    """
    for folder in folders:
        files = sorted(x for x in folder.glob("*.y*ml") if _of_both(x, _content(x)))
        if files:
            return next((x for x in files if "imu" in x.name), files[0])
    return None


def numbers(path: Path, key: str, value: Any, size: int | None = None) -> Array:
    """Return numbers from a list, from rows, or from a mapping with `data`, as of OpenCV.

    Raises:
        CalibrationError: If there are others, or not `size` of them; names file and key.
    """
    if isinstance(value, Mapping):
        if "data" not in value:
            raise CalibrationError(f"{path}: {key}: key 'data' is missing")
        value = value["data"]
    try:
        values = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise CalibrationError(f"{path}: {key} must hold numbers only") from None
    if size is not None and values.size != size:
        raise CalibrationError(f"{path}: {key} has {values.size} numbers; expected {size}")
    return values


def read_pose(path: Path, sheet: Sheet, key: str) -> Array | None:
    """Return the pose (4, 4), or its upper rows, of a key; None without the key.

    Raises:
        CalibrationError: If it is not rigid; names file and key. NaN is kept.
    """
    if sheet.get(key) is None:
        return None
    values = numbers(path, key, sheet[key]).ravel()
    T = np.r_[values, [0, 0, 0, 1]] if values.size == 12 else values
    T = T.reshape(4, 4) if T.size == 16 else np.zeros((4, 4))
    R = T[:3, :3]
    if np.isfinite(T).all():
        straight = np.allclose(R @ R.T, np.eye(3), atol=ROTATION) and np.linalg.det(R) > 0
        if not straight or not np.allclose(T[3], [0, 0, 0, 1], atol=1e-6):
            raise CalibrationError(f"{path}: {key} is not a rigid 4x4 transform, row by row")
    return T


def _part(content: Sheet, key: str) -> Sheet:
    return content[key] if isinstance(content.get(key), Mapping) else content


def _content(path: Path) -> Sheet:
    try:
        return read_yaml(path)
    except CalibrationError:
        return {}


def _of_both(path: Path, content: Sheet) -> tuple[Sheet, Sheet] | None:
    """Return the sheets of both cameras from a file of any known program; None if it has none."""
    for read in (_kalibr, _orbslam_maps, _orbslam, _vins, _opencv):
        if sheets := read(path, content):
            return sheets
    return None


def _need(path: Path, content: Sheet, key: str) -> Any:
    if content.get(key) is None:
        raise CalibrationError(f"{path}: key '{key}' is missing")
    return content[key]


def _kalibr(_: Path, content: Sheet) -> tuple[Sheet, Sheet] | None:
    left, right = (content.get(x) for x in ("cam0", "cam1"))
    return (left, right) if isinstance(left, Mapping) and isinstance(right, Mapping) else None


def _orbslam_maps(path: Path, content: Sheet) -> tuple[Sheet, Sheet] | None:
    """Read the raw cameras of ORB-SLAM2, of which it computes the rectification."""
    if "LEFT.K" not in content:
        return None
    left, right = (
        {key: _need(path, content, f"{side}.{key}") for key in ("width", "height", *"KDRP")}
        | {"distortion_model": "radial-tangential"}
        for side in ("LEFT", "RIGHT")
    )
    return left | _some(content, ORBSLAM_BODY), right


def _some(content: Sheet, keys: Sequence[str]) -> dict[str, Any]:
    return {x: content[x] for x in keys if x in content}


def _orbslam(path: Path, content: Sheet) -> tuple[Sheet, Sheet] | None:
    """Read ORB-SLAM2's and 3's settings: `Camera.*`, or `Camera1.*` and `Camera2.*`."""
    left = next((x for x in ("Camera1", "Camera") if f"{x}.fx" in content), "")
    transform = next((x for x in ("Stereo.T_c1_c2", "Tlr") if x in content), "")
    if not left or not (transform or {"Stereo.b", "Camera.bf"} & content.keys()):
        return None
    right = "Camera2" if "Camera2.fx" in content else left
    names = RADIAL_TANGENTIAL
    if "kannala" in (model := str(content.get("Camera.type", "PinHole"))).lower():
        names = ("k1", "k2", "k3", "k4")
    sheets: list[dict[str, Any]] = []
    for eye in (left, right):
        found = [content.get(f"{eye}.{x}", content.get(f"{left}.{x}")) for x in names]
        sheets.append({
            "camera_model": model,
            "resolution": [_need(path, content, f"Camera.{x}") for x in ("width", "height")],
            "intrinsics": [_need(path, content, f"{eye}.{x}") for x in FOCAL],
            "distortion_coefficients": [x for x in found if x is not None],
            "distortion_model": "" if names is not RADIAL_TANGENTIAL else "radial-tangential",
        })  # fmt: skip
    T_left_right = read_pose(path, content, transform)
    if T_left_right is None:
        T_left_right = np.eye(4)
        key = "Stereo.b" if "Stereo.b" in content else "Camera.bf"
        f_px = 1.0 if key == "Stereo.b" else numbers(path, "fx", content[f"{left}.fx"], 1).item()
        T_left_right[0, 3] = (numbers(path, key, content[key], 1) / f_px).item()
    sheets[1]["T_cn_cnm1"] = se3.inverse(T_left_right)
    return sheets[0] | _some(content, ORBSLAM_BODY), sheets[1]


def _vins(path: Path, content: Sheet) -> tuple[Sheet, Sheet] | None:
    """Read VINS-Fusion's configuration, which names a file for each camera."""
    if "cam0_calib" not in content or "cam1_calib" not in content:
        return None
    left, right = (
        {
            **_camodocal(read_yaml(path.parent / str(content[f"cam{i}_calib"]))),
            f"body_T_cam{i}": _need(path, content, f"body_T_cam{i}"),
        }
        for i in (0, 1)
    )
    return left, right


def _camodocal(content: Sheet) -> Sheet:
    """Translate a camera file of VINS; others stay as they are."""
    lens, projection = (
        content.get("distortion_parameters", {}),
        content.get("projection_parameters"),
    )
    if not isinstance(lens, Mapping) or not isinstance(projection, Mapping):
        return content
    known = {**lens, **projection}
    focal, names = FOCAL, RADIAL_TANGENTIAL
    if "mu" in known:
        focal, names = KANNALA_BRANDT, ("k2", "k3", "k4", "k5")
    return {
        **content,
        "camera_model": content.get("model_type"),
        "intrinsics": [known.get(x) for x in focal],
        "distortion_coefficients": [known[x] for x in names if x in known],
        "distortion_model": "radial-tangential" if focal is FOCAL else "",
    }


def _opencv(path: Path, content: Sheet) -> tuple[Sheet, Sheet] | None:
    """Read what `cv::stereoCalibrate` gives, as its sample names it; R and T may be beside it."""
    names = next((x for x in OPENCV if all(x[0].format(i) in content for i in (1, 2))), None)
    if names is None:
        return None
    files = (content, *(_content(x) for x in sorted(path.parent.glob("*.y*ml"))))
    poses = next((x for x in files if "R" in x and "T" in x), content)
    R = numbers(path, "R", _need(path, poses, "R"), 9).reshape(3, 3)
    t = numbers(path, "T", _need(path, poses, "T"), 3).ravel()
    left, right = (
        {
            **_some(content, SHARED),
            "camera_matrix": content[names[0].format(i)],
            "distortion_coefficients": _need(path, content, names[1].format(i)),
        }
        for i in (1, 2)
    )
    return left, right | {"T_cn_cnm1": se3.pose(R, t)}
