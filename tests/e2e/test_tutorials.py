"""The tutorials run as they stand, in a small world."""

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


def test_own_estimator_is_compared(tmp_path):
    output = run("own_estimator.py", str(write_yard(tmp_path)), "30")
    errors = {name: float(cm) for name, cm in re.findall(r"(\S+) +([\d.]+) cm", output)}
    assert set(errors) == {"own_estimator:CornerPnp", "vo", "wheels"}
    assert 0.0 < errors["own_estimator:CornerPnp"] < 10.0
