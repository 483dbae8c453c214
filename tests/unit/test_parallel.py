"""Parallel map: results, errors, and a parent or a worker that is killed."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from terminal import ROOT

from trials.execution.parallel import THREADS, map_parallel
from vo.contract.remarks import remark


def test_map_parallel_returns_every_result_once():
    assert sorted(map_parallel(divmod, [(7, 2), (9, 4)])) == [(0, (3, 1)), (1, (2, 1))]


def test_map_parallel_raises_the_error_of_a_call():
    with pytest.raises(ZeroDivisionError):
        list(map_parallel(divmod, [(1, 0), (7, 2)]))


def test_map_parallel_workers_have_one_thread(monkeypatch):
    monkeypatch.delenv(THREADS[0], raising=False)
    monkeypatch.setenv(THREADS[1], "3")
    assert [x for _, x in map_parallel(os.getenv, [(THREADS[0],), (THREADS[1],)])] == ["1", "1"]
    assert THREADS[0] not in os.environ
    assert os.environ[THREADS[1]] == "3"


def test_map_parallel_confines_a_process_to_a_core():
    before = os.sched_getaffinity(0)
    (found,) = map_parallel(os.sched_getaffinity, [(0,)], processes=1)
    assert found == (0, {min(before)})
    assert os.sched_getaffinity(0) == before


def test_map_parallel_workers_print_remarks_as_lines(capfd):
    list(map_parallel(remark, [("table.csv: a row is left out",)]))
    assert capfd.readouterr().err == "driftyard: remark: table.csv: a row is left out\n"


def write_and_wait(file: str) -> None:
    """A long job that says who it is."""
    Path(file).write_text(str(os.getpid()))
    time.sleep(60)


def test_map_parallel_workers_end_with_their_parent(tmp_path):
    file = tmp_path / "pid"
    code = (
        "import sys; sys.path.insert(0, 'tests/unit')\n"
        "from test_parallel import write_and_wait\n"
        "from trials.execution.parallel import map_parallel\n"
        f"if __name__ == '__main__': list(map_parallel(write_and_wait, [({str(file)!r},)]))"
    )
    script = tmp_path / "main.py"
    script.write_text(code)
    env = {**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"}
    parent = subprocess.Popen([sys.executable, script], cwd=ROOT, env=env)
    until(lambda: file.is_file() and file.read_text() != "")
    worker = int(file.read_text())
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    until(lambda: not is_running(worker))


def test_guard_killed_worker_ends_in_one_line(tmp_path):
    script = tmp_path / "main.py"
    script.write_text(
        "import os\nfrom trials.cli.main import guard\n"
        "from trials.execution.parallel import map_parallel\n"
        "if __name__ == '__main__': guard(lambda: list(map_parallel(os._exit, [(9,)])))"
    )
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    words = [sys.executable, script]
    run = subprocess.run(words, env=env, capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert run.stderr.count("\n") == 1
    assert run.stderr.startswith("driftyard: error: a worker process was killed")


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] not in ("Z", "X")
    except FileNotFoundError:
        return False


def until(condition) -> None:
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)
