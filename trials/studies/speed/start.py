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
    start, start_cpu = time.monotonic(), time.process_time()
    env.reset(seed=seed)
    print(time.monotonic() - start, time.process_time() - start_cpu)
env.reset(seed=0)
print(time.monotonic() - float(sys.argv[1]), time.process_time())
for seed in (1, 2, None, 1, 2):
    reset(seed)
"""
"""Program that prints wall and processor time, s, until the first reset, then of resets.

Two of these are in a new layout, three in a known one.
"""
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
    rows: list[tuple[str, float, float, str]] = []
    if not quick:
        kept = folder / "machine_code"
        first, resets = time_program(RUN, *run, kept=kept), time_program(RESETS, kept=kept)
        functions = len(list(kept.rglob("*.nbi")))
        label = f"first run of an installation ({functions} functions are kept)"
        rows.append((label, first.lines[0][0], first.cpu_s, "≤ 45"))
        label = "first reset of an environment after it"
        rows.append((label, resets.lines[0][0], resets.lines[0][1], "≤ 10"))
    time_program(RUN, *run)  # with what is not kept yet
    runs = [time_program(RUN, *run) for _ in range(REPEATS)]
    wall_s, cpu_s = np.median([(x.lines[0][0], x.cpu_s) for x in runs], axis=0).tolist()
    rows.append(("later run", wall_s, cpu_s, "≤ 1.5"))
    resets_s = np.array(time_program(RESETS).lines)
    for label, part, required in (
        ("first reset of an environment, later", slice(1), ""),
        ("reset, new layout", slice(1, 3), "≤ 3"),
        ("reset, known layout", slice(3, None), "≤ 0.05"),
    ):
        wall_s, cpu_s = np.median(resets_s[part], axis=0).tolist()
        rows.append((label, wall_s, cpu_s, required))
    cells = [(label, f"{x:.2f}", f"{y:.2f}", required) for label, x, y, required in rows]
    return text_table(("until the first pose, or reset", "s", "CPU s", "required"), cells)
