"""Odometry systems by other authors: the package of each, and its virtual environment."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import cv2

from vo.contract.errors import DriftyardError, SettingsError

FOLDER_VARIABLE = "DRIFTYARD_SYSTEMS"
"""Environment variable that names the folder of the environments."""


class ForeignSystemError(DriftyardError):
    """A system is not installed, cannot be installed, or has ended."""


@dataclass(frozen=True)
class Package:
    """A system as a package.

    Attributes:
        about: What it is, in a few words.
        requirements: Pinned, for pip.
        license: Its license.
        estimator: Its class, `module:Class`.
        needs: What else the user provides; empty if nothing.
        is_deterministic: Whether equal runs have equal results.
        is_here: Whether the interpreter of this project can run it, without an environment.
    """

    about: str
    requirements: tuple[str, ...]
    license: str
    estimator: str
    needs: str = ""
    is_deterministic: bool = True
    is_here: Callable[[], bool] = lambda: False


_HERE = "trials.estimators.systems"
SYSTEMS = {
    "orbslam3": Package(
        "ORB-SLAM3, stereo, with loop closing",
        ("pyorbslam3==0.1.1",),
        "GPL-3.0",
        f"{_HERE}.orbslam3:OrbSlam3",
        "its vocabulary, --set vocabulary=FILE; Debian's libgl1 libegl1 libopengl0 libsm6 libice6",
        is_deterministic=False,
        is_here=lambda: find_spec("pyorbslam3") is not None,
    ),
    "toy_vo": Package(
        "stereo flow and a window of keyframes, after Basalt",
        ("toy-vo==0.1.1",),
        "GPL-2.0-or-later",
        f"{_HERE}.toy_vo:ToyVo",
        is_here=lambda: find_spec("toy_vo") is not None,
    ),
    "opencv_rgbd": Package(
        "dense RGB-D odometry of OpenCV, on estimated disparity",
        ("opencv-python-headless==5.0.0.93",),
        "Apache-2.0",
        f"{_HERE}.rgbd:RgbdOdometry",
        is_here=lambda: hasattr(cv2, "Odometry"),
    ),
    "open3d_rgbd": Package(
        "dense RGB-D odometry of Open3D, on estimated disparity",
        ("open3d-cpu==0.20.0",),
        "MIT",
        f"{_HERE}.open3d_rgbd:Open3dOdometry",
        "Debian's libgl1 libgomp1 libusb-1.0-0",
    ),
    "openvo": Package(
        "ORB matches between points of semi-global matching",
        ("openVO==0.0.6", "opencv-python-headless==4.12.0.88"),
        "MIT",
        f"{_HERE}.openvo:OpenVo",
    ),
    "cuvslam": Package(
        "cuVSLAM of NVIDIA, stereo, through dim-odom",
        ("dim-odom==0.4.2", "numpy"),
        "Apache-2.0",
        f"{_HERE}.cuvslam:CuVslam",
        "1.5 GB of packages; a GPU only for --set use_gpu=true",
        is_deterministic=False,
    ),
}


def package_of(system: str) -> Package:
    """Return the package of a system; SettingsError if it is unknown."""
    if system not in SYSTEMS:
        raise SettingsError(f"unknown system {system}; valid: {', '.join(SYSTEMS)}")
    return SYSTEMS[system]


def folder_of(system: str) -> Path:
    """Return the folder of a system, which may not exist; SettingsError if it is unknown."""
    package_of(system)
    return systems_folder() / system


def systems_folder() -> Path:
    """Return the folder of all environments."""
    default = Path.home() / ".cache" / "driftyard" / "systems"
    return Path(os.environ.get(FOLDER_VARIABLE, default))


def python_of(system: str) -> Path:
    """Return the interpreter that runs a system; ForeignSystemError if it is not installed."""
    python = folder_of(system) / "bin" / "python"
    if python.exists():
        return python
    if SYSTEMS[system].is_here():
        return Path(sys.executable)
    raise ForeignSystemError(
        f"{system} is not installed; `driftyard systems install {system}` installs it in "
        f"{folder_of(system)}"
    )


def is_installed(system: str) -> bool:
    """Whether there is an interpreter that runs the system."""
    return (folder_of(system) / "bin" / "python").exists() or SYSTEMS[system].is_here()


def install(system: str) -> Path:
    """Create a system's environment, return its interpreter; ForeignSystemError if pip fails."""
    folder, package = folder_of(system), SYSTEMS[system]
    python = folder / "bin" / "python"
    steps = (
        (sys.executable, "-m", "venv", "--clear", str(folder)),
        (str(python), "-m", "pip", "install", "--quiet", *package.requirements),
    )
    try:
        for step in steps:
            done = subprocess.run(step, capture_output=True, text=True, check=False)
            if done.returncode:
                last = (done.stderr.strip().splitlines() or ["no message"])[-1]
                raise ForeignSystemError(f"cannot install {system}: {last}")
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)  # an unfinished one would count as installed
        raise
    return python
