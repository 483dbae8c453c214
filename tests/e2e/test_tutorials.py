"""The tutorials run as they stand, in a small world."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from gym_worlds import write_yard

pytestmark = pytest.mark.gl

TUTORIALS = Path(__file__).parents[2] / "docs" / "tutorials"


def run(tutorial: str, *words: str) -> str:
    done = subprocess.run(
        [sys.executable, str(TUTORIALS / tutorial), *words],
        capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_first_trial_is_scored(tmp_path):
    output = run("first_trial.py", str(write_yard(tmp_path)))
    spl, error_mm = re.search(r"SPL ([\d.]+), localized to ([\d.]+) mm", output).groups()
    assert output.startswith("success after ")
    assert 0.5 < float(spl) <= 1.0
    assert 0.0 < float(error_mm) < 150.0


def test_first_trial_takes_twenty_lines():
    code = (TUTORIALS / "first_trial.py").read_text().split('"""')[2]
    assert len([line for line in code.splitlines() if line.strip()]) <= 20


def test_policy_is_trained_and_evaluated(tmp_path):
    pytest.importorskip("stable_baselines3")
    few = ("--steps", "400", "--pens", "2", "--new-pens", "1", "--runs", "1")
    output = run("train_policy.py", str(tmp_path), *few)
    assert "| 1 pens x 1 | trained | navigator | goal alone |" in output
    written = {"policy.zip", "learning_curve.csv", "learning_curve.png", "evaluation.csv"}
    assert written <= {file.name for file in tmp_path.iterdir()}
    curve = (tmp_path / "learning_curve.csv").read_text().splitlines()
    assert curve[0] == "steps,trials,return,success,collision,timeout"
    assert len((tmp_path / "evaluation.csv").read_text().splitlines()) == 4


def test_training_without_its_extra_says_what_to_install(tmp_path):
    (tmp_path / "torch.py").write_text("raise ModuleNotFoundError(name='torch')")
    done = subprocess.run(
        [sys.executable, str(TUTORIALS / "train_policy.py"), "out"], cwd=tmp_path,
        capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"},
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr == 'torch is missing: pip install "driftyard[rl]"\n'


def test_own_estimator_is_compared(tmp_path):
    output = run("own_estimator.py", str(write_yard(tmp_path)), "30")
    errors = {name: float(cm) for name, cm in re.findall(r"(\S+) +([\d.]+) cm", output)}
    assert set(errors) == {"own_estimator:CornerPnp", "vo", "wheels"}
    assert 0.0 < errors["own_estimator:CornerPnp"] < 10.0
