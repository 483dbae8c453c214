"""Tutorials that are programs run as they stand; those that are pages do in another test."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.gl

TUTORIALS = Path(__file__).parents[2] / "docs" / "tutorials"


def run(tutorial: str, *words: str) -> str:
    done = subprocess.run(
        [sys.executable, str(TUTORIALS / tutorial), *words],
        capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


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
