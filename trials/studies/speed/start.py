"""Time until the first result: of a new installation, of a later run, and of environments.

Each is measured in a process of its own, from its start, imports included.
"""

import os
import resource
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

import numpy as np
from rich.table import Table

from trials.report.tables import text_table

RUN = """
import os, sys, time
import trials.cli.main, trials.cli.run
import driftyard
def stop(done, total):
    print(time.monotonic() - float(sys.argv[1]), flush=True)
    os._exit(0)
driftyard.run(sys.argv[2], out=sys.argv[3], progress=stop)
"""
"""Program that prints the seconds until the first frame has a pose."""
RESETS = """
import sys, time
import gymnasium
env = gymnasium.make("driftyard:driftyard/RoverNav-v0", disable_env_checker=True, localization="vo")
def reset(seed=None):
    start = time.monotonic()
    env.reset(seed=seed)
    return time.monotonic() - start
reset(0)
print(time.monotonic() - float(sys.argv[1]))
print(*(reset(seed) for seed in (1, 2)))
print(*(reset(seed) for seed in (None, 1, 2)))
"""
"""Program that prints seconds until the first reset, those of new layouts, and of known ones."""
REPEATS = 3


@dataclass(frozen=True)
class Timed:
    """A program's output, and its wall and processor time, s, with those it has started."""

    lines: list[list[float]]
    wall_s: float
    cpu_s: float


def time_program(text: str, *words: str, kept: Path | None = None) -> Timed:
    """Run a Python program with its time of start as the first word.

    Machine code is kept in a folder, by default where it always is.
    """
    environment = {**os.environ, "MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")}
    if kept is not None:
        environment["NUMBA_CACHE_DIR"] = str(kept)
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), monotonic()
    command = [sys.executable, "-W", "ignore", "-c", text, str(start), *words]
    done = subprocess.run(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    lines = [[float(x) for x in line.split()] for line in done.stdout.decode().splitlines()]
    return Timed(lines, monotonic() - start, cpu_s)


def start_table(dataset: Path, folder: Path, quick: bool) -> Table:
    """Measure runs over a dataset and resets; what needs compilation is left out if quick."""
    run = str(dataset), str(folder / "start.txt")
    rows: list[tuple[str, float, float | None, str]] = []
    if not quick:
        kept = folder / "machine_code"
        first, resets = (time_program(RUN, *run, kept=kept), time_program(RESETS, kept=kept))
        functions = len(list(kept.rglob("*.nbi")))
        label = f"first run of an installation ({functions} functions are kept)"
        rows.append((label, first.lines[0][0], first.cpu_s, "≤ 45"))
        rows.append(("first reset of an environment after it", resets.lines[0][0], None, "≤ 10"))
    time_program(RUN, *run)  # with what is not kept yet
    runs = [time_program(RUN, *run) for _ in range(REPEATS)]
    run_s = float(np.median([x.lines[0][0] for x in runs]))
    rows.append(("later run", run_s, float(np.median([x.cpu_s for x in runs])), "≤ 1.5"))
    resets = time_program(RESETS)
    for label, k, required in (
        ("first reset of an environment, later", 0, ""),
        ("reset, new layout", 1, "≤ 3"),
        ("reset, known layout", 2, "≤ 0.05"),
    ):
        rows.append((label, float(np.median(resets.lines[k])), None, required))
    cells = [(x, f"{s:.2f}", "" if cpu is None else f"{cpu:.1f}", y) for x, s, cpu, y in rows]
    return text_table(("until the first pose, or reset", "s", "CPU s", "required"), cells)
