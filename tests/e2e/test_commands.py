"""Commands that need no dataset, and the interrupt key."""

import signal
import subprocess
import sys
import time

import pytest
from terminal import ROOT, driftyard, driftyard_process

PLANE = """<mujoco><worldbody><geom type="plane" size="5 5 1"/></worldbody></mujoco>"""


def test_scenes_lists_scenes_and_disturbances(tmp_path):
    result = driftyard("scenes", cwd=tmp_path)
    assert result.returncode == 0
    assert "brick_court" in result.stdout
    assert "office" in result.stdout


@pytest.mark.gl
def test_doctor_reports_a_working_driver(tmp_path):
    result = driftyard("doctor", cwd=tmp_path)
    assert result.returncode == 0, result.stdout
    assert "renders: " in result.stdout
    assert "gtsam" in result.stdout


@pytest.mark.gl
def test_doctor_unusable_variable_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", "[/abc]")
    monkeypatch.setenv("COLUMNS", "200")
    result = driftyard_process("doctor", cwd=tmp_path)
    assert result.returncode == 1, result.stderr
    assert "no: MUJOCO_EGL_DEVICE_ID=[/abc]: " in result.stdout
    assert result.stderr == ""


def test_unusable_mujoco_gl_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "foo")
    result = driftyard_process("scenes", cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr.splitlines() == [
        "driftyard: error: no OpenGL: MUJOCO_GL=foo: no such backend; unset it, or set egl or "
        "osmesa"
    ]


def test_import_of_the_command_line_is_light(tmp_path):
    code = (
        "import sys, trials.cli.main; "
        "sys.exit(', '.join({'cv2', 'mujoco', 'gtsam', 'numba', 'scipy'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert result.stderr.strip() == ""


@pytest.mark.gl
def test_interrupted_recording_leaves_no_files(tmp_path):
    (tmp_path / "plane.xml").write_text(PLANE)
    words = ("generate", "plane.xml", "--out", "o", "--set", "drive.distance_m=1")
    process = subprocess.Popen(
        [sys.executable, "-m", "trials.cli", *words],
        cwd=tmp_path,
        env={"PYTHONPATH": str(ROOT), "PATH": ""},
        stderr=subprocess.PIPE,
        text=True,
        # What a shell starts in the background ignores interrupts, and so would its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    images = tmp_path / ".o.partial/mav0/cam0/data"
    deadline = time.monotonic() + 120
    while not (images.is_dir() and any(images.iterdir())):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=30)
    assert process.returncode == 130, stderr
    assert stderr.splitlines()[-1] == "driftyard: interrupted"
    assert [path.name for path in tmp_path.iterdir()] == ["plane.xml"]
