"""Systems by others: the pipe to another process, and those that can run here."""

import os
import shutil
import sys
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from folders import BASELINE_M, DISPARITY_PX, F_PX, HEIGHT, PERIOD_NS, WIDTH, wall
from terminal import ROOT

from trials.estimators.choice import check_settings, make_estimator
from trials.estimators.plugins import PluginError
from trials.estimators.plugins.classes import Guarded
from trials.estimators.systems import environments, subprocess_estimator
from trials.estimators.systems.environments import (
    FOLDER_VARIABLE,
    ForeignSystemError,
    folder_of,
    is_installed,
)
from trials.estimators.systems.subprocess_estimator import SubprocessEstimator
from vo.contract.errors import SettingsError
from vo.contract.estimator import Status
from vo.contract.rig import StereoRig
from vo.contract.sequence import StereoFrame

RIG = StereoRig(WIDTH, HEIGHT, F_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, BASELINE_M)
STEP_PX = 4
STEP_M = STEP_PX / DISPARITY_PX * BASELINE_M

WORKER = """
import os, sys, time
import numpy as np
from pipe import serve

def start(rig):
    print("the system talks")
    os.system("echo its libraries talk too")
    if rig.get("refuse"):
        sys.exit("no licence")

    def track(t, left, right):
        print("about every frame")
        if rig.get("hang"):
            time.sleep(60)
        if left.max() == 0:
            return None, "dark"
        if left.max() == 1:
            raise ValueError("segmentation fault, as it were")
        T = np.eye(4)
        T[:3, 3] = [t, left.mean(), right.mean()]
        return T, "ok"

    return track

serve(start)
"""


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """An environment with this interpreter, and a worker that is no system at all."""
    python = tmp_path / "systems" / "toy_vo" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "systems"))
    workers = tmp_path / "workers"
    workers.mkdir()
    shutil.copy(subprocess_estimator.WORKERS / "pipe.py", workers)
    (workers / "toy_vo_worker.py").write_text(WORKER)
    monkeypatch.setattr(subprocess_estimator, "WORKERS", workers)


def frame(i, left, right):
    eyes = (np.full((HEIGHT, WIDTH), grey, np.uint8) for grey in (left, right))
    return StereoFrame(i * PERIOD_NS, *eyes)


def test_worker_receives_frames_and_returns_poses(installed):
    system = SubprocessEstimator("toy_vo", RIG, {})
    estimates = [system.track(frame(i, *eyes)) for i, eyes in enumerate([(7, 9), (0, 5), (8, 6)])]
    assert [x.status for x in estimates] == [Status.START, Status.LOST, Status.TRACKED]
    assert estimates[0].T_odom_cam[:3, 3].tolist() == [0, 7, 9]
    assert estimates[2].T_odom_cam[:3, 3].tolist() == [0.2, 8, 6]
    assert estimates[1].reason == "dark"
    assert all(x.timings_ms["track"] > 0 for x in estimates)
    assert estimates[2].timestamp_ns == 2 * PERIOD_NS
    process = system._process
    system.finalize()
    assert process.returncode == 0


def test_worker_that_dies_gives_its_last_line(installed):
    with pytest.raises(PluginError, match="toy_vo ended with exit status 1: no licence"):
        SubprocessEstimator("toy_vo", RIG, {"refuse": True})
    system = SubprocessEstimator("toy_vo", RIG, {})
    for _ in range(2):
        with pytest.raises(PluginError, match="segmentation fault, as it were"):
            system.track(frame(0, 1, 1))


def test_worker_that_ends_ends_the_run_at_its_frame(installed):
    guarded = Guarded(SubprocessEstimator("toy_vo", RIG, {}))
    assert guarded.track(frame(0, 7, 7)).status is Status.START
    with pytest.raises(PluginError, match="exit status 1: ValueError: segmentation fault"):
        guarded.track(frame(1, 1, 1))


def test_worker_that_answers_nonsense_is_ended(installed):
    (subprocess_estimator.WORKERS / "toy_vo_worker.py").write_text("print('hello')")
    with pytest.raises(PluginError, match="toy_vo answers what is no JSON: hello"):
        SubprocessEstimator("toy_vo", RIG, {})


def test_worker_that_hangs_is_killed(installed):
    system = SubprocessEstimator("toy_vo", RIG, {"hang": True}, timeout_s=1.0)
    process = system._process
    with pytest.raises(PluginError, match="toy_vo does not answer for 1 s"):
        system.track(frame(0, 7, 7))
    assert process.returncode is not None


def test_worker_of_a_deleted_estimator_ends(installed):
    system = SubprocessEstimator("toy_vo", RIG, {})
    process = system._process
    del system
    assert process.returncode == 0


def test_python_of_missing_system_names_the_command(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    with pytest.raises(ForeignSystemError, match=r"driftyard systems install toy_vo"):
        make_estimator("toy_vo", RIG)
    with pytest.raises(SettingsError, match="unknown system basalt; valid: orbslam3, toy_vo"):
        folder_of("basalt")
    with pytest.raises(SettingsError, match="vocabulary: no such file nowhere"):
        make_estimator("orbslam3", RIG, None, ["vocabulary=nowhere"])
    with pytest.raises(ForeignSystemError, match=rf"unpack .*ORBvoc.txt.tar.gz.* to {tmp_path}"):
        make_estimator("orbslam3", RIG)


def test_every_system_names_a_class_that_is_there():
    for name, package in environments.SYSTEMS.items():
        check_settings(name)
        assert package.requirements[0].count("==") == 1
        assert (subprocess_estimator.WORKERS / f"{name}_worker.py").is_file()


def test_extra_has_the_versions_of_the_environments():
    """It has those systems alone whose packages suit the ones of the project."""
    extra = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    pinned = {x for name in ("orbslam3", "toy_vo") for x in environments.SYSTEMS[name].requirements}
    assert set(extra["systems"]) == pinned


def test_system_beside_driftyard_needs_no_environment(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "none"))
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "toy_vo.py").touch()
    assert is_installed("toy_vo")
    assert environments.python_of("toy_vo") == Path(sys.executable)


def test_install_failure_names_the_reason(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    impossible = environments.Package("", (f"{tmp_path}/no-such-wheel.whl",), "", "")
    monkeypatch.setitem(environments.SYSTEMS, "toy_vo", impossible)
    with pytest.raises(ForeignSystemError, match=r"cannot install toy_vo: .*no-such-wheel"):
        environments.install("toy_vo")
    assert not folder_of("toy_vo").exists()  # it would count as installed


def slide(estimator, frames=6):
    """Track a wall that passes by; returns the estimates."""
    pairs = wall(frames, STEP_PX)
    return [estimator.track(StereoFrame(i * PERIOD_NS, *pair)) for i, pair in enumerate(pairs)]


@pytest.mark.skipif(not hasattr(cv2, "Odometry"), reason="OpenCV has no cv2.Odometry")
def test_rgbd_odometry_before_a_wall_is_accurate():
    estimator, settings = make_estimator("opencv_rgbd", RIG, None, ["method=rgb_depth"])
    assert settings["method"] == "rgb_depth"
    estimates = slide(estimator)
    assert [x.status.value for x in estimates] == ["start"] + ["tracked"] * 5
    moved = estimates[-1].T_odom_cam[:3, 3]
    assert 1e-6 < np.linalg.norm(moved - [5 * STEP_M, 0, 0]) < 0.02  # turning looks alike
    blank = np.zeros((HEIGHT, WIDTH), np.uint8)
    lost = estimator.track(StereoFrame(6 * PERIOD_NS, blank, blank))
    assert (lost.status, lost.reason) == (Status.LOST, "no alignment")


@pytest.mark.parametrize("name", ["toy_vo", "openvo", "open3d_rgbd", "cuvslam"])
def test_installed_system_before_a_wall_is_accurate(name):
    if not is_installed(name):
        pytest.skip(f"{name} is not installed")
    estimates = slide(make_estimator(name, RIG)[0])
    moved = estimates[-1].T_odom_cam[:3, 3]
    assert 1e-6 < np.linalg.norm(moved - [5 * STEP_M, 0, 0]) < 0.05  # turning looks alike


VOCABULARY = os.environ.get("DRIFTYARD_ORB_VOCABULARY", "")


@pytest.mark.skipif(
    not VOCABULARY or not (folder_of("orbslam3") / "bin/python").exists(),
    reason="ORB-SLAM3 is not installed, or DRIFTYARD_ORB_VOCABULARY not set",
)
def test_orbslam3_before_a_wall_is_accurate():
    setting = f"vocabulary={VOCABULARY}"
    estimates = slide(make_estimator("orbslam3", RIG, None, [setting])[0])
    moved = estimates[-1].T_odom_cam[:3, 3]
    assert 1e-6 < np.linalg.norm(moved - [5 * STEP_M, 0, 0]) < 0.03
