"""Someone else's estimator on the command line: a class, or a program."""

import sys

import pytest
from folders import wall, write_euroc
from terminal import driftyard

from trials.estimators.choice import ESTIMATORS
from trials.evaluation.runs import read_run

STEP_M = 0.05
FRAMES = 6

OWN = f"""
import numpy as np
from pydantic import Field
from vo.contract.estimator import Estimate, Status
from vo.contract.settings import Settings

class Sliding:
    class Settings(Settings):
        step_m: float = Field(default={STEP_M}, gt=0)

    def __init__(self, rig, settings):
        self.settings, self.frames = settings, 0

    def track(self, frame):
        T = np.eye(4)
        T[0, 3] = self.frames * self.settings.step_m
        self.frames += 1
        if self.frames == 4:
            raise ValueError("no [bold] idea")
        return Estimate(frame.timestamp_ns, Status.TRACKED, T)

class Hopeless:
    def __init__(self, rig):
        pass

    def track(self, frame):
        raise ValueError("never")
"""

PROGRAM = f"""
import pathlib, sys
dataset, out = map(pathlib.Path, sys.argv[1:3])
rows = (dataset / "mav0/cam0/data.csv").read_text().splitlines()[1:]
times = [int(row.split(",")[0]) / 1e9 for row in rows]
print("looking at", dataset)
lines = [f"{{t}} {{i * {STEP_M}}} 0 0 0 0 0 1" for i, t in enumerate(times)]
out.write_text("\\n".join(lines))
"""


@pytest.fixture
def place(tmp_path):
    """A working directory with a dataset that moves by STEP_M a frame, and estimators of it."""
    write_euroc(tmp_path / "drive", wall(FRAMES), truth_step_m=STEP_M)
    (tmp_path / "mine.py").write_text(OWN)
    (tmp_path / "program.py").write_text(PROGRAM)
    return tmp_path


def test_help_of_run_lists_every_estimator(tmp_path):
    shown = driftyard("run", "--help", cwd=tmp_path).stdout
    assert all(name in shown for name in ESTIMATORS)


def test_run_plugin_class_writes_all_files(place):
    words = ("run", "drive", "--out", "a.tum", "--estimator", "mine:Sliding")
    result = driftyard(*words, cwd=place)
    assert result.returncode == 0, result.stderr
    assert "6 frames, 1 lost, " in result.stdout
    assert result.stdout.endswith("; the first lost: ValueError: no [bold] idea\n")
    saved = read_run(place / "a.tum")
    assert saved.about["settings"] == {"step_m": STEP_M}
    assert saved.frames.reason[3] == "ValueError: no [bold] idea"
    assert saved.trajectory.T_ref_frame[-1, 0, 3] == pytest.approx(STEP_M * (FRAMES - 1))
    result = driftyard(*words, "--set", "step_m=0.1", cwd=place)
    assert result.returncode == 0, result.stderr
    assert read_run(place / "a.tum").about["settings"] == {"step_m": 0.1}


def test_run_program_writes_all_files(place):
    command = f"{sys.executable} program.py {{dataset}} {{out}}"
    words = ("run", "drive", "--out", "a.tum", "--command", command, "--label", "mine")
    result = driftyard(*words, "--timeout", "60", cwd=place)
    assert result.returncode == 0, result.stderr
    assert "6 frames, 0 lost, " in result.stdout
    assert "looking at" in (place / "a.printed.txt").read_text()
    score = driftyard("score", "drive", "a.tum", cwd=place)
    assert score.returncode == 0, score.stderr
    assert "mine" in score.stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--command", "slam {dataset}"), "{out} is missing"),
        (("--command", "slam {dataset} {out}"), "cannot run slam"),
        (("--command", "false {dataset} {out}"), "false failed with exit status 1"),
        (("--command", "sleep 9 {dataset} {out}"), "sleep failed with exit status 1"),
        (
            ("--command", "sh -c 'sleep 9' {dataset} {out}", "--timeout", "0.5"),
            "sh was stopped after 0.5 s (--timeout)",
        ),
        (("--command", "true {dataset} {out}"), "true wrote no trajectory"),
        (("--command", "cp {dataset}/mav0/cam0/data.csv {out}"), "malformed trajectory, line 2"),
        (("--command", "true {dataset} {out}", "--set", "a=1"), "--command: takes no"),
        (("--command", "true {dataset} {out}", "--estimator", "driftyard"), "--command: takes no"),
        (("--estimator", "mine:Sliding", "--set", "step_m=-1"), "setting step_m"),
        (("--estimator", "mine:Sliding", "--set", "step=1"), "unknown setting step; valid here"),
        (("--estimator", "mine:Nothing"), "mine has no class Nothing"),
    ],
)
def test_run_bad_plugin_ends_in_one_line(words, message, place):
    result = driftyard("run", "drive", "--out", "a.tum", *words, cwd=place)
    assert result.returncode == 2
    assert message in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not (place / "a.tum").exists()


def test_run_always_failing_plugin_ends_in_one_line(place):
    write_euroc(place / "long", wall(25))
    words = ("run", "long", "--out", "a.tum", "--estimator", "mine:Hopeless")
    result = driftyard(*words, cwd=place)
    assert result.returncode == 2
    assert "failed on 21 frames in a row" in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not (place / "a.tum").exists()
