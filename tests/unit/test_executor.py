"""The executor: results, errors, and workers, parents and schedulers that are killed."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
from distributed import Client
from small_tasks import Measured, die, measure_once, mixed_tasks, render_with
from terminal import ROOT

from sim.graphics import GraphicsError
from trials.execution import cache, cluster
from trials.execution.cluster import Workers
from trials.execution.devices import claim_gpu
from trials.execution.executor import compute, perform, using
from trials.execution.queues import SINGLE_THREAD
from trials.execution.store import present
from trials.execution.tasks import Task, WorkerError
from vo.contract.errors import SettingsError

HERE = Workers(0)
LOCAL = {"PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"}


def content(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def until(condition):
    deadline = time.monotonic() + 60
    while not (found := condition()):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    return found


@pytest.fixture(scope="module", autouse=True)
def two_cores() -> Iterator[None]:
    """Start workers here, whatever the other tests do: a task that kills its process would kill
    the tests.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cluster, "usable_cores", lambda: 2)
        yield


@pytest.fixture(scope="module")
def two_workers() -> Iterator[None]:
    with using(Workers(2)):
        yield


@pytest.mark.parametrize("workers", [HERE, None])
def test_compute_returns_results_in_the_order_of_tasks(workers, two_workers):
    tasks = [Task("nothing", f"{k}", divmod, (k, 7)) for k in range(3000)]
    with ExitStack() as stack:
        if workers:
            stack.enter_context(using(workers))
        assert compute(tasks) == [divmod(k, 7) for k in range(3000)]


def test_compute_raises_the_error_of_a_task(two_workers):
    with pytest.raises(ZeroDivisionError) as caught:
        compute([Task("nothing", "bad", divmod, (1, 0)), Task("nothing", "good", divmod, (7, 2))])
    assert "read.function(*read.arguments)" in caught.value.__notes__[0]  # where it was raised


def test_perform_continues_after_errors_and_logs(two_workers, tmp_path):
    tasks = [Task("nothing", f"over {k}", divmod, (1, k)) for k in (0, 1)]
    with using(Workers(0, log=tmp_path / "log.jsonl")):
        outcomes = sorted(perform(tasks), key=lambda x: x.row)
    assert [type(x.error) for x in outcomes] == [ZeroDivisionError, type(None)]
    lines = [json.loads(x) for x in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert [(x["task"], x["status"]) for x in lines] == [("over 0", "failed"), ("over 1", "done")]


def test_workers_have_one_thread_and_a_core_each():
    with using(Workers(1, pinned=True)):
        names = [*SINGLE_THREAD]
        assert compute([Task("nothing", x, os.getenv, (x,)) for x in names]) == ["1"] * len(names)
        (cores,) = compute([Task("nothing", "cores", os.sched_getaffinity, (0,))])
    assert len(cores) == 1


def test_kept_results_are_computed_once(tmp_path, monkeypatch):
    """Here, and on a machine that shares the store, unless arguments or causes are others."""
    log = str(tmp_path / "log")
    tasks = [Task("trial", f"{k}", measure_once, (log, k), list[Measured]) for k in (1, 2)]
    with using(Workers(0, store=str(tmp_path / "store"))):
        for folder in ("one", "one", "two"):
            (tmp_path / folder).mkdir(exist_ok=True)
            monkeypatch.chdir(tmp_path / folder)
            assert repr(compute(tasks)) == repr([measure_once("/dev/null", k) for k in (1, 2)])
            assert Path(log).read_text() == "xx"
    monkeypatch.chdir(tmp_path)
    with using(Workers(0)):
        compute(
            [*tasks, replace(tasks[0], causes=("a scene",)), replace(tasks[0], arguments=(log, 3))]
        )
    assert Path(log).read_text() == "xxxxxx"
    (file,) = (tmp_path / "one/build/cache/results").glob("trial-1-*")
    assert {"kind", "arguments", "code", "host", "seconds"} < {*json.loads(file.read_text())}


def test_task_that_kills_its_worker_is_set_aside(two_workers, tmp_path):
    """It is tried three times and named, after all others are done."""
    tasks = [Task("nothing", f"{k}", divmod, (k, 7)) for k in range(5)]
    deadly = Task("nothing", "the deadly one", die, (str(tmp_path / "tries"),))
    done = []
    with pytest.raises(WorkerError, match="the deadly one: its worker was lost in each of 3 tries"):
        compute([deadly, *tasks], done.append)
    assert sorted(done) == [divmod(k, 7) for k in range(5)]
    assert (tmp_path / "tries").read_text() == "xxx"


def test_unsendable_result_and_missing_module_cost_one_task(two_workers, monkeypatch):
    """Although others are sent with it."""
    monkeypatch.setitem(sys.modules, "only_here", module := ModuleType("only_here"))
    exec("def plug_in(): pass", vars(module))
    tasks = [Task("nothing", f"{k}", divmod, (k, 7)) for k in range(300)]
    tasks[150] = Task("nothing", "the lock", threading.Lock)
    tasks[250] = Task("nothing", "the plug-in", module.plug_in)
    errors = {x.row: str(x.error) for x in perform(tasks) if x.error}
    assert "cannot be pickled" in errors.pop(150)
    assert errors[250].endswith("cannot import only_here, which the task needs")
    assert len(errors) == 1


def test_workers_print_remarks_and_end_with_their_parent(tmp_path):
    script = tmp_path / "main.py"
    script.write_text(
        "from small_tasks import say, wait_in\n"
        "from trials.execution.cluster import Workers\n"
        "from trials.execution.executor import compute, using\n"
        "from trials.execution.tasks import Task\n"
        "if __name__ == '__main__':\n"
        "    with using(Workers(1)):\n"
        "        compute([Task('x', 'x', say, ('table.csv: a row is left out',))])\n"
        "        compute([Task('x', 'x', wait_in, ('pid',))])\n"
    )
    words = [sys.executable, script]
    parent = subprocess.Popen(
        words, cwd=tmp_path, env={**os.environ, **LOCAL}, stderr=subprocess.PIPE, text=True
    )
    worker = int(until(lambda: (tmp_path / "pid").is_file() and (tmp_path / "pid").read_text()))
    parent.send_signal(signal.SIGKILL)
    until(lambda: not is_running(worker))
    assert "driftyard: remark: table.csv: a row is left out\n" in parent.communicate()[1]


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] not in ("Z", "X")
    except FileNotFoundError:
        return False


class Nodes:
    """A scheduler, and two workers that start in folders of their own."""

    def __init__(self, folder: Path, path: str) -> None:
        sheet = folder / "scheduler.json"
        self.scheduler = self._start("scheduler", folder, path, "--scheduler-file", sheet)
        until(lambda: sheet.is_file() and sheet.read_text().endswith("}"))
        self.address = json.loads(sheet.read_text())["address"]
        self.workers = []
        for name in ("one", "two"):
            (folder / name).mkdir()
            words = (self.address, "--nthreads", "1")
            self.workers.append(self._start("worker", folder / name, path, *words))

    @staticmethod
    def _start(kind: str, cwd: Path, path: str, *words: object) -> subprocess.Popen[bytes]:
        module = f"distributed.cli.dask_{kind}"
        local = ("--host", "127.0.0.1", "--no-dashboard", *(["--port", "0"] * (kind != "worker")))
        return subprocess.Popen(
            [sys.executable, "-m", module, *map(str, words), *local],
            cwd=cwd,
            env={**os.environ, "PYTHONPATH": path},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def stop(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()  # workers end with their nannies
            process.wait()


@pytest.fixture(scope="module")
def nodes(tmp_path_factory) -> Iterator[Nodes]:
    """The tests use them in order: the last one kills the scheduler."""
    made = Nodes(tmp_path_factory.mktemp("nodes"), LOCAL["PYTHONPATH"])
    yield made
    made.stop()


def test_forty_tasks_on_two_nodes_survive_two_kills(nodes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with using(HERE):
        compute(mixed_tasks("here", 40))
    killed: set[int] = set()
    rows: list[int] = []
    with using(Workers(scheduler=nodes.address, store=str(tmp_path / "store"))):
        for outcome in perform(mixed_tasks("there", 40)):
            rows.append(outcome.row)
            process = outcome.result()
            if len(rows) >= (5, 20, 41)[len(killed)] and process not in killed:
                os.kill(process, signal.SIGKILL)
                killed.add(process)
        assert not (tmp_path / "there").exists()  # each node has a folder of its own
        for k in range(40):
            (tmp_path / "there").mkdir(exist_ok=True)
            present(Path(f"there/{k}"))
    assert len(killed) == 2
    assert sorted(rows) == [*range(40)]
    assert content(tmp_path / "there") == content(tmp_path / "here")
    assert sorted(x.name for x in (tmp_path / "there").iterdir()) == sorted(map(str, range(40)))


def test_worker_without_driftyard_that_joins_later_is_named(nodes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cluster, "COUNT_S", 0)  # it is counted, and gets tasks, at once
    (tmp_path / "trials").mkdir()
    (tmp_path / "trials/__init__.py").touch()
    with using(Workers(scheduler=nodes.address)), Client(nodes.address) as client:
        assert compute([Task("nothing", "x", divmod, (1, 1))]) == [(1, 0)]
        late = nodes._start("worker", tmp_path, str(tmp_path), nodes.address, "--nthreads", "1")
        try:
            client.wait_for_workers(3, timeout=60)
            with pytest.raises(
                WorkerError, match=r"tcp://127.* has no driftyard; install it there"
            ):
                compute(mixed_tasks("there", 200))
        finally:
            late.kill()
            late.wait()
        until(lambda: len(client.nthreads()) == 2)


def test_worker_without_opengl_ends_in_one_line(two_workers, tmp_path, monkeypatch):
    """Nothing counts as done: the same task is computed again."""
    monkeypatch.chdir(tmp_path)
    tasks = [Task("trial", f"{k}", render_with, (str(9 - 9 * k),), bool) for k in range(2)]
    with pytest.raises(GraphicsError, match=r"no off-screen .*DEVICE_ID .* got 9"):
        compute(tasks[:1])
    assert not [*tmp_path.rglob("trial-0-*")]
    assert compute(tasks[1:]) == [True]


def test_gpus_of_a_machine_are_shared_evenly(tmp_path):
    """A claim ends with its process, as with its file here."""
    with ExitStack() as stack:
        claims = [claim_gpu((0, 3), tmp_path) for _ in range(5)]
        files = [stack.enter_context(file) for _, file in claims]
        assert [number for number, _ in claims] == [0, 3, 0, 3, 0]
        files[1].close()
        number, file = claim_gpu((0, 3), tmp_path)
        stack.enter_context(file)
        assert number == 3


def test_worker_with_other_code_is_refused(nodes, monkeypatch):
    monkeypatch.setattr(cache, "EVERYTHING", ("vo",))
    cache.code_digest.cache_clear()
    with (
        using(Workers(scheduler=nodes.address)),
        pytest.raises(WorkerError, match="has other code; install this version"),
    ):
        compute([Task("nothing", "x", divmod, (1, 1))])
    cache.code_digest.cache_clear()


def test_lost_scheduler_ends_in_one_line(nodes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with using(Workers(scheduler=nodes.address)):
        outcomes = perform(mixed_tasks("there", 40))
        next(outcomes)
        nodes.scheduler.kill()
        with pytest.raises(WorkerError, match="lost; the same command continues from here"):
            list(outcomes)


@pytest.mark.parametrize(
    ("scheduler", "said"),
    [
        ("tcp://127.0.0.1:1", "scheduler tcp://127.0.0.1:1: does not answer"),
        ("office", "--scheduler office: expected tcp://HOST:PORT, slurm, kubernetes or ssh:HOST"),
        ("slurm", "dask_jobqueue is not installed: pip install 'driftyard\\[cluster\\]'"),
        ("kubernetes", "dask_kubernetes"),
    ],
)
def test_unusable_scheduler_is_one_line(scheduler, said, monkeypatch):
    monkeypatch.setattr("trials.execution.cluster.CONNECT_S", 1)
    with (
        using(Workers(scheduler=scheduler)),
        pytest.raises((WorkerError, SettingsError), match=said),
    ):
        compute([Task("nothing", "x", divmod, (1, 1))])
