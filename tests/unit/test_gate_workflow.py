"""The sample workflow of the gate: what each exit status does to the job."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

WORKFLOW = Path(__file__).parents[2] / "docs" / "examples" / "driftyard-gate.yml"
PROGRAM = """#!/bin/sh
printf '### driftyard gate\\n\\nundecided: drift may or may not have increased\\n' > gate.md
exit $STATUS
"""


@pytest.mark.skipif(shutil.which("bash") is None, reason="the workflow's shell is bash")
@pytest.mark.parametrize(
    ("status", "undecided", "exit_status", "told"),
    [
        (0, "fail", 0, ""),
        (1, "warn", 1, "::error title=driftyard gate::undecided: drift"),
        (2, "warn", 2, ""),
        (3, "warn", 0, "::warning title=driftyard gate undecided::undecided: drift"),
        (3, "fail", 3, "::error title=driftyard gate undecided::undecided: drift"),
        (0, "Fail", 2, "UNDECIDED: unknown Fail; valid: warn, fail"),
    ],
)
def test_workflow_undecided_is_shown(tmp_path, status, undecided, exit_status, told):
    """A program of that name ends with the status instead of the gate, which takes minutes."""
    job = yaml.safe_load(WORKFLOW.read_text(encoding="utf-8"))["jobs"]["gate"]
    assert job["env"] == {"UNDECIDED": "warn"}
    (step,) = [x for x in job["steps"] if x.get("id") == "gate"]
    program = tmp_path / "driftyard"
    program.write_text(PROGRAM)
    program.chmod(0o755)
    env = {
        "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}", "STATUS": str(status),
        "UNDECIDED": undecided, "GITHUB_STEP_SUMMARY": str(tmp_path / "summary"),
    }  # fmt: skip
    script = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
    ran = subprocess.run(script, cwd=tmp_path, env=env, capture_output=True, text=True)
    assert ran.returncode == exit_status, ran.stderr
    assert ran.stdout.startswith(told) if told.startswith("::") else told in ran.stdout
    assert bool(ran.stdout) == bool(told)
    assert (tmp_path / "summary").exists() == (undecided != "Fail")
