"""The real command line in a process of its own."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def driftyard(
    *words: object, cwd: Path, timeout_s: float = 120
) -> subprocess.CompletedProcess[str]:
    """Run `driftyard` with words in a folder."""
    command = [sys.executable, "-m", "trials.cli", *map(str, words)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        command,
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )
